"""What matchers that find points with descriptors have in common."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from salframe_keypoints.feature_matcher import FeatureMatcher, View


class DescriptorMatcher(FeatureMatcher):
    """Finds points with descriptors in each view, a row of `features` a point, and then matches those."""

    @abstractmethod
    def match_descriptors(self, query: View, reference: View) -> np.ndarray:
        """(M, 2) int: positions of matched points in the query and in the reference."""

    def restrict(self, view: View, seen: np.ndarray) -> View:
        """See FeatureMatcher."""
        return View(view.points_px[seen], view.features[seen])

    def match(self, query: View, reference: View) -> tuple[np.ndarray, np.ndarray]:
        """See FeatureMatcher."""
        matches = self.match_descriptors(query, reference)
        return query.points_px[matches[:, 0]], matches[:, 1]

    def describe(self, view: View) -> np.ndarray:
        """The descriptors themselves, brought to unit length."""
        return unit_rows(view.features)


def unit_rows(vectors: np.ndarray) -> np.ndarray:
    """(N, D) float32 rows of unit length; a row of zeros stays."""
    vectors = np.asarray(vectors, np.float32)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
