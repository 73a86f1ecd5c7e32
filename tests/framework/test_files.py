"""Files that are never half written."""

from __future__ import annotations

import os

from salframe.framework.files import remove_unfinished


def test_only_what_a_process_left_unfinished_is_removed(tmp_path):
    (tmp_path / "frames").mkdir()
    for name in ("frames/.00001.range-41-7.png", ".manifest-41-9.json", ".manifest-42-9.json", "00041-41-1.png"):
        (tmp_path / name).touch()
    remove_unfinished(tmp_path, 41)
    assert sorted(os.listdir(tmp_path)) == [".manifest-42-9.json", "00041-41-1.png", "frames"]
    assert os.listdir(tmp_path / "frames") == []
