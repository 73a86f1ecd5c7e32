"""SuperPoint (DeTone et al., CVPRW 2018) by `transformers`, matched by nearest neighbours or SuperGlue (Sarlin et al.,
CVPR 2020).

The licence of the weights, by Magic Leap, allows non-commercial research only.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from salframe_keypoints.feature_matcher import ViewFeatures
from salframe_keypoints.networks import PIXEL_CENTRE, NetworkMatcher
from salframe_keypoints.pretrained import Pretrained

LICENCE = "Magic Leap's licence, non-commercial research"
SUPERPOINT = Pretrained("magic-leap-community/superpoint", LICENCE, "SuperPointForKeypointDetection", "superpoint")
SUPERGLUE = Pretrained("magic-leap-community/superglue_indoor", LICENCE, "SuperGlueForKeypointMatching", "superglue")


class SuperPointNearest(NetworkMatcher):
    """SuperPoint keypoints, matched if their descriptors are mutual nearest neighbours."""

    name = "superpoint-nn"
    version = "1"
    requires = ("torch", "transformers")
    extra = "salframe[transformers]"

    @classmethod
    def paths(cls, config: Any) -> tuple[Path, ...]:
        """See TrainedMatcher."""
        return SUPERPOINT.files(config.checkpoint)

    def __init__(self, config: NetworkMatcher.Config | None = None) -> None:
        super().__init__(config)
        self._extractor = SUPERPOINT.load(self.config.checkpoint)
        self._extractor.keypoint_decoder.max_keypoints = self.config.max_keypoints

    def detect(self, image: Any) -> tuple[Any, Any]:
        """See NetworkMatcher."""
        keypoints, _, descriptors = detect_points(self._extractor, image)
        return keypoints, descriptors


class SuperPointSuperGlue(NetworkMatcher):
    """SuperPoint keypoints, matched by the network SuperGlue.

    SuperGlue also uses the scores of the keypoints.
    """

    name = "superpoint-superglue"
    version = "1"
    requires = ("torch", "transformers")
    extra = "salframe[transformers]"

    @classmethod
    def paths(cls, config: Any) -> tuple[Path, ...]:
        """See TrainedMatcher."""
        return SUPERGLUE.files(config.checkpoint)

    def __init__(self, config: NetworkMatcher.Config | None = None) -> None:
        super().__init__(config)
        self._network = SUPERGLUE.load(self.config.checkpoint)
        self._extractor = self._network.keypoint_detector
        self._extractor.keypoint_decoder.max_keypoints = self.config.max_keypoints

    def detect(self, image: Any) -> tuple[Any, Any]:
        """See NetworkMatcher."""
        import torch

        keypoints, scores, descriptors = detect_points(self._extractor, image)
        return keypoints, torch.cat([descriptors, scores[:, None]], 1)

    def match_descriptors(self, query: ViewFeatures, reference: ViewFeatures) -> np.ndarray:
        """See DescriptorMatcher.

        SuperGlue runs its own detector. Here, the detector is replaced by a function that returns the points of the two
        views.
        """
        import torch

        if not len(query.features) or not len(reference.features):
            return np.zeros((0, 2), int)
        del self._network.keypoint_detector
        self._network.keypoint_detector = lambda pixels: self._restore_points((query, reference))
        with torch.inference_mode():
            matches = self._network(torch.empty(1, 2, 3, *self.view_size_px[::-1])).matches
        partner = matches[0, 0, : len(query.features)].numpy()
        matched = np.flatnonzero(partner >= 0)
        return np.stack([matched, partner[matched]], 1)

    def describe(self, view: ViewFeatures) -> np.ndarray:
        """Return the descriptors without the scores."""
        return super().describe(ViewFeatures(view.points_px, view.features[:, :-1]))

    def _restore_points(self, views: tuple[ViewFeatures, ViewFeatures]) -> tuple[Any, Any, Any, Any]:
        """Return the features of two views in the format of SuperPoint's output.

        Returns:
            Keypoints (2, K, 2) relative to the image size, scores (2, K), descriptors (2, K, D), and a mask (2, K) that
            is 0 for padding. K is the larger number of points.
        """
        import torch

        max_points = max(len(view.points_px) for view in views)
        keypoints = torch.zeros(2, max_points, 2)
        features = torch.zeros(2, max_points, views[0].features.shape[1])
        mask = torch.zeros(2, max_points, dtype=torch.int)
        for i, view in enumerate(views):
            count = len(view.points_px)
            keypoints[i, :count] = torch.from_numpy(
                (view.points_px - PIXEL_CENTRE) / np.array(self.view_size_px, np.float32)
            )
            features[i, :count] = torch.tensor(view.features).float()
            mask[i, :count] = 1
        return keypoints, features[..., -1], features[..., :-1], mask


def detect_points(extractor: Any, image: Any) -> tuple[Any, Any, Any]:
    """Detect keypoints in an image (1, 3, h, w) with values from 0 to 1.

    Returns:
        Keypoints (K, 2) in pixels, rounded to integers, scores (K,), and descriptors (K, D) of unit length.
    """
    grey = (image * image.new_tensor([0.299, 0.587, 0.114])[:, None, None]).sum(1, keepdim=True)
    output = extractor(grey)
    height, width = image.shape[2:]
    return (output.keypoints[0] * image.new_tensor([width, height])).round(), output.scores[0], output.descriptors[0]
