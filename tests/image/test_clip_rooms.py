from __future__ import annotations

import json

import numpy as np
import pytest
from compass import HEIGHT
from conformance import conforms
from salframe_image.clip import MEAN, STD, ClipRooms, room_type

from salframe.framework.components.identity import identity
from salframe.framework.errors import InputMissing, WeightsError
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import FrameKind, QueryFrame, ReferenceFrame
from salframe.panoramas.panorama import Panorama

pytest.importorskip("tokenizers")
WORDS = {"a": 0, "red": 1, "green": 2, "blue": 3}
EMBEDDINGS = np.array([[0, 0, 0], [2, -1, -1], [-1, 2, -1], [-1, -1, 2]], np.float32)
"""Embeddings of words, which the text encoder of the tests sums over a prompt."""
COLOURS = {
    "red": (230, 40, 40),
    "green": (40, 230, 40),
    "blue": (40, 40, 230),
    "grey-blue": (90, 90, 150),
    "grey-red": (145, 110, 95),
}


@pytest.fixture
def folder(write_network, tmp_path):
    """A CLIP whose image encoder returns the mean of its input, and its text encoder the sum of EMBEDDINGS of words."""
    from onnx import TensorProto, helper

    write_network("onnx/vision_model.onnx", [helper.make_node("ReduceMean", ["x"], ["y"], axes=[2, 3], keepdims=0)])
    summed = [
        helper.make_node("Gather", ["table", "input_ids"], ["rows"]),
        helper.make_node("ReduceSum", ["rows", "axes"], ["y"], keepdims=0),
    ]
    constants = {"table": EMBEDDINGS, "axes": np.array([1])}
    write_network("onnx/text_model.onnx", summed, ("n", "length"), TensorProto.INT64, constants, "input_ids")
    words = {"type": "WordLevel", "vocab": WORDS, "unk_token": "a"}
    parts = dict.fromkeys(("normalizer", "post_processor", "decoder", "truncation", "padding"))
    (tmp_path / "tokenizer.json").write_text(
        json.dumps(
            {"version": "1.0", "added_tokens": [], "pre_tokenizer": {"type": "Whitespace"}, "model": words, **parts}
        )
    )
    return tmp_path


@pytest.fixture
def build(folder):
    """Return a map of rooms with these names, each in one colour of COLOURS."""

    def make(rooms: dict[str, str], **settings) -> LocalizationMap:
        localizer = ClipRooms(ClipRooms.Config(checkpoint=folder, views=4, hfov_deg=80, **settings))
        return LocalizationMap.build(
            localizer,
            [
                ReferenceFrame(place, place, np.eye(4), load=lambda colour=colour: painted(colour))
                for place, colour in rooms.items()
            ],
        )

    return make


def painted(colour: str, other: str | None = None) -> Panorama:
    """Return a panorama of one colour, or with another one at azimuths from 135 to 315 degrees, in the last two of four
    views."""
    rgb = np.full((HEIGHT, 2 * HEIGHT, 3), COLOURS[colour], np.uint8)
    if other:
        rgb[:, np.arange(2 * HEIGHT) < HEIGHT // 4] = rgb[:, np.arange(2 * HEIGHT) >= HEIGHT + HEIGHT // 4] = COLOURS[
            other
        ]
    return Panorama(colour, rgb)


def share(*colours: str, types: tuple[str, ...] = ("blue", "green", "red")) -> np.ndarray:
    """Return the room type probabilities for views of these colours: the mean of softmax(100 cos) over views."""
    prompts = EMBEDDINGS[[WORDS[word] for word in types]].astype(float)
    rows = []
    for colour in colours:
        colour_input = (np.array(COLOURS[colour]) - MEAN) / STD
        weight = np.exp(100 * prompts @ colour_input / np.linalg.norm(colour_input) / np.sqrt(6))
        rows.append(weight / weight.sum())
    return np.mean(rows, 0)


ROOMS = {"red-01": "red", "green-01": "green", "blue-01": "blue", "green-02": "grey-blue"}


def ask(known: LocalizationMap, panorama: Panorama):
    return known.answer(known.localizer.describe(panorama))


def test_places_are_ranked_by_how_alike_their_room_types_are(build):
    answer = ask(build(ROOMS), painted("blue"))
    assert (answer.status, answer.T_world_query) == ("no-pose", None)
    expected = {place: np.sqrt(share(colour) * share("blue")).sum() for place, colour in ROOMS.items()}
    assert [ranked.place for ranked in answer.places] == sorted(ROOMS, key=expected.get, reverse=True)
    assert answer.places[0].place == "blue-01"
    for ranked in answer.places:
        assert ranked.score == pytest.approx(expected[ranked.place], abs=2e-2)


def test_probabilities_are_averaged_over_the_views(build):
    answer = ask(build(ROOMS), painted("grey-red", "green"))
    expected = {place: np.sqrt(share(colour) * share("grey-red", "green")).sum() for place, colour in ROOMS.items()}
    assert 0.5 < expected["green-01"] < 0.9
    for ranked in answer.places:
        assert ranked.score == pytest.approx(expected[ranked.place], abs=2e-2)


def test_equal_scores_are_in_the_order_of_the_names(build):
    answer = ask(build({"red-02": "red", "red-01": "red", "green-01": "green"}), painted("red"))
    assert [ranked.place for ranked in answer.places] == ["red-01", "red-02", "green-01"]


def test_one_map_frame_is_enough(build):
    answer = ask(build({"red-01": "red"}), painted("blue"))
    assert [(ranked.place, ranked.score) for ranked in answer.places] == [
        ("red-01", pytest.approx(1))
    ]  # all rooms have the same single type


def test_room_types_are_those_of_scenes_unless_others_are_named(build, folder):
    localizer = ClipRooms(ClipRooms.Config(checkpoint=folder, views=4, hfov_deg=80))
    frames = [
        ReferenceFrame("1", "red-01", np.eye(4)),
        ReferenceFrame("2", "blue", np.eye(4)),
        ReferenceFrame("3", "green-01", np.eye(4), FrameKind.TRANSITION),
    ]
    described = [localizer.describe(painted(colour)) for colour in ("red", "blue", "green")]
    known = LocalizationMap.from_descriptions(localizer, described, frames)
    scores = {ranked.place: ranked.score for ranked in ask(known, painted("blue")).places}
    assert scores["green-01"] == pytest.approx(
        np.sqrt(np.prod([share(c, types=("blue", "red")) for c in ("green", "blue")], 0)).sum(), abs=1e-2
    )
    assert scores["green-01"] > 0.9  # closer to blue than to red; with the type green it would be 0
    answer = ask(build(ROOMS, room_types=("green", "red", "blue"), prompt="a a {}"), painted("red"))
    assert answer.places[0].place == "red-01"


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("kitchen-01", "kitchen"),
        ("dining-room-12", "dining room"),
        ("living_room", "living room"),
        ("17DRP/bedroom 3", "bedroom"),
        ("12", "12"),
    ],
)
def test_a_room_type_is_the_places_name_without_its_number(place, words):
    assert room_type(place) == words


def test_where_nothing_is_seen_there_is_no_answer(build):
    nothing = Panorama("nothing", painted("red").rgb, valid=np.zeros((HEIGHT, 2 * HEIGHT), bool))
    answer = ask(build(ROOMS), nothing)
    assert (answer.status, answer.places) == ("no-features", ())


def test_a_panorama_without_colour_is_refused(build):
    with pytest.raises(InputMissing, match="the method 'clip-rooms' needs rgb, which panorama dark does not have"):
        build(ROOMS).localize(QueryFrame("dark", lambda: Panorama("dark", range_m=np.ones((64, 128), np.float32))))


def test_without_clip_the_row_says_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path))
    with pytest.raises(
        WeightsError, match=r"vision_model\.onnx is missing .*download it with: salframe weights fetch clip-vit-b32"
    ):
        ClipRooms.check(ClipRooms.Config())


def test_a_file_that_is_no_tokenizer_is_one_line(folder, build):
    (folder / "tokenizer.json").write_text("{}")
    with pytest.raises(WeightsError, match=r"tokenizer\.json is not a tokenizer file .*: ."):
        build(ROOMS)


def test_another_text_encoder_is_one_line(folder, build, write_network):
    from onnx import helper

    write_network("onnx/text_model.onnx", [helper.make_node("Identity", ["pixel_values"], ["y"])], taken="pixel_values")
    with pytest.raises(
        WeightsError,
        match=r"text_model\.onnx has the input tensors pixel_values; expected input_ids, and optionally attention_mask",
    ):
        build(ROOMS)


def test_another_image_encoder_is_one_line(folder, build, write_network):
    from onnx import helper

    write_network("onnx/vision_model.onnx", [helper.make_node("Identity", ["x"], ["y"])])
    with pytest.raises(
        WeightsError, match=r"vision_model\.onnx returned an array of shape \(4, 3, 224, 224\); expected shape \(N, D\)"
    ):
        build(ROOMS)


def test_it_keeps_the_promises_of_a_localizer(folder):
    assert conforms(ClipRooms, ClipRooms.Config(checkpoint=folder, views=2, room_types=("red", "green", "blue")))


def test_descriptions_are_known_by_the_checkpoints_content_and_not_by_prompts(folder):
    def cache_key(**settings):
        config = ClipRooms.Config(checkpoint=folder, views=2, **settings)
        return identity(config), ClipRooms(config).describe_identity()

    before = cache_key()
    for change in ({"prompt": "the {}"}, {"room_types": ("red",)}):
        assert cache_key(**change)[0] != before[0]
        assert cache_key(**change)[1] == before[1]
    path = folder / "onnx" / "vision_model.onnx"
    path.write_bytes(path.read_bytes() + b"\x12\x04test")  # another field of the file: its producer's name
    after = cache_key()
    assert before[0] != after[0]
    assert before[1] != after[1]
