"""Global descriptors of views for the shortlist, pooled from local descriptors or computed by an image network."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from salframe.framework.errors import DataError
from salframe.localization.localizer import Description
from salframe.panoramas.perspective import ViewRig
from salframe_keypoints.feature_matcher import FeatureMatcher, ViewFeatures

SAMPLE = 20_000
ITERATIONS = 15
"""SAMPLE: maximum number of local descriptors from which the vocabulary is learned. ITERATIONS: number of iterations of
k-means."""
POWER = 3.0
"""Exponent of the generalised mean that pools the features of an image network."""

Pool = Callable[[Description], np.ndarray]
"""Function that returns the (V, G) float32 global descriptors of a description's views: unit length, or zeros if a view
has none."""


class GlobalDescriptors(Protocol):
    """Interface of methods that compute one global descriptor per perspective view."""

    def describe(self, rgb: np.ndarray, valid: np.ndarray | None) -> dict[str, np.ndarray]:
        """Return the arrays that a description needs in addition to the features of the matcher.

        Args:
            rgb: (H, 2H, 3) uint8 colour of a panorama.
            valid: (H, 2H) bool, the valid pixels of the panorama; None if all pixels are valid.
        """

    def learn(self, descriptions: Sequence[Description]) -> tuple[Pool, np.ndarray]:
        """Learn from the F descriptions of a map.

        Returns:
            A function that computes the global descriptors of any description, and the global descriptors (F, V, G) of
            the F descriptions.
        """


class LocalDescriptors:
    """Global descriptors that are pooled from the matcher's local descriptors with a vocabulary of the map."""

    def __init__(self, matcher: FeatureMatcher, words: int) -> None:
        self._matcher, self._words = matcher, words

    def describe(self, rgb: np.ndarray, valid: np.ndarray | None) -> dict[str, np.ndarray]:
        return {}

    def learn(self, descriptions: Sequence[Description]) -> tuple[Pool, np.ndarray]:
        local = [self._local(description) for description in descriptions]
        vlad = Vlad([features for views in local for features in views], self._words)

        def pool(description: Description) -> np.ndarray:
            return vlad.pool_all(self._local(description))

        return pool, np.stack([vlad.pool_all(views) for views in local])

    def _local(self, description: Description) -> list[np.ndarray]:
        return [self._matcher.describe(view) for view in split_views(description)]


class NetworkDescriptors:
    """Global descriptors by an image network, pooled by the generalised mean (Radenovic et al. 2019)."""

    def __init__(self, network: Any, views: int, hfov_rad: float) -> None:
        """Use a network of the role `image-network`, with as many views as the matcher has."""
        self._network, self._rig = network, ViewRig(views, network.size_px, network.size_px, hfov_rad)

    def describe(self, rgb: np.ndarray, valid: np.ndarray | None) -> dict[str, np.ndarray]:
        """Return `global` (V, C) float16, a unit vector per view; zeros if less than half of its pixels are valid."""
        unit = self._network.descriptors(self._rig.cut(rgb), POWER)
        if valid is not None:
            unit[self._rig.cut(valid.astype(np.uint8)).mean((1, 2)) < 0.5] = 0
        return {"global": unit.astype(np.float16)}

    def learn(self, descriptions: Sequence[Description]) -> tuple[Pool, np.ndarray]:
        return _stored, np.stack([_stored(description) for description in descriptions])


def _stored(description: Description) -> np.ndarray:
    return description["global"].astype(np.float32)


def split_views(description: Description) -> list[ViewFeatures]:
    """Return the views in a description of `keypoints`.

    Raises:
        DataError: The numbers of points or features per view do not add up to the number of rows in the description.
    """
    points, features = (
        _split(description, *names) for names in (("points_px", "point_count"), ("features", "feature_count"))
    )
    return [ViewFeatures(*parts) for parts in zip(points, features, strict=True)]


def _split(description: Description, rows_name: str, counts_name: str) -> list[np.ndarray]:
    rows, counts = description[rows_name], description[counts_name]
    if (counts < 0).any() or counts.sum() != len(rows):
        raise DataError(
            f"the array {counts_name} of the map is {counts.tolist()}, expected counts whose sum is {len(rows)}, the "
            f"number of rows of the array {rows_name}: build the map again"
        )
    return np.split(rows, np.cumsum(counts)[:-1])


class Vlad:
    """VLAD (Jegou et al. 2010) with residuals normalised per word and globally (Arandjelovic and Zisserman 2013)."""

    def __init__(self, features: Sequence[np.ndarray], words: int) -> None:
        """Learn `words` by k-means from a seeded random sample of the views' local features, each (N, D) float32."""
        from scipy.cluster.vq import kmeans2

        stacked = np.concatenate(features)
        rng = np.random.default_rng(0)
        sample = stacked[np.sort(rng.permutation(len(stacked))[:SAMPLE])]
        start = sample[np.sort(rng.permutation(len(sample))[:words])]
        self.words = start
        if len(sample) > words:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "One of the clusters is empty")  # its word stays where it is
                self.words = kmeans2(sample, start, iter=ITERATIONS, minit="matrix", missing="warn")[0]

    def pool(self, features: np.ndarray) -> np.ndarray:
        """Return (words * D,) float32 of unit length for local features (N, D), zeros if there are none."""
        pooled = np.zeros_like(self.words)
        if len(features) and len(self.words):
            word = (features @ self.words.T - (self.words**2).sum(1) / 2).argmax(1)
            np.add.at(pooled, word, features - self.words[word])
            pooled /= np.maximum(np.linalg.norm(pooled, axis=1, keepdims=True), 1e-9)
        return pooled.ravel() / max(np.linalg.norm(pooled), 1e-9)

    def pool_all(self, views: Sequence[np.ndarray]) -> np.ndarray:
        """Return (V, words * D) float32, the pooled local features of each view."""
        return np.stack([self.pool(features) for features in views])
