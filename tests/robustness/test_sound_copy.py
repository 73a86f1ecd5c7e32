"""A copy of sound files is restored after any damage."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from sound_copy import restore


def write_sound(root: Path) -> Path:
    (root / "a" / "b").mkdir(parents=True)
    (root / "a" / "b" / "one").write_text("1")
    (root / "two").write_text("2")
    return root


def read_all(root: Path) -> dict[str, str | None]:
    paths = sorted(root.rglob("*"))
    return {str(path.relative_to(root)): path.read_text() if path.is_file() else None for path in paths}


@pytest.mark.parametrize(
    "change",
    [
        lambda root: None,
        lambda root: (root / "two").write_text("3"),
        lambda root: (root / "two").unlink(),
        lambda root: ((root / "two").unlink(), (root / "two").mkdir(), (root / "two" / "three").write_text("3")),
        lambda root: ((root / "two").unlink(), os.mkfifo(root / "two")),
        lambda root: ((root / "two").unlink(), (root / "two").symlink_to("/dev/zero")),
        lambda root: (shutil.rmtree(root / "a"), (root / "a").write_text("a")),
        lambda root: shutil.rmtree(root),
        lambda root: ((root / "a" / "c").mkdir(), (root / "a" / "c" / "three").write_text("3")),
    ],
)
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no FIFOs")
def test_a_copy_is_restored(tmp_path, change):
    sound = write_sound(tmp_path / "sound")
    copy = restore(sound, tmp_path / "copy")
    change(copy)
    assert read_all(restore(sound, copy)) == {"a": None, "a/b": None, "a/b/one": "1", "two": "2"}
