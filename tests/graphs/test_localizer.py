"""The localizer `saliency-graph` end to end on object lists, and how places are ranked."""

import numpy as np
import pytest
from salframe_graphs import node_matcher
from salframe_graphs.geometric import GeometricMatcher
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_graphs.places.localizer import SaliencyPlacesLocalizer
from salframe_graphs.retrieval.inverted_lists import InvertedLists

from salframe.framework.components.identity import identity
from salframe.framework.components.installation import folder_bytes
from salframe.framework.components.presets import configure, settings
from salframe.framework.errors import DataError, InputMissing
from salframe.framework.validation import validate
from salframe.graphs.detections import Detections
from salframe.graphs.matcher import GraphMatcher
from salframe.localization.describing import describe_frame
from salframe.localization.map import LocalizationMap
from salframe.localization.map_files import write_map
from salframe.localization.ranking import rank_places
from salframe.panoramas.frames import FrameKind, QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors, transform_points
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama

LABELS = ("bed", "sofa", "chair", "table", "lamp", "plant", "tv", "desk")


def seen(room, T_room_pano, name):
    """A panorama of a random room's objects from a pose in the room."""
    rng = np.random.default_rng(room)
    centroid = np.column_stack([rng.uniform(-2.5, 2.5, 7), rng.uniform(-2, 2, 7), rng.uniform(-1.2, 0.8, 7)])
    yaw = rng.uniform(0, np.pi, 7) - np.arctan2(T_room_pano[1, 0], T_room_pano[0, 0])
    labels = [str(label) for label in rng.choice(LABELS, 7)]
    size = np.sort(rng.uniform(0.3, 1.8, (7, 3)))[:, [2, 1, 0]]
    objects = Detections(labels, np.ones(7), transform_points(invert_pose(T_room_pano), centroid), size, yaw)
    return Panorama(
        name,
        annotations=Annotations(
            objects=ObjectBoxes(
                objects.labels, tuple(map(str, range(7))), objects.centroid_m, objects.size_m, objects.yaw_rad
            )
        ),
    )


def reference_frame(room, T_world_pano):
    """Of a room whose middle is seen from the middle."""
    name = f"map-{room}"
    return ReferenceFrame(name, f"room-{room}", T_world_pano, load=lambda: seen(room, np.eye(4), name))


def query(room, T_room_pano=None):
    pose = np.eye(4) if T_room_pano is None else T_room_pano
    return QueryFrame("query", lambda: seen(room, pose, "query"))


def graph_localizer(**settings):
    """On annotations, unless the settings say otherwise."""
    return SaliencyGraphLocalizer(SaliencyGraphLocalizer.Config(**{"detector": "annotations", **settings}))


@pytest.fixture(scope="module")
def mapped():
    return LocalizationMap.build(
        graph_localizer(), [reference_frame(i, pose_2d(6.0 * i, 0, 0.3 * i)) for i in range(12)]
    )


def test_place_and_pose(mapped):
    for i in range(12):
        T = pose_2d(0.5, -0.4, 1.0 + i)
        answer = mapped.localize(query(i, T))
        assert answer.status == "ok"
        assert answer.places[0].place == f"room-{i}"
        expected = pose_2d(6.0 * i, 0, 0.3 * i) @ T
        assert pose_errors(answer.T_world_query, expected) == pytest.approx((0, 0), abs=5e-4)  # positions are in mm


def test_saved_map_gives_the_same_answers(mapped, tmp_path):
    mapped.save(tmp_path)
    again = LocalizationMap.open(tmp_path, graph_localizer())
    asked = query(4, pose_2d(0.2, 0.3, 2.0))
    before, after = mapped.localize(asked), again.localize(asked)
    assert before.places == after.places
    np.testing.assert_array_equal(before.T_world_query, after.T_world_query)


@pytest.mark.parametrize("few", [0, 1000])
def test_a_saved_map_is_not_indexed_again(few, tmp_path, monkeypatch):
    """Nor are its graphs read but for those that are matched: candidates, whose features are those kept in memory."""
    made = graph_localizer(matcher={"max_candidates": 4})
    frames = [reference_frame(i, pose_2d(6.0 * i, 0, 0.3 * i)) for i in range(12)]
    # Shows the same as room-5, and comes after it in the order of the names.
    door = ReferenceFrame("door", "to-5", pose_2d(3.0, 0, 0), FrameKind.TRANSITION, lambda: seen(5, np.eye(4), "door"))
    built = LocalizationMap.build(made, [*frames[:6], door, *frames[6:]])
    built.save(tmp_path)
    for role, hook in ((InvertedLists, "build"), (GeometricMatcher, "index"), (SaliencyGraphLocalizer, "index")):
        monkeypatch.setattr(role, hook, None)
    monkeypatch.setattr(node_matcher, "MAX_PRECOMPUTED", few)
    again = LocalizationMap.open(tmp_path, graph_localizer(matcher={"max_candidates": 4}))
    for i in range(12):
        description = describe_frame(made, query(i, pose_2d(0.2, 0.3, 2.0)))[0]
        before, after = built.answer(description), again.answer(description)
        assert [place.frame for place in before.places] == [place.frame for place in after.places]
        scores = [[place.score for place in answer.places] for answer in (before, after)]
        np.testing.assert_allclose(*scores, rtol=1e-12)  # features are summed in another order
        assert before.places[0].place == f"room-{i}"
        np.testing.assert_array_equal(before.T_world_query, after.T_world_query)
        np.testing.assert_array_equal(before.covariance, after.covariance)


def test_a_matcher_that_keeps_no_index_indexes_anew(tmp_path, monkeypatch):
    """With the graphs as they were remembered."""
    monkeypatch.setattr(GeometricMatcher, "write_index", GraphMatcher.write_index)
    monkeypatch.setattr(GeometricMatcher, "open_index", GraphMatcher.open_index)
    built = LocalizationMap.build(
        graph_localizer(), [reference_frame(i, pose_2d(6.0 * i, 0, 0.3 * i)) for i in range(3)]
    )
    built.save(tmp_path)
    again = LocalizationMap.open(tmp_path, graph_localizer())
    asked = query(2, pose_2d(0.2, 0.3, 2.0))
    assert built.localize(asked).places == again.localize(asked).places


def test_a_scene_is_a_few_hundred_bytes(mapped, tmp_path):
    """7 nodes of 16 bytes, a byte each for their labels, 3 for 21 edges, and their number."""
    frames = [reference_frame(i, pose_2d(6.0 * i, 0, 0.0)) for i in range(100)]
    sizes = []
    for count in (50, 100):
        LocalizationMap.build(graph_localizer(), frames[:count]).save(tmp_path / str(count))
        sizes.append(folder_bytes(next((tmp_path / str(count)).glob("parts-*")) / "scenes"))
    assert (sizes[1] - sizes[0]) / 50 == pytest.approx(7 * 16 + 7 + 3, abs=0.1)


def test_failing_is_a_status(mapped):
    empty = Panorama("empty", annotations=Annotations(objects=ObjectBoxes.empty()))
    assert mapped.localize(QueryFrame("empty", lambda: empty)).status == "no-objects"
    strange = Detections(("spaceship",), np.ones(1), np.ones((1, 3)), np.ones((1, 3)), np.zeros(1))
    assert (
        mapped.localize(
            QueryFrame(
                "s",
                lambda: Panorama(
                    "s",
                    annotations=Annotations(
                        objects=ObjectBoxes(strange.labels, ("1",), strange.centroid_m, strange.size_m, strange.yaw_rad)
                    ),
                ),
            )
        ).status
        == "no-match"
    )
    picky = LocalizationMap.build(graph_localizer(min_score=10.0), [reference_frame(1, np.eye(4))])
    answer = picky.localize(query(1))
    assert (answer.status, answer.places, answer.T_world_query) == ("low-score", (), None)


def test_bad_input_is_one_clear_line(mapped, tmp_path):
    with pytest.raises(
        InputMissing, match="the method 'saliency-graph' needs annotations, which panorama q does not have"
    ):
        mapped.localize(QueryFrame("q", lambda: Panorama("q", range_m=np.ones((4, 8), np.float32))))
    with pytest.raises(DataError, match="received no reference frame"):
        LocalizationMap.build(graph_localizer(), [])
    with write_map(tmp_path) as parts:
        content = {"version": "0", "localizer": {"kind": "objects"}, "described_by": ""}
        parts.write_json("method.json", content)
    with pytest.raises(DataError, match="was built with version 0 of the method 'objects', expected version"):
        LocalizationMap.open(tmp_path, graph_localizer())


def test_a_doorway_match_answers_with_the_scene_at_the_pose():
    """Of a room, a doorway and another room the doorway matches best; the pose is on the second room's side."""
    frames = [
        ReferenceFrame("a", "room-a", pose_2d(0, 0, 0)),
        ReferenceFrame("door", "transition-1", pose_2d(2, 0, 0), FrameKind.TRANSITION),
        ReferenceFrame("b", "room-b", pose_2d(4, 0, 0)),
    ]
    scores = np.array([0.5, 0.9, 0.2])
    assert [p.place for p in rank_places(frames, scores)] == ["transition-1", "room-a", "room-b"]
    ranked = rank_places(frames, scores, pose_2d(3.1, 0.2, 1.0))
    assert [(p.place, p.score) for p in ranked] == [("room-b", 0.9), ("transition-1", 0.9), ("room-a", 0.5)]


def test_the_covariance_is_in_the_axes_of_the_world():
    """Of a map that stands turned by 90 degrees in the world, x and y change places."""
    plain, turned = (
        LocalizationMap.build(graph_localizer(), [reference_frame(3, pose_2d(1, 2, 0.3 + turn_rad))])
        for turn_rad in (0, np.pi / 2)
    )
    before, after = (made.localize(query(3, pose_2d(0.5, -0.4, 1.0))).covariance for made in (plain, turned))
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    np.testing.assert_allclose(after, turn @ before @ turn.T, atol=1e-12)
    assert abs(before[0, 0] - before[1, 1]) > 1e-6


def test_the_best_frame_of_a_place_stands_for_it():
    frames = [
        ReferenceFrame("1", "x", np.eye(4)),
        ReferenceFrame("2", "y", np.eye(4)),
        ReferenceFrame("3", "x", np.eye(4)),
    ]
    assert [(p.frame, p.place) for p in rank_places(frames, np.array([0.1, -np.inf, 0.3]))] == [("3", "x")]


@pytest.mark.parametrize(
    ("preset", "localizer"),
    [
        ("proposed", SaliencyPlacesLocalizer),
        ("paper", SaliencyGraphLocalizer),
        ("paper-signed", SaliencyGraphLocalizer),
    ],
)
def test_presets_are_configurations_of_the_same_stages(preset, localizer):
    config = configure("localizer", preset, settings("localizer", preset))
    assert config.kind == localizer.name
    assert validate(localizer.Config, config.model_dump(), preset) == config


def test_paper_signed_is_the_paper_but_for_signs_and_salient_objects():
    paper, signed = (configure("localizer", name, settings("localizer", name)) for name in ("paper", "paper-signed"))
    assert (signed.positioner.angle, signed.positioner.mean, signed.positioner.norms) == (
        "atan2",
        "circular",
        "squared",
    )
    assert signed.graph.min_share > 0 == paper.graph.min_share
    positioner = signed.positioner.model_copy(update={"angle": "arccos", "mean": "arithmetic"})
    assert signed.model_copy(update={"positioner": positioner, "graph": paper.graph}) == paper


@pytest.mark.parametrize(
    "change",
    [
        {"matcher": {"min_candidate_ratio": 0.8}},
        {"positioner": "least-squares"},
        {"top_k": 3},
        {"min_score": 0.1},
        {"agreement": 0.0},
        {"agreement_radius_m": 1.0},
        {"nearest_scene": False},
    ],
)
def test_what_matters_to_matching_only_is_no_part_of_a_description(change):
    base, other = graph_localizer(), graph_localizer(**change)
    assert identity(base.config) != identity(other.config)
    assert base.describe_identity() == other.describe_identity()


@pytest.mark.parametrize(
    "change", [{"detector": {"kind": "annotations", "noise": "uniform-heavy"}}, {"graph": {"top_k": 3}}]
)
def test_what_makes_the_graph_is_part_of_a_description(change):
    other = graph_localizer(**change)
    assert graph_localizer().describe_identity() != other.describe_identity()
