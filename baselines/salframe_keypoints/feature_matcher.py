"""The role `feature-matcher`: extracts and matches features of perspective views for the localizer `keypoints`."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from salframe.framework.component import Role


@dataclass(frozen=True, eq=False)
class ViewFeatures:
    """Features of one perspective view, as they are stored in a map.

    Attributes:
        points_px: (K, 2) x and y of the points that can be matched, pixel centres at +0.5.
        features: (K, D) descriptors of the points, or any other array that the matcher needs.
    """

    points_px: np.ndarray
    features: np.ndarray


class FeatureMatcher(Role):
    """Extracts features of perspective views, and matches the features of two views.

    A map stores the result of `extract` for each view. If only `match` and `describe` read a setting,
    declare it with `match_only`: changing it does not require a new map.
    """

    role = "feature-matcher"
    conformance = "salframe_keypoints.conformance:check_feature_matcher"
    view_size_px: tuple[int, int]
    """Width and height of the views, in pixels. Set by `prepare`."""

    def prepare(self, width_px: int, height_px: int) -> None:
        """Set the size of the views. Called once, before `extract`. Raises ConfigError if the size is not supported."""
        self.view_size_px = width_px, height_px

    @abstractmethod
    def extract(self, images: np.ndarray) -> list[ViewFeatures]:
        """Return a ViewFeatures for each of the images (V, h, w, 3) uint8 RGB."""

    @abstractmethod
    def restrict(self, view: ViewFeatures, valid: np.ndarray) -> ViewFeatures:
        """Return the view without points on invalid pixels.

        Args:
            view: The view.
            valid: (K,) bool, whether the panorama is valid at each point.
        """

    @abstractmethod
    def match(self, query: ViewFeatures, reference: ViewFeatures) -> tuple[np.ndarray, np.ndarray]:
        """Match two views. Return (M, 2) pixels of the query, and (M,) int indices into `reference.points_px`."""

    @abstractmethod
    def describe(self, view: ViewFeatures) -> np.ndarray:
        """Return (N, D) float32 local descriptors of unit length, with the same D for all views.

        The localizer pools these descriptors to a global descriptor, with a vocabulary that is learned from the map.
        Global descriptors select the shortlist of reference frames.
        """
