"""SIFT (Lowe 2004) by OpenCV, matched by the ratio test. Requires no network and no weights."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe_keypoints.descriptors import DescriptorMatcher, unit_rows
from salframe_keypoints.feature_matcher import ViewFeatures

RATIO = 0.8
"""Maximum ratio of the distances to the nearest and the second nearest descriptor (Lowe 2004, section 7.1)."""


class Sift(DescriptorMatcher):
    """SIFT keypoints computed by OpenCV, matched by the ratio test of nearest neighbours."""

    name = "sift"
    version = "1"

    class Config(ComponentConfig):
        max_keypoints: int = Field(512, ge=16, description="maximum number of keypoints in each view")

    def __init__(self, config: Config | None = None) -> None:
        import cv2

        super().__init__(config)
        self._sift = cv2.SIFT.create(nfeatures=self.config.max_keypoints)

    def extract(self, images: np.ndarray) -> list[ViewFeatures]:
        """See FeatureMatcher. OpenCV's descriptors are integers up to 255, so uint8 is exact."""
        views, limit = [], self.config.max_keypoints
        for image in gray(images):
            keypoints, descriptors = self._sift.detectAndCompute(image, None)
            keypoints = keypoints[:limit]  # OpenCV may return more if the last responses are equal
            points = np.array([point.pt for point in keypoints], np.float32).reshape(-1, 2) + np.float32(0.5)
            described = np.zeros((0, 128), np.uint8) if descriptors is None else descriptors[:limit].astype(np.uint8)
            views.append(ViewFeatures(points, described))
        return views

    def match_descriptors(self, query: ViewFeatures, reference: ViewFeatures) -> np.ndarray:
        """See DescriptorMatcher."""
        if len(query.features) == 0 or len(reference.features) < 2:
            return np.zeros((0, 2), int)
        a, b = query.features.astype(np.float32), reference.features.astype(np.float32)
        squared = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
        candidates = np.argpartition(squared, 1, axis=1)[:, :2]
        nearest, second = np.take_along_axis(squared, candidates, 1).T
        matched = np.flatnonzero(nearest < RATIO**2 * second)
        return np.stack([matched, candidates[matched, 0]], 1)

    def describe(self, view: ViewFeatures) -> np.ndarray:
        """Return RootSIFT descriptors (Arandjelovic and Zisserman 2012)."""
        return root_sift(view.features)


def root_sift(descriptors: np.ndarray) -> np.ndarray:
    """Return the square roots of SIFT descriptors, (N, 128) float32 of unit length."""
    return unit_rows(np.sqrt(descriptors.astype(np.float32)))


def gray(images: Iterable[np.ndarray]) -> list[np.ndarray]:
    """Return the (h, w) uint8 luminance of each (h, w, 3) uint8 RGB image."""
    import cv2

    return [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in images]
