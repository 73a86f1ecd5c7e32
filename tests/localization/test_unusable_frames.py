"""One rule for reference frames that a method cannot use: in build, compare and navigate."""

from __future__ import annotations

import pytest
from command_line import run
from fake_plugin import Reader, Rooms

from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError, InputMissing
from salframe.localization.map import LocalizationMap
from salframe.localization.unusable_frames import check_unusable, unusable_note
from salframe.panoramas.opening import reference_frames


def missing(count: int) -> dict[str, InputMissing]:
    return {f"frame-{number}": InputMissing(f"frame-{number} has no range") for number in range(count)}


def test_a_fifth_of_the_frames_may_be_left_out():
    check_unusable({}, 5)
    check_unusable(missing(1), 5)
    check_unusable(missing(20), 100)
    with pytest.raises(InputMissing, match=r"21 of 100 .* at most 20%: .*; the first error: frame-0 has no range"):
        check_unusable(missing(21), 100)
    with pytest.raises(InputMissing, match=r"15 of 19 reference frames .* cannot be used"):
        check_unusable(missing(15), 19)


def test_frames_that_cannot_be_read_are_an_error_of_the_data():
    with pytest.raises(DataError, match=r"2 of 4 .* the first error: a\.png is no image"):
        check_unusable({"a": DataError("a.png is no image"), "b": DataError("b.png is no image")}, 4)
    with pytest.raises(InputMissing, match="the first error: frame-0 has no range"):
        check_unusable({"a": DataError("a.png is no image"), **missing(1)}, 4)


def test_the_note_names_the_first():
    assert unusable_note({}) is None
    assert (
        unusable_note(missing(2))
        == "2 of the reference frames (panoramas of the map) left out; the first error: frame-0 has no range"
    )


def test_a_map_is_built_without_a_frame_and_refused_without_two():
    def build(*broken: str) -> tuple[LocalizationMap, list[str]]:
        notes: list[str] = []
        frames = reference_frames(Rooms(Rooms.Config(kind="rooms", broken=broken)))
        return LocalizationMap.build(Reader(Reader.Config(kind="reader")), frames, tell=notes.append), notes

    built, notes = build("map-0")
    assert [frame.id for frame in built.frames] == ["map-1", "map-2", "map-3", "map-4"]
    assert notes == [
        "1 of the reference frames (panoramas of the map) left out; the first error: map-0.png is no image"
    ]
    with pytest.raises(DataError, match=r"2 of 5 reference frames .* cannot be used"):
        build("map-0", "map-1")


PARTIAL = """
import salframe
from fake_plugin import Reader, Rooms
from salframe.framework.errors import InputMissing

class Partial(Reader):
    '''Reads reference frames, and queries up to a room.'''
    name = 'partial'

    class Config(Reader.Config):
        last: int = 0
        last_reference: int = 99

    def describe(self, panorama):
        room, column = panorama.rgb[0, 0, :2].tolist()
        if room > (self.config.last if column else self.config.last_reference):
            raise InputMissing(f'{panorama.id} has no range')
        return super().describe(panorama)

    def describe_identity(self):
        return {'name': self.name, 'last': self.config.last, 'reference': self.config.last_reference}

@salframe.hookimpl
def salframe_provides():
    return [Rooms, Reader, Partial]
"""


@pytest.fixture
def partial(tmp_path, monkeypatch):
    """The components of PARTIAL as the only ones, and the engines."""
    (tmp_path / "partial_plugin.py").write_text(PARTIAL)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("SALFRAME_PLUGINS", "partial_plugin,salframe_engines")
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    registry.cache_clear()
    yield
    registry.cache_clear()


@pytest.mark.parametrize(
    ("settings", "status", "ended", "code"),
    [
        (("last=2",), {"ok": 6, "input-missing": 4}, "done", 0),
        (("last=-1",), {"input-missing": 10}, "unavailable", 1),
        (("last_reference=2",), {}, "unavailable", 1),
    ],
)
def test_a_missing_input_is_no_crash(partial, settings, status, ended, code):
    sets = [part for setting in settings for part in ("--set", setting)]
    done = run("compare", "--methods", "partial", "--data", "rooms", "--engine", "inline", "--json", *sets)
    (row,) = done.json["rows"]
    assert (done.code, row["ended"], row["status"]) == (code, ended, status)
    assert "has no range" in (row["reason"] or row["errors"]["input-missing"])
    again = run("evaluate", done.json["run"], "--json").json["rows"][0]
    assert (again["ended"], again["status"]) == (ended, status)
