"""Folders in which commands run, each in a process of its own: to be killed, or to stand in each other's way."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from command_line import Result, run, without_times
from killing import kill_at, killed, start
from small_map import write_small_map
from small_plugin import NUMBERS
from tiny_folder import write_tiny_folder

from salframe.framework.components.registry import registry

TESTS = Path(__file__).parent.parent
PLUGINS = "fake_plugin,doored_plugin,small_plugin,salframe_engines,salframe_annotations,salframe_objects"
ROOMS = ("--data", "rooms", "--set", "data.rooms=3")
INLINE = ("--engine", "inline", "--json")
EXPERIMENT = {
    "title": "Rooms",
    "question": "Which?",
    "tables": {
        name: {"title": name, "data": "rooms", "methods": ["reader"], "set": {"data.rooms": rooms}}
        for name, rooms in (("few", 2), ("more", 3))
    },
}


@dataclass(frozen=True)
class SiteResult(Result):
    """What a command said, how often it changed what is in its folder, and the modules that it imported."""

    changes: int
    modules: list[str]

    @property
    def content(self) -> Any:
        """What it said, without times, and how much was removed."""
        if self.out.startswith(("{", "[")):
            return self.code, without_times(self.json)
        return self.code, re.sub(r" in [\d.]+ s$|: removed .*$", "", self.out, flags=re.MULTILINE)


class Site:
    """Folders in which commands run, each in a process of its own, all alike in the beginning."""

    def __init__(self, root: Path) -> None:
        self._root, self._sound = root, root / "sound"
        write_tiny_folder(self._sound / "data")
        write_small_map(self._sound / "ways")
        (self._sound / "study.yaml").write_text("method: reader\nvary: {offset: [0, 1]}\ndata: rooms\n")
        (self._sound / "rooms.yaml").write_text(yaml.safe_dump(EXPERIMENT))
        (root / "numbers").mkdir()
        (root / "numbers" / "small.bin").write_bytes(NUMBERS)
        result = self.call(("compare", "--methods", "reader", *ROOMS, "--runs", "done", *INLINE), self._sound)
        assert result.code == 0, result

    def fresh(self) -> Path:
        """A folder to run commands in, in the place of the one before."""
        place = self._root / "place"
        shutil.rmtree(place, ignore_errors=True)
        return Path(shutil.copytree(self._sound, place))

    def begin(
        self, words: Sequence[str], place: Path, plugins: str = PLUGINS, step: int | None = None, **environment: str
    ) -> int:
        """The process id of a command that begins in a folder, and is killed at a `step` of its changes."""
        return start(partial(self._work, words, place, plugins, step, environment))

    def end(self, child: int) -> SiteResult | None:
        """What a command said that had begun; None where it was killed."""
        return None if killed(child) else SiteResult(*json.loads(self._result_path(child).read_text()))

    def call(self, words: Sequence[str], place: Path, plugins: str = PLUGINS, **environment: str) -> SiteResult:
        """What a command says in a folder."""
        result = self.end(self.begin(words, place, plugins, **environment))
        assert result is not None
        return result

    def _result_path(self, child: int) -> Path:
        return self._root / f"result-{child}.json"

    def _work(
        self, words: Sequence[str], place: Path, plugins: str, step: int | None, environment: Mapping[str, str]
    ) -> None:
        paths = [str(folder) for folder in (TESTS, TESTS / "navigation", TESTS / "topology", TESTS / "robustness")]
        sys.path[:0] = paths
        os.environ |= {
            "SALFRAME_PLUGINS": plugins,
            "SALFRAME_CACHE": str(place / "cache"),
            "SMALL_WEIGHTS": (self._root / "numbers").as_uri(),
            "PYTHONPATH": os.pathsep.join(paths),
            **environment,
        }
        registry.cache_clear()
        with chdir(place):
            changes = kill_at(step, place)
            result = run(*(str(next(Path().glob(word), word)) if "*" in word else word for word in words))
        self._result_path(os.getpid()).write_text(
            json.dumps([result.code, result.out, result.err, len(changes), list(sys.modules)])
        )
