"""Files and folders that are never half written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from salframe.framework.files import atomic_folder, remove_unfinished


@pytest.mark.parametrize("interrupted", [1, 2])
def test_a_folder_survives_an_interrupt_between_its_two_renames(tmp_path, monkeypatch, interrupted):
    target, rename, calls = tmp_path / "map", Path.rename, []
    target.mkdir()
    (target / "old").write_text("1")

    def interrupt(path, other):
        calls.append(path)
        if len(calls) == interrupted:
            raise KeyboardInterrupt
        return rename(path, other)

    monkeypatch.setattr(Path, "rename", interrupt)
    with pytest.raises(KeyboardInterrupt), atomic_folder(target) as folder:
        (folder / "new").write_text("2")
    assert [path.relative_to(tmp_path).as_posix() for path in sorted(tmp_path.rglob("*"))] == ["map", "map/old"]


def test_only_what_a_process_left_unfinished_is_removed(tmp_path):
    (tmp_path / "frames").mkdir()
    for name in ("frames/.00001.range-41-7.png", ".manifest-41-9.json", ".manifest-42-9.json", "00041-41-1.png"):
        (tmp_path / name).touch()
    remove_unfinished(tmp_path, 41)
    assert sorted(os.listdir(tmp_path)) == [".manifest-42-9.json", "00041-41-1.png", "frames"]
    assert os.listdir(tmp_path / "frames") == []
