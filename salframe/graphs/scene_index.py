"""The role `scene-index`: selects the scenes of a large map that are matched with a query. A scene is the graph of one
reference frame."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from salframe.framework.component import Role, components_in
from salframe.graphs.graph import SaliencyGraph


@dataclass(frozen=True, eq=False)
class SceneCandidates:
    """K candidate scenes (graphs of reference frames) of a map, best first. Scenes with equal scores are sorted by
    index.

    Attributes:
        scene: (K,) int64, indices of the scenes in the map.
        score: (K,) float64, finite, larger is better.
    """

    scene: np.ndarray
    score: np.ndarray

    def __len__(self) -> int:
        return len(self.scene)


class SceneLookup(Protocol):
    """Protocol of an open scene index, which selects the scenes (graphs of reference frames) that are matched with a
    query."""

    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        """Return at most `count` candidate scenes (graphs of reference frames), as `SceneIndex.candidates`."""


class SceneIndex(Role):
    """Selects the reference frames of a large map that are compared with a query, by an index on disk."""

    role = "scene-index"
    word = "scene index"

    @classmethod
    def note(cls, config: Any, num_scenes: int) -> str | None:
        """Return a message for the user about using this index on `num_scenes` scenes (graphs of reference frames);
        None (the default): no message."""
        return None

    @abstractmethod
    def build(self, graphs: Iterable[SaliencyGraph], folder: Path) -> None:
        """Write an index of a map's graphs to a new folder, in one atomic step.

        Args:
            graphs: The graphs of scenes 0, 1, 2, ..., as a stream. The memory use must not grow with the number of
                graphs.
            folder: The folder to write.

        Raises:
            ConfigError: The folder exists.
        """

    @abstractmethod
    def open(self, folder: Path) -> None:
        """Open the index in a folder, which may be removed while the index is open.

        Raises:
            DataError: The folder holds no index written by `build`.
        """

    @abstractmethod
    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        """Return at most `count` scenes (graphs of reference frames) of the open index, best first.

        Scenes that share nothing with the query are left out. If the query has no range, the sizes and centroids of its
        objects are NaN (see SaliencyGraph).
        """

    def take(self, graphs: Iterable[SaliencyGraph]) -> None:
        """Build an index of a map's graphs and open it, in a temporary folder that is removed with this object."""
        folder = Path(tempfile.mkdtemp(prefix="salframe-"))
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.build(graphs, folder / "index")
        self.open(folder / "index")


def scene_index_notes(config: Any, num_scenes: int) -> list[str]:
    """Return the notes (`SceneIndex.note`) of all scene indexes in a configuration and its nested components, without
    duplicates."""
    notes: dict[str, None] = {}
    for _, inner in components_in(config):
        kind = inner.component
        note = kind.note(inner, num_scenes) if issubclass(kind, SceneIndex) else None
        notes |= dict.fromkeys([note] if note else scene_index_notes(inner, num_scenes))
    return list(notes)
