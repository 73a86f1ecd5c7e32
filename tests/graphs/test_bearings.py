"""Verification from directions: made rooms are found with their poses, and mirrored ones are not taken for them."""

import numpy as np
import pytest
from salframe_graphs.bearings import verify_bearings
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_graphs.node_pairs import NodePairs
from salframe_graphs.triplet import TripletMatcher

from salframe.framework.errors import InputMissing
from salframe.graphs.annotated import annotated_detections
from salframe.graphs.boxes import detections_where_known
from salframe.graphs.detections import Detections
from salframe.graphs.graph import GraphConfig, build_graph
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors, pose_yaw, transform_points, wrap_angle
from salframe.testing.rooms import ROOMS, look, map_frames, query_frames, query_truths, stand

TOLERANCE = 0.3, 0.05


def rooms(count, nodes=6):
    rng = np.random.default_rng(count)
    return np.concatenate([rng.uniform(-3, 3, (count, nodes, 2)), rng.uniform(-1.3, 0.9, (count, nodes, 1))], 2)


def directions(T_map_query, points_m):
    seen = transform_points(invert_pose(T_map_query), points_m)
    return seen / np.linalg.norm(seen, axis=-1, keepdims=True)


def verified(bearing, map_m, similarity, max_shift_m):
    """Poses (K, 4, 4) and kernels (K, n, m) of graphs of m nodes, map_m (K, m, 3), similarity (K, n, m)."""
    graph, query, node = np.nonzero(similarity)
    pairs = NodePairs(query, graph * map_m.shape[1] + node, graph, len(map_m))
    value, weights = similarity[graph, query, node], np.ones(len(bearing))
    found = verify_bearings(bearing, map_m.reshape(-1, 3), pairs, value, weights, TOLERANCE, max_shift_m)
    kernel = np.zeros(similarity.shape)
    kernel[graph, query, node] = found.kernel
    return found.poses(np.arange(len(map_m))), kernel


def test_the_pose_of_a_room_of_unlike_objects():
    map_m = rooms(20)
    for k in range(20):
        rng = np.random.default_rng((1, k))
        truth = pose_2d(*rng.uniform(-2, 2, 2), rng.uniform(-np.pi, np.pi))
        similarity = np.eye(6)[None].repeat(20, 0)
        poses, kernel = verified(directions(truth, map_m[k]), map_m, similarity, 6.0)
        support = kernel.max(2).sum(1)
        assert support.argmax() == k
        shift_m, turn_rad = pose_errors(poses[k], truth)
        assert shift_m < 0.15  # the grid's last step is 0.0625 m
        assert turn_rad < np.radians(5)
        assert support[k] > 0.9 * 6


@pytest.mark.parametrize("max_shift_m", [0.2, 0.6])
def test_where_the_map_frame_stands_is_always_tried(max_shift_m):
    map_m = rooms(1)
    poses, _ = verified(directions(pose_2d(0, 0, 1.0), map_m[0]), map_m, np.eye(6)[None], max_shift_m)
    shift_m, turn_rad = pose_errors(poses[0], pose_2d(0, 0, 1.0))
    assert (shift_m, turn_rad) == pytest.approx((0, 0), abs=1e-3)


def test_candidates_do_not_change_one_another():
    map_m, similarity = rooms(40), np.eye(6)[None].repeat(40, 0)
    bearing = directions(pose_2d(0.5, 0.7, 1.0), map_m[3])
    _, together = verified(bearing, map_m, similarity, 4.0)
    for k in (0, 17, 39):
        _, alone = verified(bearing, map_m[k : k + 1], similarity[:1], 4.0)
        np.testing.assert_array_equal(alone[0], together[k])


def test_alike_objects_are_told_apart_by_where_they_are():
    map_m = rooms(1)
    truth = pose_2d(-0.6, 1.1, 2.2)
    _, kernel = verified(directions(truth, map_m[0]), map_m, np.ones((1, 6, 6)), 6.0)
    assert kernel[0].argmax(1).tolist() == list(range(6))


def test_a_mirrored_room_explains_less():
    map_m = rooms(1)
    mirrored = map_m * (1, -1, 1)
    bearing = directions(pose_2d(0.3, 0.2, 0.5), map_m[0])
    both = np.concatenate([map_m, mirrored])
    _, kernel = verified(bearing, both, np.eye(6)[None].repeat(2, 0), 6.0)
    support = kernel.max(2).sum(1)
    assert support[1] < 0.7 * support[0]


def test_one_direction_makes_no_pose():
    poses, kernel = verified(directions(np.eye(4), rooms(1)[0, :1]), rooms(1)[:, :1], np.ones((1, 1, 1)), 6.0)
    assert np.isnan(poses[0]).all()
    assert not kernel.any()


def test_a_graph_without_range_has_bearings_and_shares_of_solid_angle():
    bearing = directions(np.eye(4), rooms(1)[0])
    found = detections_where_known("abcdef", np.ones(6), None, bearing, np.arange(1.0, 7))
    graph = build_graph(found, np.arange(1.0, 7) / 21, GraphConfig(top_k=5))
    assert graph.bearings_only
    assert graph.labels == tuple("fedcb")
    assert len(graph.edges) == 0
    np.testing.assert_array_equal(graph.bearing, bearing[[5, 4, 3, 2, 1]])
    back = graph_from_arrays(graph_to_arrays(graph))
    np.testing.assert_array_equal(back.bearing, graph.bearing)
    assert back.bearings_only


def test_nodes_without_range_are_left_out_beside_nodes_with():
    points_m = rooms(1)[0].copy()
    bearing = directions(np.eye(4), points_m)
    points_m[2] = np.nan
    found = Detections(list("abcdef"), np.ones(6), points_m, np.ones((6, 3)), np.zeros(6), bearing=bearing)
    graph = build_graph(found, np.full(6, 1 / 6), GraphConfig())
    assert sorted(graph.labels) == list("abdef")
    assert not graph.bearings_only


def test_rooms_without_range_in_a_map_with_range():
    """Instance images alone, in rooms of boxes: the place, and the pose but for what boxes hide of themselves."""
    localizer, truths = SaliencyGraphLocalizer(SaliencyGraphLocalizer.Config(detector="annotations")), query_truths()
    built = LocalizationMap.build(localizer, map_frames())
    for frame in query_frames({"annotations"}):
        answer = built.localize(frame)
        assert answer.status == "ok"
        assert answer.places[0].place == truths[frame.id].place
        shift_m, turn_rad = pose_errors(answer.T_world_query, truths[frame.id].T_world_pano)
        assert shift_m < 0.3
        assert turn_rad < np.radians(8)
        assert answer.heading_rad == pytest.approx(pose_yaw(answer.T_world_query))


def test_two_objects_give_place_and_heading():
    room = ROOMS[0]
    pair = detections_where_known(
        ["bed", "wardrobe"],
        np.ones(2),
        None,
        directions(pose_2d(0.2, 0.1, 1.3), graph_points(room, ("bed", "wardrobe"))),
        np.ones(2),
    )
    localizer = SaliencyGraphLocalizer(SaliencyGraphLocalizer.Config(detector="annotations"))
    built = LocalizationMap.build(localizer, map_frames())
    answer = built.answer(graph_to_arrays(build_graph(pair, np.array([0.6, 0.4]), GraphConfig())))
    assert (answer.status, answer.places[0].place) == ("no-pose", room.name)
    heading_rad = 1.3 + pose_yaw(map_frames()[0].T_world_pano)
    assert abs(wrap_angle(answer.heading_rad - heading_rad)) < np.radians(0.1)


def graph_points(room, labels):
    """Where the localizer's map has these objects."""
    frame = map_frames()[ROOMS.index(room)]
    localizer = SaliencyGraphLocalizer(SaliencyGraphLocalizer.Config(detector="annotations"))
    graph = localizer.graph(annotated_detections(frame.load()))
    return np.array([graph.centroid_m[graph.labels.index(label)] for label in labels])


def test_a_map_needs_range():
    frame = ReferenceFrame(
        "flat", "bedroom", stand(ROOMS[0]), load=lambda: look(ROOMS[0], "flat", stand(ROOMS[0]), {"annotations"})
    )
    with pytest.raises(InputMissing, match="flat cannot be a reference frame: the panorama has no range image"):
        LocalizationMap.build(SaliencyGraphLocalizer(SaliencyGraphLocalizer.Config(detector="annotations")), [frame])
    localizer = SaliencyGraphLocalizer(SaliencyGraphLocalizer.Config(detector="annotations"))
    built = LocalizationMap.build(localizer, map_frames())
    assert built.localize(QueryFrame("flat", frame.load)).status == "ok"


def test_labels_alone_match_where_geometry_is_off():
    """`paper` and `usg` do not verify geometry: a query without range is matched by its labels."""
    matcher = TripletMatcher(TripletMatcher.Config())
    map_m = rooms(3)
    graphs = [
        build_graph(
            Detections(labels, np.ones(6), map_m[k], np.ones((6, 3)), np.zeros(6)), np.full(6, 1 / 6), GraphConfig()
        )
        for k, labels in enumerate(("abcdef", "ghijkl", "abcxyz"))
    ]
    query = detections_where_known("abcdef", np.ones(6), None, directions(np.eye(4), map_m[0]), np.ones(6))
    matches = matcher.match(build_graph(query, np.full(6, 1 / 6), GraphConfig()), matcher.index(graphs), 3)
    assert [match.scene for match in matches] == [0, 2]
