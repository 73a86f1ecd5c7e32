"""The role that `keypoints` is built around: what can be matched in perspective views, and the matcher that goes with
it."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from salframe.framework.component import Role


@dataclass(frozen=True, eq=False)
class View:
    """One perspective view as a matcher remembers it.

    points_px (K, 2): x and y of the points that can be matched, pixel centres at +0.5; features: their descriptors (K,
    D), or whatever else the matcher matches by. Both are stored as they are, so their dtypes are what a map costs.
    """

    points_px: np.ndarray
    features: np.ndarray


class FeatureMatcher(Role):
    """Finds what can be matched in perspective views, and matches two of them.

    What views are stored as is settled by `extract` alone: settings that only `match` and `describe` read are declared
    with `match_only`.
    """

    role = "feature-matcher"
    conformance = "salframe_keypoints.conformance:check_feature_matcher"
    view_size_px: tuple[int, int]
    """Width and height of the views; `prepare` sets it."""

    def prepare(self, width_px: int, height_px: int) -> None:
        """Learn the size of the views, once, before the first of them. Raises ConfigError where it will not do."""
        self.view_size_px = width_px, height_px

    @abstractmethod
    def extract(self, images: np.ndarray) -> list[View]:
        """A View for each of the images (V, h, w, 3) uint8 RGB."""

    @abstractmethod
    def restrict(self, view: View, seen: np.ndarray) -> View:
        """The view without the points on pixels that are not part of the panorama; seen (K,) bool, one a point."""

    @abstractmethod
    def match(self, query: View, reference: View) -> tuple[np.ndarray, np.ndarray]:
        """Matches of two views: (M, 2) pixels of the query, and (M,) int positions in `reference.points_px`."""

    @abstractmethod
    def describe(self, view: View) -> np.ndarray:
        """(N, D) float32 local descriptors of unit length, D alike for all views.

        The global descriptor that a shortlist is made by is pooled from them, over a vocabulary learnt on the map.
        """
