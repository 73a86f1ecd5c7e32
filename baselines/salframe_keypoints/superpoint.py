"""SuperPoint (DeTone et al., CVPRW 2018) by `transformers`: by nearest neighbours, or by SuperGlue (Sarlin et al., CVPR
2020).

Their weights are under Magic Leap's licence: for research, not for commerce.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from salframe_keypoints.networks import PIXEL_CENTRE, NetworkPair
from salframe_keypoints.pairs import View
from salframe_keypoints.pretrained import Pretrained

LICENCE = "Magic Leap's licence, non-commercial research"
SUPERPOINT = Pretrained("magic-leap-community/superpoint", LICENCE, "SuperPointForKeypointDetection", "superpoint")
SUPERGLUE = Pretrained("magic-leap-community/superglue_indoor", LICENCE, "SuperGlueForKeypointMatching", "superglue")


class SuperPointNearest(NetworkPair):
    """SuperPoint keypoints with mutual nearest neighbours."""

    requires = ("torch", "transformers")
    extra = "salframe[transformers]"

    @classmethod
    def files(cls, config) -> tuple[Path, ...]:
        """See Pair."""
        return SUPERPOINT.files(config.checkpoint)

    def __init__(self, config) -> None:
        self._extractor = SUPERPOINT.load(config.checkpoint)
        self._extractor.keypoint_decoder.max_keypoints = config.max_keypoints

    def detect(self, image: Any) -> tuple[Any, Any]:
        """See NetworkPair."""
        keypoints, _, descriptors = detect_points(self._extractor, image)
        return keypoints, descriptors


class SuperPointSuperGlue(NetworkPair):
    """SuperPoint keypoints with SuperGlue, which reads their scores too: a point's features are its descriptor, then
    its score."""

    requires = ("torch", "transformers")
    extra = "salframe[transformers]"

    @classmethod
    def files(cls, config) -> tuple[Path, ...]:
        """See Pair."""
        return SUPERGLUE.files(config.checkpoint)

    def __init__(self, config) -> None:
        self._network = SUPERGLUE.load(config.checkpoint)
        self._extractor = self._network.keypoint_detector
        self._extractor.keypoint_decoder.max_keypoints = config.max_keypoints
        self._size_px = (config.view_width_px, config.view_height_px)

    def detect(self, image: Any) -> tuple[Any, Any]:
        """See NetworkPair."""
        import torch

        keypoints, scores, descriptors = detect_points(self._extractor, image)
        return keypoints, torch.cat([descriptors, scores[:, None]], 1)

    def match_descriptors(self, query: View, reference: View) -> np.ndarray:
        """See DescriptorPair. SuperGlue detects points on its own; here its detector is one that recalls those of the
        two views."""
        import torch

        if not len(query.features) or not len(reference.features):
            return np.zeros((0, 2), int)
        del self._network.keypoint_detector
        self._network.keypoint_detector = lambda pixels: self._recall((query, reference))
        with torch.inference_mode():
            found = (
                self._network(torch.empty(1, 2, 3, *self._size_px[::-1])).matches[0, 0, : len(query.features)].numpy()
            )
        matched = np.flatnonzero(found >= 0)
        return np.stack([matched, found[matched]], 1)

    def retrieval_features(self, view: View) -> np.ndarray:
        """The descriptors without the scores."""
        return super().retrieval_features(View(view.points_px, view.features[:, :-1]))

    def _recall(self, views: tuple[View, View]) -> tuple[Any, Any, Any, Any]:
        """What SuperPoint gives of two images: relative positions, scores and descriptors, padded to as many points,
        and which are points."""
        import torch

        most = max(len(view.points_px) for view in views)
        keypoints, features, mask = (
            torch.zeros(2, most, 2),
            torch.zeros(2, most, views[0].features.shape[1]),
            torch.zeros(2, most, dtype=torch.int),
        )
        for i, view in enumerate(views):
            count = len(view.points_px)
            keypoints[i, :count] = torch.from_numpy(
                (view.points_px - PIXEL_CENTRE) / np.array(self._size_px, np.float32)
            )
            features[i, :count] = torch.tensor(view.features).float()
            mask[i, :count] = 1
        return keypoints, features[..., -1], features[..., :-1], mask


def detect_points(extractor: Any, image: Any) -> tuple[Any, Any, Any]:
    """Keypoints (K, 2) in whole pixels, their scores (K,) and descriptors of unit length (K, D) of an image (1, 3, h,
    w) from 0 to 1."""
    grey = (image * image.new_tensor([0.299, 0.587, 0.114])[:, None, None]).sum(1, keepdim=True)
    found = extractor(grey)
    height, width = image.shape[2:]
    return (found.keypoints[0] * image.new_tensor([width, height])).round(), found.scores[0], found.descriptors[0]
