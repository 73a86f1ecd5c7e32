"""The folder of a map: replaced whole, and refused where it was edited or is not whole."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest

from salframe.framework.errors import ConfigError, DataError
from salframe.localization.map_files import MAP, MAP_FORMAT, MapParts, check_output, read_map, write_map


def write(directory: Path, text: str) -> None:
    with write_map(directory) as parts:
        (parts.folder / "frames").mkdir()
        (parts.folder / "frames" / "ids.txt").write_text(text)
        (parts.folder / "scenes.txt").write_text(text)


def read(parts: MapParts) -> list[str]:
    return [(parts.folder / "frames" / "ids.txt").read_text(), (parts.folder / "scenes.txt").read_text()]


def parts_of(directory: Path) -> Path:
    """The one folder of parts that there is."""
    (parts,) = directory.glob("parts-*")
    return parts


def test_a_map_is_replaced_and_nothing_of_the_old_stays(tmp_path):
    for text in ("one", "two", "two"):
        write(tmp_path / "map", text)
        assert read_map(tmp_path / "map", read) == [text, text]
        assert sorted(path.name for path in (tmp_path / "map").iterdir()) == [MAP, parts_of(tmp_path / "map").name]


def test_what_else_lies_in_the_folder_stays(tmp_path):
    write(tmp_path / "map", "one")
    (tmp_path / "map" / "map.png").write_text("drawn")
    write(tmp_path / "map", "two")
    assert (tmp_path / "map" / "map.png").read_text() == "drawn"


@pytest.mark.parametrize("before", [None, "one"])
def test_a_build_that_fails_changes_nothing(tmp_path, before):
    if before:
        write(tmp_path / "map", before)

    def fail():
        with write_map(tmp_path / "map") as parts:
            (parts.folder / "scenes.txt").write_text("two")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert (tmp_path / "map").exists() == bool(before)
    if before:
        assert read_map(tmp_path / "map", read) == ["one", "one"]
        assert parts_of(tmp_path / "map")


def test_a_map_moves_with_its_folder(tmp_path):
    write(tmp_path / "map", "one")
    shutil.move(tmp_path / "map", tmp_path / "other")
    assert read_map(tmp_path / "other", read) == ["one", "one"]


def test_what_was_edited_or_lost_is_one_line(tmp_path):
    for damage, message in (
        (lambda parts: (parts / "scenes.txt").write_text("0ne"), r"scenes\.txt was changed after the map"),
        (lambda parts: (parts / "scenes.txt").write_text("on"), r"scenes\.txt was changed after the map"),
        (lambda parts: (parts / "frames" / "ids.txt").unlink(), r"frames/ids\.txt is missing: build the map again"),
        (lambda parts: shutil.rmtree(parts), r"ids\.txt is missing: build the map again"),
    ):
        write(tmp_path / "map", "one")
        damage(parts_of(tmp_path / "map"))
        with pytest.raises(DataError, match=message) as caught:
            read_map(tmp_path / "map", read)
        assert "\n" not in str(caught.value)


def test_parts_of_two_maps_are_refused(tmp_path):
    """The scenes of one with the frames of another, the hashes of either."""
    for name in ("one", "two"):
        write(tmp_path / name, name)
    for name, other in (("one", "two"), ("two", "one")):
        shutil.copytree(tmp_path / name, tmp_path / f"mixed-{name}")
        shutil.copy(parts_of(tmp_path / other) / "scenes.txt", parts_of(tmp_path / f"mixed-{name}"))
        with pytest.raises(DataError, match=r"scenes\.txt was changed after the map was built"):
            read_map(tmp_path / f"mixed-{name}", read)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[]", r"map\.json contains a list, expected a JSON object"),
        ("{", r"map\.json is not JSON"),
        (json.dumps({"format": MAP_FORMAT}), r"map\.json: the required key parts is missing"),
        (
            json.dumps({"parts": "parts-0123456789abcdef", "sha256": {}}),
            r"has no `format` in map\.json, expected 8: build",
        ),
        (json.dumps({"format": 2}), r"has map format 2, expected 8: build the map again"),
        (
            json.dumps({"format": MAP_FORMAT + 1, "parts": "parts-01"}),
            r"has map format 9, expected 8: a newer version of salframe wrote it, pip install --upgrade salframe$",
        ),
        (json.dumps({"format": MAP_FORMAT, "parts": "../elsewhere", "sha256": {}}), r"map\.json: key parts: received"),
    ],
)
def test_a_map_file_that_is_none_is_one_line(tmp_path, content, message):
    (tmp_path / MAP).write_text(content)
    with pytest.raises(DataError, match=message) as caught:
        read_map(tmp_path, read)
    assert "\n" not in str(caught.value)
    write(tmp_path, "one")  # it may be built again
    assert read_map(tmp_path, read) == ["one", "one"]


def test_no_map_is_one_line(tmp_path):
    for directory in (tmp_path, tmp_path / "absent"):
        with pytest.raises(DataError, match=r"contains no map: build one with salframe build DATA -o "):
            read_map(directory, read)


def test_a_map_that_is_replaced_while_it_is_read_is_read_anew(tmp_path):
    write(tmp_path / "map", "one")
    seen = []

    def read_slowly(parts: MapParts) -> list[str]:
        first = (parts.folder / "frames" / "ids.txt").read_text()
        if not seen:
            write(tmp_path / "map", "two")
        seen.append(first)
        return [first, (parts.folder / "scenes.txt").read_text()]

    assert read_map(tmp_path / "map", read_slowly) == ["two", "two"]
    assert seen == ["one", "two"]


def test_another_folder_is_not_written_to(tmp_path):
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "thesis.tex").write_text("years")
    (tmp_path / "file").write_text("years")
    for name in ("work", "file"):
        with pytest.raises(ConfigError, match=f"{name} contains files that are not a map"):
            write(tmp_path / name, "one")
    assert [path.name for path in (tmp_path / "work").iterdir()] == ["thesis.tex"]


def test_what_a_killed_first_build_left_may_become_a_map(tmp_path):
    for folder in ("parts-0011223344556677", "parts-8899aabbccddeeff"):
        (tmp_path / "map" / folder).mkdir(parents=True)
        (tmp_path / "map" / folder / "scenes.txt").write_text("ha")
    check_output(tmp_path / "map")
    write(tmp_path / "map", "one")
    assert read_map(tmp_path / "map", read) == ["one", "one"]
    assert parts_of(tmp_path / "map")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no lock of folders")
def test_two_builds_into_one_folder_do_not_mix(tmp_path):
    with write_map(tmp_path / "map") as parts:
        (parts.folder / "scenes.txt").write_text("one")
        with pytest.raises(
            ConfigError, match=r"another process writes to .*map: wait until that process ends, or name a new folder"
        ):
            write(tmp_path / "map", "two")
        (parts.folder / "frames").mkdir()
        (parts.folder / "frames" / "ids.txt").write_text("one")
    assert read_map(tmp_path / "map", read) == ["one", "one"]
    write(tmp_path / "map", "two")
    assert read_map(tmp_path / "map", read) == ["two", "two"]
