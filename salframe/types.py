"""The values that pass between stages: frozen, checked at construction, arrays named with units and frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from salframe.errors import DataError
from salframe.geometry import wrap_angle


def _array(owner: object, name: str, dtype: type, *shape: int | None) -> np.ndarray:
    """Bring a field to a read-only array of this dtype and shape (None: any length), or say what is wrong with it."""
    value = np.asarray(getattr(owner, name))
    fits = value.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, value.shape, strict=False))
    if not fits:
        want = "(" + ", ".join("*" if n is None else str(n) for n in shape) + ")"
        raise DataError(f"{type(owner).__name__}.{name} has shape {value.shape}, expected {want}")
    if not np.can_cast(value.dtype, dtype, "same_kind"):
        raise DataError(f"{type(owner).__name__}.{name} has dtype {value.dtype}, expected {np.dtype(dtype)}")
    value = value.astype(dtype, copy=False).view()
    value.flags.writeable = False
    object.__setattr__(owner, name, value)
    return value


@dataclass(frozen=True, eq=False)
class Detections:
    """Objects seen in one panorama, in the panorama frame.

    labels: N names; scores (N,) float64 in [0, 1]; centroid_m, size_m (N, 3) float64, the centroid and the length, width, height
    of the upright box; yaw_rad (N,) float64, azimuth of the box's length, modulo pi; points_m: N arrays (n_i, 3) float32 behind the masks,
    or None where only boxes are known. A centroid whose range is not known is NaN.
    """

    labels: tuple[str, ...]
    scores: np.ndarray
    centroid_m: np.ndarray
    size_m: np.ndarray
    yaw_rad: np.ndarray
    points_m: tuple[np.ndarray, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", tuple(self.labels))
        n = len(self.labels)
        scores = _array(self, "scores", np.float64, n)
        outside = scores[~((scores >= 0) & (scores <= 1))]
        if len(outside):
            raise DataError(f"Detections.scores holds {outside[0]}, expected numbers from 0 to 1")
        _array(self, "centroid_m", np.float64, n, 3)
        _array(self, "size_m", np.float64, n, 3)
        _array(self, "yaw_rad", np.float64, n)
        if self.points_m is not None and len(self.points_m) != n:
            raise DataError(f"Detections.points_m holds {len(self.points_m)} point sets, expected {n}")

    def __len__(self) -> int:
        return len(self.labels)

    def take(self, index) -> Detections:
        """The detections at these positions, in this order."""
        index = np.asarray(index, int)
        points = None if self.points_m is None else tuple(self.points_m[i] for i in index)
        return Detections(
            tuple(self.labels[i] for i in index),
            self.scores[index], self.centroid_m[index], self.size_m[index], self.yaw_rad[index], points,
        )

    @classmethod
    def empty(cls) -> Detections:
        return cls((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


@dataclass(frozen=True, eq=False)
class Annotations:
    """What a labelled data set tells about a panorama: an instance image with its label table, or a list of objects.

    instance_id (H, 2H) int32, 0 where there is no object; labels: instance id -> label. `objects` instead, where there is no image:
    one detection an object, and `keys`, N strings that stay with an object when the panorama is turned (they key noise, nothing else).
    `rendered`: labels and ranges come from a renderer and hold no error of their own.
    """

    instance_id: np.ndarray | None = None
    labels: Mapping[int, str] = field(default_factory=dict)
    objects: Detections | None = None
    keys: tuple[str, ...] = ()
    rendered: bool = False

    def __post_init__(self) -> None:
        if (self.instance_id is None) == (self.objects is None):
            raise DataError("Annotations take either an instance image or a list of objects, received both or neither")
        if self.instance_id is not None:
            _array(self, "instance_id", np.int32, None, None)
        if self.objects is not None and len(self.keys) != len(self.objects):
            raise DataError(f"Annotations.keys holds {len(self.keys)} keys, expected {len(self.objects)}, one an object")


@dataclass(frozen=True, eq=False)
class Panorama:
    """An equirectangular RGB-D panorama; any part may be missing, and `provides` says what is there.

    rgb (H, 2H, 3) uint8; range_m (H, 2H) float32, range along the ray, NaN where unknown; valid (H, 2H) bool, the part of the sphere
    that was seen (None: all of it). `id` names the frame it was taken in. Raises DataError on images that do not fit together.
    """

    id: str
    rgb: np.ndarray | None = None
    range_m: np.ndarray | None = None
    valid: np.ndarray | None = None
    annotations: Annotations | None = None

    def __post_init__(self) -> None:
        height = None
        instance_id = None if self.annotations is None else self.annotations.instance_id
        for name, image in (("rgb", self.rgb), ("range", self.range_m), ("valid", self.valid), ("instance", instance_id)):
            if image is None:
                continue
            shape = np.shape(image)
            if len(shape) < 2 or shape[1] != 2 * shape[0]:
                raise DataError(f"{self.id}: the {name} image is {' x '.join(map(str, shape[1::-1]))}, expected a width of twice the height")
            if height is not None and shape[0] != height:
                raise DataError(f"{self.id}: the {name} image is {shape[1]} x {shape[0]}, expected {2 * height} x {height} as the others")
            height = shape[0]
        if self.rgb is not None:
            _array(self, "rgb", np.uint8, None, None, 3)
        if self.range_m is not None:
            _array(self, "range_m", np.float32, None, None)
        if self.valid is not None:
            _array(self, "valid", np.bool_, None, None)

    @property
    def provides(self) -> frozenset[str]:
        """Which of "rgb", "range", "annotations" are there."""
        parts = {"rgb": self.rgb, "range": self.range_m, "annotations": self.annotations}
        return frozenset(name for name, value in parts.items() if value is not None)


@dataclass(frozen=True, eq=False)
class MapFrame:
    """Where a mapping frame stands: its id, its place, T_world_pano (4, 4) float64; `kind` "scene" for a place's own, "transition" in a doorway."""

    id: str
    place: str
    T_world_pano: np.ndarray
    kind: str = "scene"


@dataclass(frozen=True, eq=False)
class Frame:
    """A panorama on demand, where it was taken, and the place it belongs to.

    Mapping frames have `T_world_pano` (4, 4) float64, `place` and `kind` ("scene" or "transition"); the frames of queries have none of them.
    """

    id: str
    load: Callable[[], Panorama]
    T_world_pano: np.ndarray | None = None
    place: str | None = None
    kind: str = "scene"

    def mapped(self) -> MapFrame:
        """The frame's place and pose. Raises DataError where it has none."""
        if self.T_world_pano is None or self.place is None:
            raise DataError(f"{self.id} has no pose and place, expected a mapping frame")
        return MapFrame(self.id, self.place, self.T_world_pano, self.kind)


@dataclass(frozen=True)
class Truth:
    """What only the evaluator sees of a query: pose (4, 4) or None, place, ids of the visible instances."""

    place: str
    T_world_pano: np.ndarray | None = None
    instances: tuple[int, ...] = ()


@dataclass(frozen=True)
class Fold:
    """One map and the queries asked of it."""

    id: str
    mapping: tuple[Frame, ...]
    queries: tuple[Frame, ...]


@dataclass(frozen=True, eq=False)
class FloorMasks:
    """A floor seen from above. Row 0 is at the largest y, so that the picture reads like a map.

    free, region (rows, columns): bool free floor before obstacles, int32 region label (0 outside); obstacle bool. Pixel (row, column) covers
    x = origin_m[0] + column * resolution_m, y = origin_m[1] - row * resolution_m at its upper left corner. regions: label -> place.
    z_m is the floor's height in the world: a frame belongs to the highest floor below it. Raises DataError on masks of different sizes.
    """

    free: np.ndarray
    region: np.ndarray
    obstacle: np.ndarray
    resolution_m: float
    origin_m: tuple[float, float]
    regions: Mapping[int, str]
    z_m: float = 0.0

    def __post_init__(self) -> None:
        shape = _array(self, "free", np.bool_, None, None).shape
        for name, dtype in (("region", np.int32), ("obstacle", np.bool_)):
            got = _array(self, name, dtype, None, None).shape
            if got != shape:
                raise DataError(f"the {name} mask of a floor is {got[1]} x {got[0]} pixels, expected {shape[1]} x {shape[0]} as its free mask")
        if not self.resolution_m > 0:
            raise DataError(f"the masks of a floor have a resolution of {self.resolution_m} m a pixel, expected more than 0")


@dataclass(frozen=True, eq=False)
class SaliencyGraph:
    """A place as a 360-degree saliency graph (method.md 2): salient objects and the context between them.

    labels: N names; scores (N,) float64 in [0, 1], the detector's; saliency (N,) float64, shares of volume; centroid_m, size_m (N, 3) and
    yaw_rad (N,) float64 in the panorama frame; edges (E, 2) int64 with edges[:, 0] < edges[:, 1].
    """

    labels: tuple[str, ...]
    scores: np.ndarray
    saliency: np.ndarray
    centroid_m: np.ndarray
    size_m: np.ndarray
    yaw_rad: np.ndarray
    edges: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", tuple(self.labels))
        n = len(self.labels)
        _array(self, "scores", np.float64, n)
        _array(self, "saliency", np.float64, n)
        _array(self, "centroid_m", np.float64, n, 3)
        _array(self, "size_m", np.float64, n, 3)
        _array(self, "yaw_rad", np.float64, n)
        edges = _array(self, "edges", np.int64, None, 2)
        if len(edges) and not (edges[:, 0].min() >= 0 and (edges[:, 0] < edges[:, 1]).all() and edges[:, 1].max() < n):
            raise DataError(f"SaliencyGraph.edges must be pairs a < b of nodes below {n}")

    def __len__(self) -> int:
        return len(self.labels)

    @cached_property
    def azimuth_rad(self) -> np.ndarray:
        """(N,) azimuth of the centroids, counter-clockwise from +x."""
        return np.arctan2(self.centroid_m[:, 1], self.centroid_m[:, 0])

    @cached_property
    def polar_rad(self) -> np.ndarray:
        """(N,) angle of the centroids from +z (the paper's phi)."""
        return np.arctan2(np.hypot(self.centroid_m[:, 0], self.centroid_m[:, 1]), self.centroid_m[:, 2])

    @cached_property
    def range_m(self) -> np.ndarray:
        """(N,) distance of the centroids."""
        return np.linalg.norm(self.centroid_m, axis=1)

    @cached_property
    def weights(self) -> np.ndarray:
        """(E,) edge weights w_ab = sqrt(S_a S_b)."""
        return np.sqrt(self.saliency[self.edges[:, 0]] * self.saliency[self.edges[:, 1]])

    @cached_property
    def adjacency(self) -> np.ndarray:
        """(N, N) bool, symmetric."""
        matrix = np.zeros((len(self), len(self)), bool)
        matrix[self.edges[:, 0], self.edges[:, 1]] = matrix[self.edges[:, 1], self.edges[:, 0]] = True
        return matrix


@dataclass(frozen=True)
class GraphMatch:
    """A map graph's claim to be the query's place: index of the scene, score (larger is better), pairs (M, 2) int64 of query and map nodes.

    Matchers that verify geometry give the pose that did: T_scene_query (4, 4), the query's frame in the map frame's, or None.
    """

    scene: int
    score: float
    pairs: np.ndarray
    T_scene_query: np.ndarray | None = None


@dataclass(frozen=True)
class PoseEstimate:
    """The query's frame in the reference frame.

    T_reference_query (4, 4) or None where `status` is not "ok" ("too-few", "degenerate", "ambiguous", "inconsistent"); covariance (3, 3) of
    (x_m, y_m, yaw_rad) for SE(2), (6, 6) for SE(3), or None; inliers (M,) bool over the given pairs; `runner_up` the support of the next
    best pose divided by that of this one, in [0, 1].
    """

    T_reference_query: np.ndarray | None
    status: str
    covariance: np.ndarray | None
    inliers: np.ndarray
    runner_up: float = 0.0


@dataclass(frozen=True)
class RankedPlace:
    """One answer of a localizer: the map frame, its place, and a score (larger is better)."""

    frame: str
    place: str
    score: float


@dataclass(frozen=True)
class Localization:
    """A localizer's answer. `status` is "ok" or says why not ("no-objects", "low-score", "no-pose", ...); `places` best first, one entry a place;
    T_world_query (4, 4) or None; covariance as in PoseEstimate, in the map frame's axes.

    "no-pose" keeps its places: the place counts, the pose does not. Every other status than "ok" is a failure.
    """

    places: tuple[RankedPlace, ...]
    T_world_query: np.ndarray | None
    status: str
    covariance: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class PointMatches:
    """Points that two panoramas show alike: query, reference (M, 3) float64 unit bearings, each in its own panorama frame, a row a match."""

    query: np.ndarray
    reference: np.ndarray

    def __post_init__(self) -> None:
        count = len(_array(self, "query", np.float64, None, 3))
        _array(self, "reference", np.float64, count, 3)


@dataclass(frozen=True, eq=False)
class NodeMatches:
    """Objects that two panoramas show alike: pairs (M, 2) int64 of positions in query_m (N, 3) and reference_m (K, 3), each used at most once.

    These are float64, the centroids of all objects, each in its own panorama frame.
    """

    query_m: np.ndarray
    reference_m: np.ndarray
    pairs: np.ndarray

    def __post_init__(self) -> None:
        counts = [len(_array(self, name, np.float64, None, 3)) for name in ("query_m", "reference_m")]
        pairs = _array(self, "pairs", np.int64, None, 2)
        if len(pairs) and not (pairs.min() >= 0 and (pairs < counts).all() and all(len(np.unique(side)) == len(side) for side in pairs.T)):
            raise DataError(f"NodeMatches.pairs must use each of {counts[0]} query and {counts[1]} reference nodes at most once")


@dataclass(frozen=True)
class MapNode:
    """A node of the topological map: kind "scene" or "transition", xyz_m on the floor in the world, its region(s), the mapping frames taken there."""

    id: str
    kind: str
    xyz_m: tuple[float, float, float]
    regions: tuple[str, ...]
    frames: tuple[str, ...] = ()


@dataclass(frozen=True)
class MapEdge:
    """An edge walked either way; azimuth_rad of the straight line from `start` to `end` in the world frame.

    path_m: the corners (x, y) of the way from `start` to `end`, both included, where it is no straight line; else empty.
    """

    start: str
    end: str
    length_m: float
    azimuth_rad: float
    path_m: tuple[tuple[float, float], ...] = ()

    def reversed(self) -> MapEdge:
        """The edge walked from `end` to `start`."""
        azimuth_rad = float(wrap_angle(self.azimuth_rad + np.pi))
        return MapEdge(self.end, self.start, self.length_m, azimuth_rad, self.path_m[::-1])


@dataclass(frozen=True)
class TopologicalMap:
    """Scene and transition nodes and the edges between them (method.md 1), each edge once.

    floors: the masks it was made from; parameters: what it was made with, by name; notes: what its reader must know (regions out of reach,
    edges that sight alone did not give, frames moved or left out), a line each.
    """

    nodes: tuple[MapNode, ...]
    edges: tuple[MapEdge, ...]
    floors: tuple[FloorMasks, ...] = field(default=(), compare=False)
    parameters: Mapping[str, float | bool] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Route:
    """A shortest route: nodes in order, one leg from each to the next as it is walked, total length_m."""

    nodes: tuple[str, ...]
    legs: tuple[MapEdge, ...]
    length_m: float
