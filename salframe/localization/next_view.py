"""The next view of a camera that was not localized: the view that is expected to tell the likely places apart best."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from salframe.graphs.packing import graph_from_arrays
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw, transform_points, wrap_angle

TURNS_DEG = (30.0, -30.0, 60.0, -60.0, 90.0, -90.0, 120.0, -120.0, 150.0, -150.0, 180.0)
"""Turns that are compared, in degrees, positive to the left."""
ENTROPY_DIGITS = 6
"""Number of decimals to which expected entropies are compared."""
MAX_PLACES = 10
"""Maximum number of places to tell apart, the most probable ones."""
MAX_FRAMES = 200
"""Maximum number of reference frames from which the objects outside the map are estimated."""
DIRECTION_ERROR_RAD = np.radians(20)
"""Standard deviation of the expected direction of an object, which accounts for the error of the pose in a place."""
HALF_DETECTED_M, DETECTION_SLOPE = 2.3, 1.5
"""Distance from which half of the objects are detected, and the decrease of the log-odds of detection per unit of
ln(distance). They are the shipped rates of `saliency-places`."""
CLUTTER = 0.002
"""Expected number of false positives with each label in each direction bin."""

Reference = Callable[[str], tuple[ReferenceFrame, Mapping[str, np.ndarray]]]
"""Returns a reference frame and its description by id."""


@dataclass(frozen=True, eq=False)
class PlacePoses:
    """The most probable pose of a query in each place, and the directions that its views show.

    Attributes:
        T_world_query: The pose (4, 4) in each place, by name; places without a pose are missing.
        camera: (B,) bool, whether the last view shows each azimuth bin. The bins have equal widths and start at the x
            axis of the query, counter-clockwise.
        shown: (B,) bool, whether any view of the query shows each azimuth bin.
    """

    T_world_query: Mapping[str, np.ndarray]
    camera: np.ndarray
    shown: np.ndarray


@dataclass(frozen=True)
class NextView:
    """A proposed motion, after which the camera takes its next view.

    Attributes:
        turn_deg: Turn in degrees, positive to the left.
        expected_entropy: Upper bound of the expected entropy of the place after the view, in nats.
        entropy: Entropy of the place before the view, in nats.
        node: Node of the topology to walk to after the turn; None to stay.
        length_m: Length of the walk in metres.
    """

    turn_deg: float
    expected_entropy: float
    entropy: float
    node: str | None = None
    length_m: float = 0.0

    def __str__(self) -> str:
        turn_deg = round(self.turn_deg)
        parts = [f"turn {'left' if turn_deg > 0 else 'right'} {abs(turn_deg)} deg"] if turn_deg else []
        if self.node is not None:
            parts.append(f"walk {self.length_m:.1f} m to {self.node}")
        return " and ".join(parts)


class ViewPredictor:
    """Predicts which objects a camera would see after a motion, in each likely place of a query.

    The hypotheses are the most probable places, at most MAX_PLACES, and, if it has a probability, that the query is out
    of the map. A view is a number of detected objects for each label and azimuth bin, with Poisson distributions.
    Objects that the query has shown already are left out, unless another reference frame shows them. In a place without
    a pose, all directions are equally probable for each object. Out of the map, the objects are those of an average
    reference frame.
    """

    def __init__(
        self,
        probabilities: Mapping[str, float | None],
        frame_ids: Mapping[str, str],
        out_of_map_probability: float | None,
        poses: PlacePoses,
        frames: Sequence[ReferenceFrame],
        reference: Reference,
    ) -> None:
        """Create a predictor.

        Args:
            probabilities: The probability of each place by name, best first; None: unknown, equal for all places.
            frame_ids: The id of the reference frame nearest to the pose in each place.
            out_of_map_probability: Probability that the query is in no place; None: unknown.
            poses: The poses.
            frames: The reference frames of the map.
            reference: Returns a reference frame, whose description is a graph, by its id.
        """
        self._poses, self._frames, self._reference = poses, frames, reference
        names = list(probabilities)[:MAX_PLACES]
        self._hypotheses = [(frame_ids[name], poses.T_world_query.get(name)) for name in names]
        shares = [1.0 if (share := probabilities[name]) is None else share for name in names]
        self._may_be_outside = out_of_map_probability is not None
        weights = np.array(shares if out_of_map_probability is None else [*shares, out_of_map_probability])
        self._probability = weights / max(weights.sum(), np.finfo(float).tiny)
        self._labels: dict[str, int] = {}
        self._objects: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    @property
    def entropy(self) -> float:
        """Entropy of the hypotheses in nats."""
        positive = self._probability[self._probability > 0]
        return float(-(positive * np.log(positive)).sum())

    def turn(self) -> NextView | None:
        """Return the turn on the spot with the smallest expected entropy; None if there are no hypotheses to compare,
        or the camera has shown all directions. Of equal turns, the smallest is returned."""
        if len(self._probability) < 2 or self._poses.shown.all():
            return None
        views = [
            NextView(turn_deg, self.expected_entropy(pose_2d(0, 0, np.radians(turn_deg))), self.entropy)
            for turn_deg in TURNS_DEG
        ]
        return best_view(views)

    def expected_entropy(self, T_query_next: np.ndarray) -> float:
        """Return an upper bound of the expected entropy of the hypotheses after the view from another pose, in nats.

        It follows from the lower bound of the entropy of a mixture by Kolchinsky and Tracey (Entropy 19:361, 2017,
        Eq. 10) with the Bhattacharyya distance, which is sum (sqrt(a) - sqrt(b))^2 / 2 for Poisson rates a and b.

        Args:
            T_query_next: (4, 4) upright pose of the camera at the next view, in the frame of the query.
        """
        views = [self._rates(frame_id, pose, T_query_next) for frame_id, pose in self._hypotheses]
        if self._may_be_outside:
            views.append(self._average_rates(T_query_next))
        rates = np.zeros((len(views), len(self._labels), len(self._poses.camera)))
        for number, (labels, values) in enumerate(views):
            np.add.at(rates[number], labels, values)
        root = np.sqrt(rates[:, :, self._poses.camera].reshape(len(views), -1) + CLUTTER)
        squared = (root * root).sum(1)
        distance = np.maximum(squared[:, None] + squared - 2 * root @ root.T, 0) / 2
        mixed = np.exp(-distance) @ self._probability
        has_share = self._probability > 0
        information = -(self._probability[has_share] * np.log(mixed[has_share])).sum()
        return max(self.entropy - float(information), 0.0)

    def _rates(
        self, frame_id: str, T_world_query: np.ndarray | None, T_query_next: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return labels (N,) and expected detections (N, B) in a place, as seen from the next pose.

        The objects are those of the frame, or, after a walk, of the frame that is nearest to the next pose.
        """
        if T_world_query is None:
            labels, expected = self._frame_objects(frame_id)
            return labels, self._in_new_directions(expected, T_query_next)
        T_world_next = T_world_query @ T_query_next
        next_id = self._nearest(T_world_next[:3, 3]) if _is_walk(T_query_next) else frame_id
        labels, scores, xyz_m = self._world_objects(next_id)
        is_new = np.ones(len(labels), bool)
        if next_id == frame_id:
            is_new = ~self._poses.shown[_bins(_directions(xyz_m, T_world_query)[0], len(self._poses.shown))]
        azimuth_rad, distance_m = _directions(xyz_m[is_new], T_world_next)
        expected = scores[is_new] * _detected(distance_m)
        return labels[is_new], expected[:, None] * _spread(azimuth_rad, len(self._poses.shown))

    def _average_rates(self, T_query_next: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return labels (N,) and expected detections (N, B) of the objects of an average scene frame."""
        labels, expected = self._average_objects
        return labels, self._in_new_directions(expected, T_query_next)

    def _in_new_directions(self, expected: np.ndarray, T_query_next: np.ndarray) -> np.ndarray:
        """Return expected detections (N, B) of N objects, each in any direction with equal probability. Without a walk,
        those in the directions that the query has shown are left out."""
        num_bins = len(self._poses.shown)
        is_shown = self._poses.shown[_bins(_middles(num_bins) + pose_yaw(T_query_next), num_bins)]
        is_new = ~is_shown | _is_walk(T_query_next)
        return expected[:, None] * is_new / num_bins

    @cached_property
    def _average_objects(self) -> tuple[np.ndarray, np.ndarray]:
        """Labels (N,) and expected detections (N,) of an average scene frame."""
        scenes = [frame.id for frame in self._frames if frame.kind is FrameKind.SCENE]
        chosen = scenes[:: -(-len(scenes) // MAX_FRAMES)] if scenes else []
        parts = [self._frame_objects(frame_id) for frame_id in chosen]
        labels = np.concatenate([np.zeros(0, int), *(labels for labels, _ in parts)])
        expected = np.concatenate([np.zeros(0), *(expected for _, expected in parts)])
        total = np.bincount(labels, expected, len(self._labels)) / max(len(chosen), 1)
        return np.arange(len(total)), total

    def _frame_objects(self, frame_id: str) -> tuple[np.ndarray, np.ndarray]:
        """Return label numbers (N,) and expected detections (N,) of the objects of a frame, from its own position."""
        labels, scores, xyz_m = self._world_objects(frame_id)
        distance_m = _directions(xyz_m, self._reference(frame_id)[0].T_world_pano)[1]
        return labels, scores * _detected(distance_m)

    def _world_objects(self, frame_id: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return label numbers (N,), scores (N,) and positions (N, 3) in the world of the objects of a frame."""
        if frame_id not in self._objects:
            frame, description = self._reference(frame_id)
            graph = graph_from_arrays(description)
            labels = np.array([self._labels.setdefault(label, len(self._labels)) for label in graph.labels], int)
            self._objects[frame_id] = labels, graph.scores, transform_points(frame.T_world_pano, graph.centroid_m)
        return self._objects[frame_id]

    def _nearest(self, position_m: np.ndarray) -> str:
        """Return the id of the reference frame that is nearest to a position (3,)."""
        positions_m = np.array([frame.T_world_pano[:3, 3] for frame in self._frames])
        return self._frames[int(np.linalg.norm(positions_m - position_m, axis=1).argmin())].id


def best_view(views: Iterable[NextView]) -> NextView | None:
    """Return the view with the smallest expected entropy, the first of equal ones; None if there are no views."""
    return min(views, key=lambda view: round(view.expected_entropy, ENTROPY_DIGITS), default=None)


def _is_walk(T_query_next: np.ndarray) -> bool:
    """Return whether a motion is more than a turn on the spot."""
    return bool(np.any(T_query_next[:3, 3]))


def _directions(xyz_m: np.ndarray, T_world_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return azimuths (N,) and horizontal distances (N,) of points (N, 3) from an upright camera."""
    x, y = (xyz_m - T_world_camera[:3, 3])[:, :2].T
    return np.arctan2(y, x) - pose_yaw(T_world_camera), np.hypot(x, y)


def _bins(azimuth_rad: np.ndarray, num_bins: int) -> np.ndarray:
    """Return the bins of azimuths (N,)."""
    return np.floor(azimuth_rad % (2 * np.pi) * num_bins / (2 * np.pi)).astype(int) % num_bins


def _middles(num_bins: int) -> np.ndarray:
    """Return the azimuths (B,) of the middles of the bins."""
    middles: np.ndarray = (np.arange(num_bins) + 0.5) * (2 * np.pi / num_bins)
    return middles


def _detected(distance_m: np.ndarray) -> np.ndarray:
    """Return the probability that a detector finds objects at distances (N,)."""
    return 1 / (1 + (distance_m / HALF_DETECTED_M) ** DETECTION_SLOPE)


def _spread(azimuth_rad: np.ndarray, num_bins: int) -> np.ndarray:
    """Return the distribution of objects with expected azimuths (N,) over the bins, (N, B)."""
    deviation = wrap_angle(azimuth_rad[:, None] - _middles(num_bins))
    spread: np.ndarray = np.exp(-0.5 * (deviation / DIRECTION_ERROR_RAD) ** 2)
    return spread / spread.sum(1, keepdims=True)
