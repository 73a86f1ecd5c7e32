"""LoFTR (Sun et al., CVPR 2021) by kornia: no keypoints, two images go in and matches come out."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from salframe.config import merge
from salframe.errors import ConfigError, WeightsMissing
from salframe.weights import Download, Weights, WeightsFile
from salframe_keypoints.pairs import Pair, View, gray, load_strictly, read_checkpoint
from salframe_keypoints.sift import root_sift

LOFTR = Weights(
    name="loftr",
    licence="Apache-2.0",
    files=(WeightsFile("loftr_indoor_ds_new.ckpt", "be9ff88b323ec27889114719f668ae41aff7034b56a4c4acbd46b8b180b87ed3", 46_300_000),),
    source=Download(("https://huggingface.co/kornia/loftr/resolve/main", "https://cmp.felk.cvut.cz/~mishkdmy/models")),
)

JPEG_QUALITY = 90


class Loftr(Pair):
    """LoFTR on grey views: a view is its JPEG, its points are the cells of LoFTR's coarse grid.

    As detector-free matching has no descriptors to pool, the shortlist comes from SIFT of the same JPEG.
    """

    requires = ("torch", "kornia")
    weights = (LOFTR,)

    def __init__(self, config) -> None:
        import torch
        from kornia.feature.loftr import loftr

        self._torch = torch
        self._sift = cv2.SIFT_create(nfeatures=config.max_keypoints)
        settings = merge(copy.deepcopy(loftr.default_cfg), config.loftr_config)
        settings["resolution"] = tuple(settings["resolution"])
        self._stride = settings["resolution"][0]
        (path,) = LOFTR.paths(config.checkpoint)
        try:
            self._model = loftr.LoFTR(pretrained=None, config=settings).eval()
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"loftr_config is no architecture that kornia knows: {' '.join(str(error).split())}") from None
        if not config.loftr_fine:
            _remove_fine_stage(self._model)
        load_strictly(self._model, checkpoint_state(read_checkpoint(path), path), path)

    def extract(self, images: np.ndarray) -> list[View]:
        """See Pair."""
        rows, columns = (np.arange(0, size, self._stride, np.uint16) for size in images.shape[1:3])
        grid = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        return [View(grid, cv2.imencode(".jpg", image, quality)[1].ravel()) for image in gray(images)]

    def restrict(self, view: View, seen: np.ndarray) -> View:
        """See Pair: the image stays whole."""
        return view

    def match(self, query: View, reference: View) -> tuple[np.ndarray, np.ndarray]:
        """See Pair. The reference is LoFTR's first image, whose matches lie on the grid; those of the second are refined off it."""
        images = [self._torch.from_numpy(_decode(view)).float()[None, None] / 255 for view in (reference, query)]
        with self._torch.inference_mode():
            found = self._model({"image0": images[0], "image1": images[1]})
        cells = (found["keypoints0"].numpy() / self._stride).round().astype(int)
        columns = -(-images[0].shape[3] // self._stride)
        return found["keypoints1"].numpy(), cells[:, 1] * columns + cells[:, 0]

    def retrieval_features(self, view: View) -> np.ndarray:
        """RootSIFT of the view's image."""
        descriptors = self._sift.detectAndCompute(_decode(view), None)[1]
        return np.zeros((0, 128), np.float32) if descriptors is None else root_sift(descriptors)


def checkpoint_state(content: Any, path: Path) -> dict[str, Any]:
    """The network's state in a checkpoint: the mapping itself or what it holds as state_dict or model_state_dict. Raises WeightsMissing."""
    for key in ("state_dict", "model_state_dict"):
        if isinstance(content, Mapping) and key in content:
            content = content[key]
    if not isinstance(content, Mapping) or not any(name.removeprefix("matcher.").startswith("backbone.") for name in content):
        raise WeightsMissing(f"{path} is no LoFTR checkpoint: expected a state_dict or model_state_dict with backbone.* inside")
    return {name.removeprefix("matcher."): value for name, value in content.items()}


def _remove_fine_stage(model: Any) -> None:
    """Make matches end on the coarse grid: kornia always refines, and refines at random where the fine stage was never trained."""
    for name in ("fine_preprocess", "loftr_fine", "fine_matching"):
        delattr(model, name)
    model.fine_preprocess = lambda fine0, fine1, coarse0, coarse1, data: (fine0[:0], fine1[:0])  # none: kornia skips loftr_fine
    model.fine_matching = lambda fine0, fine1, data: data.update(mkpts0_f=data["mkpts0_c"], mkpts1_f=data["mkpts1_c"])


def _decode(view: View) -> np.ndarray:
    return cv2.imdecode(view.features, cv2.IMREAD_GRAYSCALE)
