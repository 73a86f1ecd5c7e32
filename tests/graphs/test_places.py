"""The localizer `saliency-places` end to end on object lists: regions, maps on disk, queries without range."""

from functools import partial

import numpy as np
import pytest
import yaml
from pydantic import ValidationError
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_graphs.places import localizer as places_localizer
from salframe_graphs.places.evidence import shipped_weights
from salframe_graphs.places.evidence_components import label_evidence
from salframe_graphs.places.localizer import OUTLINE, SaliencyPlacesLocalizer
from salframe_graphs.places.merging import Place
from salframe_graphs.places.place_index import index_places
from salframe_graphs.places.rates import Likelihood, shipped_rates
from salframe_graphs.sectors import BINS

from salframe.framework.components.identity import identity
from salframe.graphs.graph import without_range
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays
from salframe.localization.describing import describe_frame
from salframe.localization.map import LocalizationMap
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import FrameKind, QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors, transform_points
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama

LABELS = ("bed", "sofa", "chair", "table", "lamp", "plant", "tv", "desk")
CENTRES = {"a": (0.0, 0.0), "b": (6.0, 0.0)}
RNG = np.random.default_rng(7)
ROOMS = {
    name: (
        [str(label) for label in RNG.choice(LABELS, 7)],
        np.column_stack([RNG.uniform(-2.5, 2.5, (7, 2)), RNG.uniform(-1, 1, 7)]) + np.array([*centre, 0]),
    )
    for name, centre in CENTRES.items()
}
SIZE_M = np.array([1.0, 0.8, 0.6])


def panorama(name, rooms, T_world_pano):
    """Of all objects of some rooms."""
    labels = [label for room in rooms for label in ROOMS[room][0]]
    seen = transform_points(invert_pose(T_world_pano), np.concatenate([ROOMS[room][1] for room in rooms]))
    objects = ObjectBoxes(
        labels, tuple(map(str, range(len(labels)))), seen, np.tile(SIZE_M, (len(labels), 1)), seen[:, 0] * 0
    )
    return Panorama(name, annotations=Annotations(objects=objects))


def frame(name, place, rooms, x_m, yaw_rad=0.0, kind=FrameKind.SCENE):
    T = pose_2d(x_m, 0.2, yaw_rad)
    return ReferenceFrame(name, place, T, kind, partial(panorama, name, rooms, T))


FRAMES = [
    frame("a1", "a", ["a"], -1.0),
    frame("a2", "a", ["a"], 1.0, 2.0),
    frame("b1", "b", ["b"], 6.5, -1.0),
    frame("door", "a-b", ["a", "b"], 3.0, 0.5, FrameKind.TRANSITION),
]


def floor():
    """Two rooms beside each other, x from -3 to 3 and from 3 to 9 m."""
    region = np.ones((60, 120), np.int32)
    region[:, 60:] = 2
    whole = np.ones(region.shape, bool)
    return FloorMasks(whole, region, ~whole, 0.1, (-3.0, 3.0), {1: "a", 2: "b"})


def localizer(floors=(), **settings):
    made = SaliencyPlacesLocalizer(SaliencyPlacesLocalizer.Config(detector="annotations", **settings))
    return LocalizationMap.build(made, FRAMES, floors=floors)


def query_at(rooms, x_m, y_m=0.0, yaw_rad=1.0):
    T = pose_2d(x_m, y_m, yaw_rad)
    return QueryFrame("query", partial(panorama, "query", rooms, T)), T


@pytest.mark.parametrize("merged", [True, False])
@pytest.mark.parametrize("floors", [(), (floor(),)], ids=["alone", "with-floors"])
def test_place_and_pose(floors, merged):
    made = localizer(floors, merged=merged)
    for room, x_m in (("a", 0.4), ("b", 5.5)):
        query, T = query_at([room], x_m)
        answer = made.localize(query)
        assert (answer.status, answer.places[0].place) == ("ok", room)
        assert max(pose_errors(answer.T_world_query, T)) < 0.01
        assert answer.covariance.shape == (3, 3)
        assert (np.linalg.eigvalsh(answer.covariance) > 0).all()


def test_the_answer_is_the_region_that_holds_the_pose():
    """From room b through the open door the objects of a are seen, and none of b."""
    query, T = query_at(["a"], 3.4)
    answers = {known: localizer([floor()] if known else ()).localize(query) for known in (True, False)}
    assert {known: answer.places[0].place for known, answer in answers.items()} == {True: "b", False: "a"}
    assert all(max(pose_errors(answer.T_world_query, T)) < 0.01 for answer in answers.values())
    assert {ranked.place for ranked in answers[True].places} == {"a", "b"}


def test_the_answer_names_the_scene_frame_nearest_to_the_pose():
    made = localizer()
    for x_m, name in ((-0.6, "a1"), (0.7, "a2")):
        assert made.localize(query_at(["a"], x_m)[0]).places[0].frame == name


@pytest.mark.parametrize("settings", [{}, {"candidates": 1}, {"merged": False, "candidates": 2}])
def test_a_map_opened_again_answers_alike(settings, tmp_path, monkeypatch):
    """Whose places are not merged again, and of whose frames some have outlines."""
    made = localizer([floor()], **settings).localizer
    described = [describe_frame(made, frame)[0] for frame in FRAMES]
    outlines = RNG.uniform(1, 4, (2, BINS)).astype(np.float32)
    outlines[0, :9] = np.nan
    for number, outline in zip((0, 2), outlines, strict=True):
        described[number] = {**described[number], OUTLINE: outline}
    LocalizationMap.from_descriptions(made, described, FRAMES, [floor()]).save(tmp_path)
    for hook in ("index", "unpack"):
        monkeypatch.setattr(SaliencyPlacesLocalizer, hook, None)
    again = SaliencyPlacesLocalizer(SaliencyPlacesLocalizer.Config(detector="annotations", **settings))
    assert len(LocalizationMap.open(tmp_path, again).floors) == 1
    for rooms, x_m in ((["a"], 3.4), (["b"], 5.0)):
        description = {**describe_frame(made, query_at(rooms, x_m)[0])[0], OUTLINE: outlines[1]}
        before, after = (one.match(description) for one in (made, again))
        assert before.places == after.places
        np.testing.assert_array_equal(before.T_world_query, after.T_world_query)
        np.testing.assert_array_equal(before.covariance, after.covariance)
        evidence, other = (one.evidence(description).values for one in (made, again))
        assert evidence["outline"].any()
        for name in shipped_weights():
            np.testing.assert_array_equal(evidence[name], other[name])


def test_failing_is_a_status():
    made = localizer()

    def answer(objects):
        return made.localize(QueryFrame("q", lambda: Panorama("q", annotations=Annotations(objects=objects))))

    def alone(label):
        return ObjectBoxes([label], ("1",), np.ones((1, 3)), np.ones((1, 3)), np.zeros(1))

    assert answer(ObjectBoxes.empty()).status == "no-objects"
    assert answer(alone("spaceship")).status == "no-match"
    one = answer(alone(ROOMS["a"][0][0]))
    assert (one.status, one.T_world_query) == ("no-pose", None)
    assert len(one.places) == 2


def test_an_outline_is_remembered_where_there_is_range():
    seen = panorama("q", ["a"], np.eye(4))
    ranged = Panorama("q", range_m=np.full((90, 180), 3.0, np.float32), annotations=seen.annotations)
    with_outline, without = (
        SaliencyPlacesLocalizer(SaliencyPlacesLocalizer.Config(detector="annotations", evidence=evidence))
        for evidence in (["outline"], ["likelihood"])
    )
    plain = without.describe(ranged)
    assert set(with_outline.describe(ranged)) - set(plain) == {"outline_m", "reach_m", "shown_from_m"}
    assert set(with_outline.describe(seen)) == set(without.describe(seen))
    packed = with_outline.pack(with_outline.describe(ranged))
    assert {name: packed[name].nbytes for name in set(packed) - set(without.pack(plain))} == {"outline_mm": 144}
    np.testing.assert_allclose(
        with_outline.unpack(packed)["outline_m"], with_outline.describe(ranged)["outline_m"], atol=6e-4
    )


def test_an_answer_has_the_evidence_of_its_first_place_for_the_posterior():
    """The values of the best hypothesis. Panoramas without range images have no outline."""
    localizer = SaliencyPlacesLocalizer(SaliencyPlacesLocalizer.Config(detector="annotations"))
    built = LocalizationMap.build(localizer, FRAMES)
    T = pose_2d(0.3, -0.4, 0.7)
    description = localizer.describe(panorama("q", ["a"], T))
    answer = built.answer(description)
    evidence = localizer.evidence(description)
    of_place = np.array(evidence.places) == answer.places[0].place
    scores = np.where(of_place, evidence.scores(localizer.config.weights), -np.inf)
    assert dict(answer.evidence) == {"likelihood": evidence.values["likelihood"][scores.argmax()]}
    assert answer.evidence["likelihood"] > 0
    bearings = built.answer(graph_to_arrays(without_range(graph_from_arrays(description))))
    assert bearings.places
    assert dict(bearings.evidence) == {}


def test_what_is_fitted_comes_from_a_file_or_the_settings(tmp_path):
    rates, weights = shipped_rates().model_copy(update={"clutter": 0.5}), shipped_weights()
    path = tmp_path / "fitted.yaml"
    path.write_text(yaml.safe_dump({"rates": rates.model_dump(), "weights": dict(weights)}))
    Config = SaliencyPlacesLocalizer.Config
    shipped, filed, given = (
        Config(detector="annotations", **settings)
        for settings in ({}, {"rates": str(path), "weights": str(path)}, {"rates": rates.model_dump()})
    )
    assert shipped.rates == shipped_rates()
    assert filed.rates == given.rates == rates
    assert filed.weights == given.weights == weights
    assert identity(shipped) != identity(filed) == identity(given)
    assert identity(shipped, describing=True) == identity(filed, describing=True)
    path.write_text("rates: {clutter: 1}")
    parts = Config(detector="annotations", rates=str(path), posterior={"max_out_of_map_probability": 0.5})
    assert parts.rates == shipped_rates().model_copy(update={"clutter": 1.0})  # the rest as shipped
    assert parts.posterior == shipped.posterior.model_copy(update={"max_out_of_map_probability": 0.5})
    assert Config(detector="annotations", posterior=None).posterior is None
    path.write_text("rates: {clutter: -1}")
    with pytest.raises(ValidationError, match="clutter"):
        Config(detector="annotations", rates=str(path))
    with pytest.raises(ValidationError, match="no mapping `weights`"):
        Config(detector="annotations", weights=str(path))


def test_evidence_of_labels_is_counted_by_rarity():
    """Places a {bed, bed, lamp} and b {bed, tv} asked for {bed, bed, bed, tv, boat}: by hand."""
    places = [
        Place(
            name,
            (0,),
            labels,
            *(np.zeros((len(labels), 3)), np.ones(len(labels)), np.zeros((len(labels), 3))),
            *([np.ones(len(labels))] * 2),
        )
        for name, labels in (("a", ("bed", "bed", "lamp")), ("b", ("bed", "tv")))
    ]
    index = index_places(places, [np.zeros((1, 3))] * 2, shipped_rates(), Likelihood())
    assert list(index.vocabulary) == ["bed", "lamp", "tv"]
    bed, once, never = np.log(3 / 3) + 1, np.log(3 / 2) + 1, np.log(3 / 1) + 1
    np.testing.assert_allclose(index.rarity, [bed, once, once, never])
    asked = 3 * bed + once + never
    shared = np.array([2 * bed, bed + once])
    own = np.array([2 * bed + once, bed + once])
    found = label_evidence(np.array([0, 0, 0, 2, -1]), index, np.arange(2))
    np.testing.assert_allclose(found, [shared / asked, shared / (own + asked - shared)])


def test_each_part_of_the_evidence_is_what_it_says():
    made = localizer().localizer
    query, _ = query_at(["a"], 0.4)
    seen = describe_frame(made, query)[0]
    evidence = made.evidence(seen)
    assert evidence.values.keys() == shipped_weights().keys()
    assert sorted(evidence.places) == ["a", "b"]
    row = list(evidence.places).index("a")
    parts = {name: values[row] for name, values in evidence.values.items()}
    single = SaliencyGraphLocalizer(SaliencyGraphLocalizer.Config(detector="annotations"))
    built = LocalizationMap.build(single, FRAMES)
    assert parts["panorama"] == built.answer(seen).places[0].score
    assert parts["detected_labels"] == parts["labels_shared"] == 1  # nothing else is in the room
    assert parts["outline"] == 0  # object lists have none
    scores = {place.place: place.score for place in made.match(seen).places}
    assert scores == pytest.approx(evidence.place_scores(made.config.weights))


def test_queries_without_range_have_their_own_columns_of_evidence():
    made = localizer().localizer
    with_range = describe_frame(made, query_at(["a"], 0.4)[0])[0]
    bearings = graph_to_arrays(without_range(graph_from_arrays(with_range)))
    in_both = {
        name: [made.evidence(description).values[name] for description in (with_range, bearings)]
        for name in shipped_weights()
    }
    used = {name: [bool(values.any()) for values in both] for name, both in in_both.items()}
    assert used == {
        "likelihood": [True, False],
        "bearing_likelihood": [False, True],
        "outline": [False, False],  # object lists have none
        "panorama": [True, False],
        "detected_labels": [True, False],
        "labels_shared": [True, False],
        "bearing_detected_labels": [False, True],
    }
    assert in_both["bearing_detected_labels"][1].tolist() == in_both["detected_labels"][0].tolist()


def test_places_whose_panoramas_are_less_like_the_query_are_not_matched():
    """Of two places one candidate is matched object by object; the other ranks by its labels, and has no pose."""
    made = localizer(candidates=1)
    for room, x_m in (("a", 0.4), ("b", 5.5)):
        query, T = query_at([room], x_m)
        answer = made.localize(query)
        assert (answer.status, answer.places[0].place) == ("ok", room)
        assert len(answer.places) == 2
        assert max(pose_errors(answer.T_world_query, T)) < 0.01


def test_of_many_places_those_that_the_index_puts_first_are_ranked(monkeypatch):
    monkeypatch.setattr(places_localizer, "MAX_RANKED", 1)
    made = localizer(candidates=1)
    for room, x_m in (("a", 0.4), ("b", 5.5)):
        answer = made.localize(query_at([room], x_m)[0])
        assert [place.place for place in answer.places] == [room]


@pytest.mark.parametrize("made", [SaliencyPlacesLocalizer, SaliencyGraphLocalizer])
def test_place_only_answers_with_the_pose_of_the_map_frame(made):
    place_only = {"pose": False} if made is SaliencyPlacesLocalizer else {"positioner": None}
    made = made(made.Config(detector="annotations", **place_only))
    built = LocalizationMap.build(made, FRAMES)
    pose = {frame.id: frame.T_world_pano for frame in FRAMES}
    for room, x_m in (("a", 0.7), ("b", 5.5)):
        answer = built.localize(query_at([room], x_m)[0])
        assert (answer.status, answer.places[0].place, answer.covariance) == ("ok", room, None)
        np.testing.assert_array_equal(answer.T_world_query, pose[answer.places[0].frame])


def test_place_only_ranks_the_places_alike():
    query, _ = query_at(["a"], 0.7)
    assert localizer(pose=False).localize(query).places == localizer().localize(query).places
