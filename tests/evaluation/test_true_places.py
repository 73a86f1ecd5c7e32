"""True places that the map lacks, and names that differ only in their spelling."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping

import numpy as np
import pytest
from command_line import run
from fake_plugin import Rooms

from salframe.evaluation.true_places import place_key, places_notes
from salframe.panoramas.frames import Truth

COMPOSED, DECOMPOSED = (unicodedata.normalize(form, "Küche") for form in ("NFC", "NFD"))


class Renamed(Rooms):
    """Rooms whose queries have other true places, by id."""

    names: Mapping[str, str]

    def truth(self, query_id: str) -> Truth:
        return Truth(self.names.get(query_id, super().truth(query_id).place), np.eye(4))


def notes(**names: str) -> list[str]:
    dataset = Renamed(Rooms.Config(kind="rooms"))
    dataset.names = {f"query-{key[1:]}".replace("_", "-"): name for key, name in names.items()}
    return places_notes(dataset)


def test_places_of_the_map_have_no_note():
    assert notes() == []


@pytest.mark.parametrize("name", ["Room-1", " room-1 ", "room_1", "room 1", "ROOM-1"])
def test_another_spelling_of_a_place_is_named(name):
    (note,) = notes(q1_0=name, q1_1=name)
    assert note.startswith("warning: the true place of 2 queries counts as out of map, because the map has")
    assert f"{name!r} (did you mean 'room-1'?)" in note


def test_a_place_that_is_not_mapped_is_no_other_spelling():
    (note,) = notes(q0_0="garage", q0_1="garage", q1_0="room-9")
    assert (
        note == "the true place of 3 queries is not in the map, so the correct answer is out-of-map: 'garage', 'room-9'"
    )


def test_at_most_three_names_are_listed():
    (note,) = notes(**{f"q{room}_0": f"cellar {room}" for room in range(5)})
    assert note.endswith("'cellar 0', 'cellar 1', 'cellar 2' and 2 more")


def test_names_that_look_the_same_have_one_key():
    assert COMPOSED != DECOMPOSED
    assert place_key(COMPOSED) == place_key(DECOMPOSED) == place_key(" KÜCHE\t")
    assert place_key("room 1") != place_key("room 2")


def test_a_comparison_without_queries_in_the_map_is_measured(plugins, tmp_path):
    """AxisError after all queries ran, once."""
    (tmp_path / "moved_plugin.py").write_text(
        "import salframe\nfrom fake_plugin import Reader, Rooms\nfrom salframe.panoramas.frames import Truth\n\n"
        "class Moved(Rooms):\n    '''Rooms.'''\n    name = 'moved'\n"
        "    def truth(self, query_id):\n        return Truth('garage', None)\n\n"
        "@salframe.hookimpl\ndef salframe_provides():\n    return [Moved, Reader]\n"
    )
    plugins("moved_plugin", "salframe_engines")
    done = run("compare", "--methods", "reader", "--data", "moved", "--engine", "inline", "--json")
    assert done.code == 0
    (row,) = done.json["rows"]
    assert (row["accuracy"], row["absent_queries"], row["macro_recall"]) == (0.0, 10, None)
    assert (
        "the true place of 10 queries is not in the map, so the correct answer is out-of-map: 'garage'"
        in done.json["notes"]
    )
    for command in (("evaluate", done.json["run"]), ("report", done.json["run"])):
        assert run(*command).code == 0
