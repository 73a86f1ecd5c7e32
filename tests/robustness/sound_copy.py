"""A copy of sound files that damage and commands change, and that is restored by copying only what changed."""

from __future__ import annotations

import shutil
import stat
from functools import cache
from pathlib import Path
from typing import NamedTuple


class Entry(NamedTuple):
    """The kind of a file, and its size and modification time; None for folders."""

    kind: int
    size: int | None
    modified_ns: int | None


def list_entries(root: Path) -> dict[Path, Entry]:
    """Return all files and folders in a folder, by their path in it."""
    entries = {}
    for path in root.rglob("*"):
        state = path.lstat()
        kind = stat.S_IFMT(state.st_mode)
        is_folder = kind == stat.S_IFDIR
        content = (None, None) if is_folder else (state.st_size, state.st_mtime_ns)
        entries[path.relative_to(root)] = Entry(kind, *content)
    return entries


def restore(sound: Path, copy: Path) -> Path:
    """Make a folder a copy of a sound one, which does not change; returns it."""
    copy.mkdir(parents=True, exist_ok=True)
    sound_entries, entries = _list_sound(sound), list_entries(copy)
    unchanged = {name for name, entry in entries.items() if sound_entries.get(name) == entry}
    for name in sorted(entries.keys() - unchanged, reverse=True):
        path = copy / name
        if entries[name].kind == stat.S_IFDIR:
            shutil.rmtree(path)
        else:
            path.unlink()
    for name in sorted(sound_entries.keys() - unchanged):
        if sound_entries[name].kind == stat.S_IFDIR:
            (copy / name).mkdir()
        else:
            shutil.copy2(sound / name, copy / name)
    return copy


_list_sound = cache(list_entries)
