"""Base class of matchers of keypoints with descriptors."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from salframe_keypoints.feature_matcher import FeatureMatcher, ViewFeatures


class DescriptorMatcher(FeatureMatcher):
    """Detects points with descriptors in each view, one row of `features` per point, and matches the descriptors."""

    @abstractmethod
    def match_descriptors(self, query: ViewFeatures, reference: ViewFeatures) -> np.ndarray:
        """Return (M, 2) int, the indices of matched points in the query and in the reference."""

    def restrict(self, view: ViewFeatures, valid: np.ndarray) -> ViewFeatures:
        """See FeatureMatcher."""
        return ViewFeatures(view.points_px[valid], view.features[valid])

    def match(self, query: ViewFeatures, reference: ViewFeatures) -> tuple[np.ndarray, np.ndarray]:
        """See FeatureMatcher."""
        matches = self.match_descriptors(query, reference)
        return query.points_px[matches[:, 0]], matches[:, 1]

    def describe(self, view: ViewFeatures) -> np.ndarray:
        """Return the descriptors, normalised to unit length."""
        return unit_rows(view.features)


def unit_rows(vectors: np.ndarray) -> np.ndarray:
    """Return (N, D) float32 with rows of unit length. Rows of zeros do not change."""
    vectors = np.asarray(vectors, np.float32)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
