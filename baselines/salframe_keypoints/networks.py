"""Base class of matchers with torch features, and LightGlue, a learned matcher for such features."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from salframe.framework.errors import WeightsError
from salframe_keypoints.checkpoints import TrainedMatcher, load_strictly, read_checkpoint
from salframe_keypoints.descriptors import DescriptorMatcher
from salframe_keypoints.feature_matcher import ViewFeatures

PIXEL_CENTRE = np.float32(0.5)
"""Offset that is added to the coordinates of kornia and transformers, where pixel centres are at integers. In salframe
they are at +0.5."""


class NetworkMatcher(TrainedMatcher, DescriptorMatcher):
    """Keypoints and descriptors of a network, matched if they are mutual nearest neighbours."""

    requires = ("torch", "kornia")

    class Config(TrainedMatcher.Config):
        max_keypoints: int = Field(512, ge=16, description="maximum number of keypoints in each view")

    @abstractmethod
    def detect(self, image: Any) -> tuple[Any, Any]:
        """Detect keypoints in an image.

        Args:
            image: (1, 3, h, w) tensor with values from 0 to 1.

        Returns:
            Tensors of keypoints (K, 2) in pixels (pixel centres at integers), and descriptors (K, D) of unit length.
        """

    def extract(self, images: np.ndarray) -> list[ViewFeatures]:
        """See FeatureMatcher. Images are processed one by one to limit memory. Descriptors are stored as float16."""
        import torch

        views = []
        with torch.inference_mode():
            for image in images:
                keypoints, descriptors = self.detect(torch.tensor(image).permute(2, 0, 1)[None].float() / 255)
                views.append(
                    ViewFeatures(keypoints.numpy().astype(np.float32) + PIXEL_CENTRE, descriptors.half().numpy())
                )
        return views

    def match_descriptors(self, query: ViewFeatures, reference: ViewFeatures) -> np.ndarray:
        """See DescriptorMatcher."""
        if not len(query.features) or not len(reference.features):
            return np.zeros((0, 2), int)
        cosines = query.features.astype(np.float32) @ reference.features.astype(np.float32).T
        nearest, nearest_back = cosines.argmax(1), cosines.argmax(0)
        mutual = np.flatnonzero(nearest_back[nearest] == np.arange(len(nearest)))
        return np.stack([mutual, nearest[mutual]], 1)


class LightGlue:
    """LightGlue (Lindenberger et al., ICCV 2023) by kornia, for one type of features."""

    def __init__(self, features: str, path: Path) -> None:
        """Load the network.

        Args:
            features: Type of features, a key of kornia's LightGlue.features.
            path: Checkpoint.

        Raises:
            WeightsError: The checkpoint is not a LightGlue network for these features.
        """
        from kornia import feature

        # `features=None` prevents a download by kornia. The settings for these features are passed explicitly instead.
        settings: dict[str, Any] = {**feature.LightGlue.features[features], "features": None}
        del settings["weights"]
        self._network = feature.LightGlue(**settings).eval()
        load_strictly(
            self._network, lightglue_state(read_checkpoint(path), path), path, computed="confidence_thresholds"
        )

    def match(self, query: ViewFeatures, reference: ViewFeatures, view_size_px: tuple[int, int]) -> np.ndarray:
        """Return (M, 2) int, the indices of matched points in the query and in the reference."""
        import torch

        size = torch.tensor([view_size_px])
        with torch.inference_mode():
            matches = self._network({"image0": _side(query, size), "image1": _side(reference, size)})["matches"]
        return matches[0].numpy()


def _side(view: ViewFeatures, size: Any) -> dict[str, Any]:
    import torch

    points, descriptors = torch.from_numpy(view.points_px - PIXEL_CENTRE), torch.tensor(view.features).float()
    return {"keypoints": points[None], "descriptors": descriptors[None], "image_size": size}


def lightglue_state(content: Any, path: Path) -> dict[str, Any]:
    """Return the tensors of LightGlue in a checkpoint of its authors, renamed for kornia, without other networks.

    Raises:
        WeightsError: The content is not a LightGlue checkpoint.
    """
    if not isinstance(content, Mapping):
        raise WeightsError(
            f"{path} is not a LightGlue checkpoint: the file contains {type(content).__name__}, expected a mapping "
            "from names to "
            "tensors"
        )
    if any(name.startswith("matcher.") for name in content):  # the file of XFeat also holds the feature network
        content = {
            name.removeprefix("matcher."): value for name, value in content.items() if name.startswith("matcher.")
        }
    return {
        re.sub(r"^(self_attn|cross_attn)\.(\d+)", r"transformers.\2.\1", name): value
        for name, value in content.items()
        if not re.fullmatch(
            r"log_assignment\.\d+\.r", name
        )  # in the file for DISK, not used by any published LightGlue
    }
