"""LoFTR (Sun et al., CVPR 2021) by kornia: matches two images without keypoints."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from salframe.framework.component import match_only
from salframe.framework.config import merge
from salframe.framework.errors import ConfigError, WeightsError
from salframe.framework.files.weights import Download, NetworkWeights, WeightsFile
from salframe_keypoints.checkpoints import load_strictly, read_checkpoint
from salframe_keypoints.feature_matcher import ViewFeatures
from salframe_keypoints.images import ImageMatcher, decode, require_multiples

LOFTR = NetworkWeights(
    name="loftr",
    licence="Apache-2.0",
    files=(
        WeightsFile(
            "loftr_indoor_ds_new.ckpt", "be9ff88b323ec27889114719f668ae41aff7034b56a4c4acbd46b8b180b87ed3", 46_300_000
        ),
    ),
    source=Download(("https://huggingface.co/kornia/loftr/resolve/main", "https://cmp.felk.cvut.cz/~mishkdmy/models")),
)


class Loftr(ImageMatcher):
    """LoFTR on grey views. The matched points of a reference view are the cells of the coarse grid of LoFTR."""

    name = "loftr"
    version = "1"
    requires = ("torch", "kornia")
    weights = (LOFTR,)

    class Config(ImageMatcher.Config):
        architecture: dict[str, Any] = Field(
            {"coarse": {"temp_bug_fix": True}},
            description="mapping with the architecture parameters of the checkpoint that differ from `default_cfg` of "
            "kornia",
        )
        fine: bool = match_only(
            True,
            description="true: the checkpoint contains the fine stage of LoFTR; false: it does not, and matches are "
            "not refined",
        )

    def __init__(self, config: Config | None = None) -> None:
        from kornia.feature.loftr import loftr

        super().__init__(config)
        settings = merge(copy.deepcopy(loftr.default_cfg), self.config.architecture)
        settings["resolution"] = tuple(settings["resolution"])
        self.stride_px = settings["resolution"][0]
        (path,) = self.paths(self.config)
        try:
            self._model = loftr.LoFTR(pretrained=None, config=settings).eval()
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(
                f"kornia does not support the LoFTR architecture in the setting `architecture`: "
                f"{' '.join(str(error).split())}"
            ) from None
        if not self.config.fine:
            _remove_fine_stage(self._model)
        load_strictly(self._model, checkpoint_state(read_checkpoint(path), path), path)

    def prepare(self, width_px: int, height_px: int) -> None:
        """See FeatureMatcher."""
        super().prepare(width_px, height_px)
        require_multiples(self.name, self.view_size_px, self.stride_px)

    def match(self, query: ViewFeatures, reference: ViewFeatures) -> tuple[np.ndarray, np.ndarray]:
        """See FeatureMatcher.

        The reference is LoFTR's first image, in which matches are at grid points. The query is the second image, in
        which matches are refined to sub-pixel positions.
        """
        import torch

        images = [torch.from_numpy(decode(view)).float()[None, None] / 255 for view in (reference, query)]
        with torch.inference_mode():
            output = self._model({"image0": images[0], "image1": images[1]})
        cells = (output["keypoints0"].numpy() / self.stride_px).round().astype(int)
        columns = -(-images[0].shape[3] // self.stride_px)
        return output["keypoints1"].numpy(), cells[:, 1] * columns + cells[:, 0]


def checkpoint_state(content: Any, path: Path) -> dict[str, Any]:
    """Return the state of the network in a checkpoint: the mapping itself, or its state_dict or model_state_dict.

    Raises:
        WeightsError: The content is not a LoFTR checkpoint.
    """
    for key in ("state_dict", "model_state_dict"):
        if isinstance(content, Mapping) and key in content:
            content = content[key]
    if not isinstance(content, Mapping) or not any(
        name.removeprefix("matcher.").startswith("backbone.") for name in content
    ):
        raise WeightsError(
            f"{path} is not a LoFTR checkpoint; expected a state_dict or model_state_dict whose keys begin with "
            "'backbone.'"
        )
    return {name.removeprefix("matcher."): value for name, value in content.items()}


def _remove_fine_stage(model: Any) -> None:
    """Disable the refinement of matches. kornia always runs it, and the result is random if it was not trained."""
    for name in ("fine_preprocess", "loftr_fine", "fine_matching"):
        delattr(model, name)
    model.fine_preprocess = lambda fine0, fine1, coarse0, coarse1, data: (
        fine0[:0],
        fine1[:0],
    )  # empty arrays, so kornia skips loftr_fine
    model.fine_matching = lambda fine0, fine1, data: data.update(mkpts0_f=data["mkpts0_c"], mkpts1_f=data["mkpts1_c"])
