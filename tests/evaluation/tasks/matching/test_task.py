"""Matching accuracy against closed forms: a round room, rendered boxes, and matches whose error is known."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import run
from matching_plugin import STEP, turned_by

from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare
from salframe.evaluation.tasks.matching.judging import PIXEL_RAD, check_matches, objects_of_nodes, point_errors_px
from salframe.evaluation.tasks.matching.task import measure_matching
from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError, InputMissing, InvalidAnswer
from salframe.localization.answers import NodeMatches, PointMatches
from salframe.panoramas.geometry import equirectangular_rays, invert_pose, pose_2d, transform_points
from salframe.panoramas.panorama import Panorama
from salframe.testing.rooms import ROOMS, look, stand

RADIUS_M = 3.0


def round_room(T_world_pano: np.ndarray) -> Panorama:
    """A ball of RADIUS_M around the world's origin, seen from inside."""
    rays = equirectangular_rays(256).astype(np.float64) @ T_world_pano[:3, :3].T
    along = rays @ T_world_pano[:3, 3]
    return Panorama(
        "round",
        range_m=(-along + np.sqrt(along**2 - (T_world_pano[:3, 3] ** 2).sum() + RADIUS_M**2)).astype(np.float32),
    )


QUERY, REFERENCE = pose_2d(0.5, -0.4, 1.1), pose_2d(-0.6, 0.3, -2.0, 0.2)
STEP_ROUND = invert_pose(REFERENCE) @ QUERY


def matches_off_by(px: float, count: int = 200) -> PointMatches:
    """Points on the wall of the round room, matched with bearings that are so far off."""
    rng = np.random.default_rng(1)
    points = rng.normal(size=(count, 3))
    points *= RADIUS_M / np.linalg.norm(points, axis=1, keepdims=True)
    seen = [transform_points(invert_pose(pose), points) for pose in (QUERY, REFERENCE)]
    query, reference = (side / np.linalg.norm(side, axis=1, keepdims=True) for side in seen)
    return PointMatches(query, turned_by(reference, px * PIXEL_RAD))


@pytest.mark.parametrize("px", [0.0, 2.0, 40.0])
def test_errors_of_points_are_great_circle_angles_in_pixels_of_a_panorama_1024_wide(px):
    errors = point_errors_px(matches_off_by(px), round_room(QUERY), round_room(REFERENCE), STEP_ROUND)
    assert len(errors) == 200
    # the range is read at the nearest of 512 x 256 pixels, half a pixel off: less than 0.3 px of direction across the
    # step
    np.testing.assert_allclose(errors, px, atol=0.3)


def test_two_pixels_off_is_wrong_within_one_and_right_within_three():
    row = check_matches(matches_off_by(2.0), round_room(QUERY), round_room(REFERENCE), STEP_ROUND)
    assert row == {"kind": "points", "matches": 200, "judged": 200, "within_px": [0, 200, 200]}


def test_points_without_range_are_left_out():
    query, matches = round_room(QUERY), matches_off_by(0.0)
    half = Panorama("half", range_m=np.where(equirectangular_rays(256)[..., 0] > 0, query.range_m, np.nan))
    # a bearing within a pixel of the border may fall on either side
    ahead = matches.query[:, 0] > 0
    assert abs(len(point_errors_px(matches, half, round_room(REFERENCE), STEP_ROUND)) - ahead.sum()) <= 2
    unknown = Panorama("unknown", range_m=np.full_like(query.range_m, np.nan))
    assert len(point_errors_px(matches, query, unknown, STEP_ROUND)) == 0
    with pytest.raises(InputMissing, match="dark has no range"):
        point_errors_px(matches, query, Panorama("dark", rgb=np.zeros((4, 8, 3), np.uint8)), STEP_ROUND)


@pytest.mark.parametrize(("share", "kept"), [(1.04, 200), (0.96, 200), (1.07, 0), (0.5, 0)])
def test_points_hidden_from_the_reference_are_left_out(share, kept):
    reference = Panorama("reference", range_m=round_room(REFERENCE).range_m * np.float32(share))
    assert len(point_errors_px(matches_off_by(0.0), round_room(QUERY), reference, STEP_ROUND)) == kept


def test_nodes_belong_to_the_nearest_object_within_half_a_metre_and_one_to_one():
    bedroom = ROOMS[0]
    panorama = look(bedroom, "bedroom", stand(bedroom))
    # the middle of each box's visible part lies inside the box; nodes there, a little off, and far off
    world = {box.label: (i, np.array(box.centre_m)) for i, box in enumerate(bedroom.boxes, 1)}
    inside = [
        transform_points(invert_pose(stand(bedroom)), world[label][1]) for label in ("nightstand", "chair", "lamp")
    ]
    np.testing.assert_array_equal(
        objects_of_nodes(np.array(inside), panorama), [world[label][0] for label in ("nightstand", "chair", "lamp")]
    )
    nodes = np.array([inside[1], inside[1] + (0, 0, 0.05), inside[1] + (0, 0, 1.5)])
    own = objects_of_nodes(nodes, panorama)
    assert sorted(own.tolist()) == [0, 0, world["chair"][0]]
    assert own[2] == 0
    assert objects_of_nodes(np.zeros((0, 3)), panorama).shape == (0,)


def test_nodes_without_an_instance_image_cannot_be_judged():
    with pytest.raises(InputMissing, match="round has no instance image"):
        check_matches(
            NodeMatches(np.zeros((1, 3)), np.zeros((1, 3)), np.array([[0, 0]])),
            round_room(QUERY),
            round_room(REFERENCE),
            np.eye(4),
        )


@pytest.mark.parametrize("pairs", [[[0, 3]], [[0, 1], [0, 2]], [[-1, 0]]])
def test_pairs_of_nodes_that_are_not_there_or_used_twice_are_refused(pairs):
    with pytest.raises(InvalidAnswer, match="each of 3 query and 3 reference objects at most once"):
        NodeMatches(np.zeros((3, 3)), np.zeros((3, 3)), np.array(pairs))


@pytest.mark.parametrize("method", ["proposed", "usg", "sovs"])
def test_methods_that_align_objects_do_so_without_a_map(method):
    config = configure("localizer", method, settings("localizer", method), [{"detector": "annotations"}])
    localizer = registry().build("localizer", config)
    lounge = ROOMS[2]
    query, reference = look(lounge, "query", stand(lounge) @ STEP), look(lounge, "reference", stand(lounge))
    found = localizer.correspond(localizer.describe(query), localizer.describe(reference))
    row = check_matches(found, query, reference, STEP)
    assert row["correct"] == row["matches"] == len(found.pairs)
    assert row["correct"] >= row["true"] - 1 >= 4
    emptied = look(lounge.emptied(), "empty", stand(lounge))
    assert len(localizer.correspond(localizer.describe(query), localizer.describe(emptied)).pairs) == 0


def measure(methods, *settings, engine="inline", **given):
    """Rows by method, and the whole."""
    result = measure_matching(Request(tuple(methods), "furnished", settings=settings, engine=engine, **given))
    return {row.method: row for row in result.rows}, result


def test_rows_of_points_and_of_nodes(furnished):
    rows, result = measure(["points", "nodes", "neither"], "points.off_px=2")
    points, nodes, neither = rows.values()
    assert (points.kind, points.pairs, points.matches_per_pair, points.pairs_without_match) == ("points", 2, 40, 0)
    assert (points.mma_1.value, points.mma_5.value) == (0, 1)
    assert (points.precision, points.recall) == (None, None)
    # 5 of 7 objects of the bedroom and of 6 of the kitchen are matched
    assert (nodes.kind, nodes.matches_per_pair, nodes.precision.value) == ("nodes", 5, 1)
    assert nodes.true_per_pair == 6.5
    assert nodes.recall.value == pytest.approx((5 / 7 + 5 / 6) / 2)
    assert (nodes.recall.low, nodes.recall.high) == pytest.approx((5 / 7, 5 / 6))
    assert nodes.mma_3 is None
    assert (neither.available, neither.reason) == (
        False,
        "the method does not return matches of points or objects, which the task 'matching' measures: choose another "
        "method, such as 'proposed'",
    )
    assert result.measured
    assert not result.crashed


def test_crossed_nodes_are_wrong(furnished):
    rows, _ = measure(["nodes"], "crossed=true")
    assert rows["nodes"].precision.value == pytest.approx(3 / 5)
    assert rows["nodes"].recall.value == pytest.approx((3 / 7 + 3 / 6) / 2)


def test_without_a_match_nothing_is_right(furnished):
    rows, _ = measure(["points", "nodes"], "count=0", "first=0")
    assert (rows["points"].mma_5.value, rows["points"].pairs_without_match) == (0, 2)
    assert (rows["nodes"].precision.value, rows["nodes"].recall.value) == (0, 0)


def test_a_pair_that_crashes_counts_as_wrong_and_is_asked_again(furnished):
    rows, result = measure(["points", "nodes"], "fail_after=1")
    points = rows["points"]
    assert (points.mma_1.value, points.mma_1.low, points.mma_1.high) == (
        0.5,
        0,
        1,
    )  # of two places, one of which may be both
    assert rows["points"].reason == "1 pair of panoramas failed, the first error: ValueError: no more"
    assert rows["nodes"].precision.value == 1
    assert result.crashed
    before = {path.parent.name: path.read_text() for path in result.run.glob("methods/*/rows.jsonl")}
    again, _ = measure(["points", "nodes"], "fail_after=1")
    after = {path.parent.name: path.read_text() for path in result.run.glob("methods/*/rows.jsonl")}
    assert after["nodes"] == before["nodes"]
    assert len(after["points"].splitlines()) == 3
    assert again["points"].mma_1.value == 1  # alone in its second run, the query that failed does not


def test_a_query_is_matched_with_the_nearest_scene_frame_of_its_place(furnished):
    _, result = measure(["points"])
    rows = (result.run / "methods" / "points" / "rows.jsonl").read_text()
    assert '"reference": "bedroom-middle"' in rows
    assert '"reference": "kitchen-middle"' in rows


def test_queries_of_places_that_are_not_mapped_are_left_out_and_counted(furnished):
    rows, result = measure(["points"], "data.unmapped=true")
    assert rows["points"].pairs == 1
    assert result.notes == (
        "1 of 2 queries are left out: the map has no panorama of the kind `scene` (in a room) of their place",
        "the true place of 1 query is not in the map, so the correct answer is out-of-map: 'kitchen'",
    )


def test_data_that_tells_no_truth_is_refused(furnished):
    with pytest.raises(InputMissing, match="needs range images, which the dataset furnished does not have"):
        measure(["points"], "data.ranges=false")
    with pytest.raises(DataError, match="the true pose of the query bedroom-query is missing"):
        measure(["points"], "data.posed=false")
    rows, _ = measure(["nodes", "points"], "data.instances=false")
    assert rows["nodes"].reason == (
        "the method needs annotations, which the dataset furnished does not have: use another method or dataset"
    )
    assert rows["points"].mma_1.value == 1


def test_a_comparison_of_the_same_name_is_another_run(furnished):
    compared = compare(Request(("points",), "furnished", name="same", engine="inline"))
    _, matched = measure(["points"], name="same")
    assert compared.run.name.startswith("same-")
    assert matched.run.name.startswith("same-")
    assert compared.run != matched.run


@pytest.mark.parametrize("engine", ["inline", "processes"])
def test_a_method_that_exits_costs_its_own_row(furnished, engine):
    rows, result = measure(["leaving", "points"], engine=engine)
    assert (rows["leaving"].reason, rows["leaving"].measured) == ("SystemExit: it leaves", False)
    assert rows["points"].mma_1.value == 1
    assert result.crashed


def test_what_is_no_match_costs_its_own_row(furnished):
    rows, result = measure(["confused", "points"])
    assert (
        rows["confused"].reason
        == "the function `correspond` of the method returned list, expected PointMatches, NodeMatches or None"
    )
    assert not rows["confused"].measured
    assert result.crashed
    assert rows["points"].mma_1.value == 1


def test_the_command_prints_two_tables_and_resumes(furnished):
    options = ("matching", "--methods", "points,nodes,neither", "--data", "furnished", "--engine", "inline")
    first = run(*options)
    assert first.code == 0
    pixels, counts = first.out.split("precision %")
    assert "MMA@3 %" in pixels
    assert "MMA" not in counts
    assert "neither: the method does not return matches of points or objects, which the task 'matching'" in counts
    again = run(*options, "--json")
    assert again.json["rows"][0]["mma_1"] == 1
    assert again.json["run"] in first.out


def test_processes_measure_alike(furnished):
    inline, _ = measure(["nodes"])
    processes, _ = measure(["nodes"], "crossed=true", engine="processes")
    assert processes["nodes"].true_per_pair == inline["nodes"].true_per_pair
    assert processes["nodes"].precision.value == pytest.approx(0.6)
