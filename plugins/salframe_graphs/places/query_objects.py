"""The objects of a query for matching with the places of a map: with range, or with a bearing only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from salframe.graphs.graph import SaliencyGraph


@dataclass(frozen=True, eq=False)
class QueryObjects:
    """N objects of a query, first those with range.

    Attributes:
        label: (N,) int64, indices of labels in a vocabulary, -1 for a label that is not in it.
        scores: (N,) float64, confidence scores of the detector.
        centroid_m: (N, 3) float64, in the query frame, NaN where the range is unknown.
        size_m: (N, 3) float64, length, width and height, NaN where the range is unknown.
        bearing: (N, 3) float64, unit vectors from the origins to the objects.
        solid_angle_sr: (N,) float64, solid angle of each object, NaN where it is unknown.
        origin_m: (N, 3) float64, position of the camera that saw each object, in the query frame.
    """

    label: np.ndarray
    scores: np.ndarray
    centroid_m: np.ndarray
    size_m: np.ndarray
    bearing: np.ndarray
    solid_angle_sr: np.ndarray
    origin_m: np.ndarray

    @classmethod
    def of(cls, graph: SaliencyGraph, vocabulary: Mapping[str, int]) -> QueryObjects:
        """Return the objects of a graph, with labels numbered by a vocabulary."""
        label = np.array([vocabulary.get(name, -1) for name in graph.labels], np.int64)
        columns = (graph.scores, graph.centroid_m, graph.size_m, graph.bearing, graph.solid_angle_sr, graph.origin_m)
        objects = cls(label, *columns)
        has_range = np.isfinite(graph.centroid_m).all(1)
        return objects if has_range.all() else objects.take(np.argsort(~has_range, kind="stable"))

    def __len__(self) -> int:
        return len(self.label)

    @cached_property
    def num_ranged(self) -> int:
        """Number of objects with range."""
        return int(np.isfinite(self.centroid_m).all(1).sum())

    @property
    def ranged(self) -> QueryObjects:
        """The objects with range."""
        return self if self.num_ranged == len(self) else self.take(slice(self.num_ranged))

    @property
    def bearings(self) -> QueryObjects:
        """The objects without range."""
        return self.take(slice(self.num_ranged, None))

    def take(self, rows: np.ndarray | slice) -> QueryObjects:
        """Return the objects with the indices `rows`."""
        return QueryObjects(*(getattr(self, name)[rows] for name in QueryObjects.__dataclass_fields__))
