"""Panoramas merged into places, against weighted means worked out by hand."""

import numpy as np
import pytest
from salframe_graphs.places.merging import gather_places
from salframe_graphs.places.rates import Rates, shipped_rates

from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.frames import FrameKind, ReferenceFrame
from salframe.panoramas.geometry import invert_pose, pose_2d, transform_points

RATES: Rates = shipped_rates().model_copy(update={"position_error_m": 0.1, "range_error_share": 0.1})


def graph(labels, world_m, T_world_pano, saliency=None, size_m=1.0):
    n = len(labels)
    seen = transform_points(invert_pose(T_world_pano), np.reshape(world_m, (n, 3)).astype(float))
    share = np.full(n, 1 / max(n, 1)) if saliency is None else np.array(saliency)
    return SaliencyGraph(
        labels, np.ones(n), share, seen, np.full((n, 3), size_m), np.zeros(n), np.zeros((0, 2), np.int64)
    )


def gather(seen, kinds=None, place_of=None, merged=True):
    """Places of (place, pose, labels, positions in the world) for each panorama."""
    frames = [
        ReferenceFrame(f"f{i}", place, pose, FrameKind.SCENE if kinds is None else kinds[i])
        for i, (place, pose, _, _) in enumerate(seen)
    ]
    graphs = [graph(labels, points, pose) for _, pose, labels, points in seen]
    return gather_places(graphs, frames, RATES, place_of, merged)


def test_two_sightings_become_their_weighted_mean():
    near, far = pose_2d(1, 0, 0.7), pose_2d(-3, 0, -2.0)
    (place,) = gather([("a", near, ["bed"], [[2, 0, 0.3]]), ("a", far, ["bed"], [[2.3, 0, 0.5]])])
    variance = np.array([0.1**2 + 0.1**2 * 1.0**2, 0.1**2 + 0.1**2 * 5.3**2])  # 1 m and 5.3 m away
    weight = 1 / variance
    expected = (weight[0] * np.array([2, 0, 0.3]) + weight[1] * np.array([2.3, 0, 0.5])) / weight.sum()
    np.testing.assert_allclose(place.centroid_m, [expected], atol=1e-12)
    np.testing.assert_allclose(place.variance_m2, [1 / weight.sum()])
    assert (place.labels, place.sightings.tolist()) == (("bed",), [2.0])


def test_what_is_too_far_apart_or_called_otherwise_stays_two():
    here, there = pose_2d(0, 0, 0), pose_2d(4, 0, 0)
    (apart,) = gather([("a", here, ["bed"], [[1, 0, 0]]), ("a", there, ["bed"], [[3, 0, 0]])])
    assert apart.sightings.tolist() == [1, 1]
    (named,) = gather([("a", here, ["bed"], [[2, 0, 0]]), ("a", there, ["sofa"], [[2, 0, 0]])])
    assert sorted(named.labels) == ["bed", "sofa"]
    (twice,) = gather([("a", here, ["chair", "chair"], [[1, 0, 0], [1.05, 0, 0]])])
    assert twice.sightings.tolist() == [1, 1]  # one panorama sees an object once


def test_a_doorway_feeds_the_places_its_objects_lie_in():
    kinds = [FrameKind.SCENE, FrameKind.SCENE, FrameKind.TRANSITION]
    seen = [
        ("a", pose_2d(-2, 0, 0), ["bed"], [[-3, 0, 0]]),
        ("b", pose_2d(2, 0, 0), ["sofa"], [[3, 0, 0]]),
        ("door", pose_2d(0, 0, 0), ["bed", "sofa", "lamp"], [[-3, 0, 0], [3, 0, 0], [0, 9, 0]]),
    ]

    def place_of(xy_m, frame):
        return [None if y > 5 else "a" if x < 0 else "b" for x, y in xy_m]

    a, b = gather(seen, kinds, place_of)
    assert (a.name, a.labels, a.sightings.tolist()) == ("a", ("bed",), [2])
    assert (b.name, b.labels, b.sightings.tolist()) == ("b", ("sofa",), [2])
    assert [place.sightings.tolist() for place in gather(seen, kinds)] == [[1], [1]]  # regions are not known


def test_a_map_of_doorways_has_their_places():
    places = gather([("door", pose_2d(0, 0, 0), ["bed"], [[1, 0, 0]])], [FrameKind.TRANSITION])
    assert [place.name for place in places] == ["door"]


def test_unmerged_each_scene_frame_is_a_place():
    seen = [("a", pose_2d(x, 0, 0), ["bed"], [[2, 0, 0]]) for x in (0, 1)]
    assert [(place.name, place.frames) for place in gather(seen, merged=False)] == [("a", (0,)), ("a", (1,))]


def test_saliency_and_size_are_means_of_logarithms():
    frames = [ReferenceFrame(str(i), "a", np.eye(4)) for i in range(2)]
    graphs = [
        graph(["bed", "lamp"], [[2, 0, 0], [0, 3, 0]], np.eye(4), saliency=[0.8, 0.2], size_m=1.0),
        graph(["bed", "lamp"], [[2, 0, 0], [0, 3, 0]], np.eye(4), saliency=[0.5, 0.5], size_m=np.e),
    ]
    (place,) = gather_places(graphs, frames, RATES)
    saliency = dict(zip(place.labels, place.log_saliency, strict=True))
    assert saliency == pytest.approx({"bed": np.log(1.6) / 2, "lamp": np.log(0.4) / 2})
    np.testing.assert_allclose(place.log_size, 0.5)
