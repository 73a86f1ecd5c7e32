"""The next view of a camera: the turn that shows what differs between the likely places."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm, poisson

from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import graph_to_arrays
from salframe.localization.answers import Localization, LocalizationStatus, ranked_places
from salframe.localization.next_view import (
    CLUTTER,
    DETECTION_SLOPE,
    DIRECTION_ERROR_RAD,
    HALF_DETECTED_M,
    PlacePoses,
    ViewPredictor,
)
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d

NUM_BINS = 72
MIDDLES_RAD = (np.arange(NUM_BINS) + 0.5) * (2 * np.pi / NUM_BINS)
AHEAD = np.cos(MIDDLES_RAD) > np.cos(np.pi / 4)
"""Bins that a camera of 90 degrees shows."""


def graph(objects: dict[str, tuple[float, float]]) -> dict[str, np.ndarray]:
    """The description of objects of 0.5 m at positions (x, y), detected with a score of 1."""
    n = len(objects)
    centroid_m = np.array([(x, y, 0.0) for x, y in objects.values()]).reshape(-1, 3)
    none = np.zeros((0, 2), np.int64)
    parts = np.ones(n), np.full(n, 1 / n), centroid_m, np.full((n, 3), 0.5), np.zeros(n), none
    return graph_to_arrays(SaliencyGraph(tuple(objects), *parts))


def predictor(
    rooms: dict[str, dict[str, tuple[float, float]]],
    shown: np.ndarray = AHEAD,
    outside: float | None = 0.0,
    poses: dict[str, np.ndarray] | None = None,
) -> ViewPredictor:
    """A query at the reference frame of each room, all rooms equally likely. Frames are 20 m apart."""
    frames = [ReferenceFrame(f"in {name}", name, pose_2d(20 * k, 0, 0)) for k, name in enumerate(rooms)]
    stored = {frame.id: (frame, graph(rooms[frame.place])) for frame in frames}
    at_frames = {frame.place: frame.T_world_pano for frame in frames}
    share = (1 - (outside or 0)) / len(rooms)
    return ViewPredictor(
        dict.fromkeys(rooms, share),
        {frame.place: frame.id for frame in frames},
        outside,
        PlacePoses(at_frames if poses is None else poses, AHEAD, shown),
        frames,
        stored.__getitem__,
    )


@pytest.mark.parametrize(("where", "turn_deg"), [((0, 2), 90), ((0, -2), -90), ((-2, 0), 180)])
def test_the_camera_turns_to_the_objects_that_differ(where, turn_deg):
    same = {"bed": (2, 0), "lamp": (0, 2), "door": (0, -2), "shelf": (-2, 0)}
    rooms = {"a": {**same, "bathtub": where}, "b": {**same, "oven": where}}
    view = predictor(rooms).turn()
    assert view.turn_deg == turn_deg
    assert view.entropy == pytest.approx(np.log(2))
    assert view.expected_entropy < 0.95 * np.log(2)
    assert str(view) == f"turn {'left' if turn_deg > 0 else 'right'} {abs(turn_deg)} deg"


def test_objects_that_were_seen_do_not_tell_places_apart():
    rooms = {"a": {"bathtub": (2, 0), "lamp": (-2, 0)}, "b": {"oven": (2, 0), "lamp": (-2, 0)}}
    both = predictor(rooms)
    for turn_deg in (-120, 30, 180):
        assert both.expected_entropy(pose_2d(0, 0, np.radians(turn_deg))) == pytest.approx(np.log(2))


def test_a_camera_that_shows_everything_does_not_turn():
    assert predictor({"a": {"oven": (-2, 0)}, "b": {"bed": (-2, 0)}}, np.ones(NUM_BINS, bool)).turn() is None
    assert predictor({"a": {"oven": (-2, 0)}}, outside=None).turn() is None  # nothing to tell apart


def rates(x: float, y: float) -> np.ndarray:
    """Expected detections in each bin of an object at (x, y), for a camera that looks along -x."""
    distance_m, azimuth_rad = np.hypot(x, y), np.arctan2(-y, -x)
    density = norm.pdf((MIDDLES_RAD - azimuth_rad + np.pi) % (2 * np.pi) - np.pi, scale=DIRECTION_ERROR_RAD)
    detected = 1 / (1 + np.exp(DETECTION_SLOPE * np.log(distance_m / HALF_DETECTED_M)))
    return (detected * density / density.sum())[AHEAD] + CLUTTER


def coefficient(a: np.ndarray, b: np.ndarray) -> float:
    """The Bhattacharyya coefficient of independent Poisson counts, summed over their values."""
    counts = np.arange(40)[:, None]
    return float(np.prod(np.sqrt(poisson.pmf(counts, a) * poisson.pmf(counts, b)).sum(0)))


def test_the_bound_is_that_of_the_poisson_counts_and_not_below_the_expected_entropy():
    at, elsewhere = (-1.5, 0.4), np.full(AHEAD.sum(), CLUTTER)
    both = predictor({"a": {"oven": at}, "b": {"bed": at}})
    bound = both.expected_entropy(pose_2d(0, 0, np.pi))
    overlap = coefficient(rates(*at), elsewhere) ** 2  # two labels
    assert bound == pytest.approx(np.log(2) + np.log((1 + overlap) / 2), rel=1e-6)
    rng = np.random.default_rng(0)
    views = {"a": np.array([rates(*at), elsewhere]), "b": np.array([elsewhere, rates(*at)])}
    entropies = []
    for view in views.values():
        counts = rng.poisson(view, (4000, *view.shape))
        logs = np.array([poisson.logpmf(counts, other).sum((1, 2)) for other in views.values()])
        share = np.exp(logs - np.logaddexp.reduce(logs))
        entropies.append(-(share * np.log(np.maximum(share, 1e-300))).sum(0).mean())
    assert np.mean(entropies) < bound < np.log(2)


def test_a_place_without_a_pose_and_the_outside_are_hypotheses():
    rooms = {"a": {"bed": (2, 0), "oven": (0, 2), "lamp": (0, 2.5)}, "b": {"bed": (2, 0)}}
    poses = {"a": pose_2d(0, 0, 0)}
    view = predictor(rooms, outside=0.5, poses=poses).turn()
    assert view.turn_deg == 90
    assert view.entropy == pytest.approx(0.5 * np.log(2) + 0.5 * np.log(4))
    nowhere = predictor(rooms, outside=0.5, poses={}).turn()  # no direction is known: the smallest turn past the view
    assert nowhere.turn_deg == 90


def test_a_walk_shows_the_objects_around_the_nearest_frame():
    rooms = {"a": {"bed": (2, 0)}, "b": {"bed": (2, 0)}, "c": {"oven": (2, 0)}, "d": {"sink": (2, 0)}}
    poses = {"a": pose_2d(0, 0, 0), "b": pose_2d(20, 0, 0)}
    everything = np.ones(NUM_BINS, bool)
    both = predictor(rooms, everything, poses=poses)
    before = both.expected_entropy(pose_2d(0, 0, np.pi / 2))
    assert both.expected_entropy(pose_2d(40, 0, 0)) < before  # a would see the oven, b the sink


def test_an_answer_returns_the_turn_of_its_predictor():
    places = ranked_places(["in a", "in b"], ["a", "b"], [1.0, 1.0], [0.5, 0.5])
    plain = Localization(places, None, LocalizationStatus.NO_POSE, out_of_map_probability=0.0)
    assert plain.next_view is None
    rooms = {"a": {"bathtub": (0, 2)}, "b": {"oven": (0, 2)}}
    answer = Localization(
        places,
        None,
        LocalizationStatus.NO_POSE,
        out_of_map_probability=0.0,
        predict_views=lambda answer: predictor(rooms),
    )
    assert answer.next_view.turn_deg == 90
    assert answer == plain
