"""The scene index `by-size`: selects another index by the number of scenes and the installed packages."""

from __future__ import annotations

import importlib.util
from collections import deque
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from pathlib import Path
from typing import Any

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_model
from salframe.framework.files.writing import new_folder, write_json
from salframe.framework.validation import Settings
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.scene_index import SceneCandidates, SceneIndex
from salframe_graphs.retrieval.compiled_lists import CompiledLists
from salframe_graphs.retrieval.inverted_lists import InvertedLists

MAX_PLAIN = 10_000
"""Maximum number of scenes for `inverted-lists`. A query then takes about 12 ms, matching included."""
_CHOICE, _INDEX = "choice.json", "index"
_KINDS = {kind.name: kind for kind in (InvertedLists, CompiledLists)}


def choose_scene_index(num_scenes: int) -> tuple[type[SceneIndex], str | None]:
    """Return the scene index for a number of scenes (graphs of reference frames), and a note for the user.

    The note is None for up to MAX_PLAIN scenes.
    """
    if num_scenes <= MAX_PLAIN:
        return InvertedLists, None
    size = f"the map has over {MAX_PLAIN:,} panoramas"
    if importlib.util.find_spec("numba") is None:
        return InvertedLists, f"{size}: for faster queries, pip install 'salframe[fast]' and build the map again"
    return (
        CompiledLists,
        f"{size}: the scene index {CompiledLists.name} selects the part of the map that is compared with each query",
    )


class _IndexChoice(Settings):
    """The content of choice.json: the scene index that was selected when the map was built."""

    kind: str


class BySize(SceneIndex):
    """Uses `compiled-lists` for a map of over 10,000 reference frames, and `inverted-lists` for other maps.

    Without numba, `inverted-lists` is used for all maps. Both indexes have their default settings. The index is chosen
    when the map is built.
    """

    name = "by-size"
    version = "1"

    @classmethod
    def note(cls, config: Any, num_scenes: int) -> str | None:
        return choose_scene_index(num_scenes)[1]

    def build(self, graphs: Iterable[SaliencyGraph], folder: Path) -> None:
        stream = iter(graphs)
        first = deque(islice(stream, MAX_PLAIN + 1))
        kind, _ = choose_scene_index(len(first))
        with new_folder(folder) as parts:
            kind().build(chain(_drain(first), stream), parts / _INDEX)
            write_json(parts / _CHOICE, {"kind": kind.name})

    def open(self, folder: Path) -> None:
        if not (folder / _CHOICE).exists():
            raise DataError(
                f"{folder} has no scene index: build the map again, or only the index with SceneIndex.build"
            )
        kind = read_model(folder / _CHOICE, _IndexChoice).kind
        if kind not in _KINDS:
            raise DataError(
                f"{folder} has a scene index of the kind {kind!r}, expected one of {', '.join(_KINDS)}: "
                "build the map again, or only the index with SceneIndex.build"
            )
        self._index = _KINDS[kind]()
        self._index.open(folder / _INDEX)

    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        return self._index.candidates(query, count)


def _drain(graphs: deque[SaliencyGraph]) -> Iterator[SaliencyGraph]:
    """Yield graphs in order, and remove each from the deque to free its memory."""
    while graphs:
        yield graphs.popleft()
