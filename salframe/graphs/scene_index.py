"""The role `scene-index`: it finds the scenes of a large map that are worth matching to a query."""

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
    """K scenes worth matching, best first; of equal scores the lower number comes first.

    Attributes:
        scene: (K,) int64, numbers of the scenes in the map.
        score: (K,) float64, finite, larger is better.
    """

    scene: np.ndarray
    score: np.ndarray

    def __len__(self) -> int:
        return len(self.scene)


class SceneLookup(Protocol):
    """Anything that returns the scenes worth matching."""

    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        """See SceneIndex."""


class SceneIndex(Role):
    """Finds the scenes of a large map that are worth matching, with an index in a folder that is mapped into memory."""

    role = "scene-index"
    word = "scene index"

    @classmethod
    def note(cls, config: Any, num_scenes: int) -> str | None:
        """Return what a user should know about an index with this config of this many scenes; None where there is
        nothing, which is the default."""
        return None

    @abstractmethod
    def build(self, graphs: Iterable[SaliencyGraph], folder: Path) -> None:
        """Write an index of a map's graphs, scenes 0, 1, 2, ..., to a new folder, which appears whole. The graphs come
        one by one; memory must not grow with their number. Raises ConfigError where the folder exists."""

    @abstractmethod
    def open(self, folder: Path) -> None:
        """Use the index in a folder, which may be removed meanwhile. Raises DataError where `build` wrote none."""

    @abstractmethod
    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        """Return at most `count` scenes of the open index, none that shares nothing with the query. The query may have
        bearings only, see SaliencyGraph."""

    def take(self, graphs: Iterable[SaliencyGraph]) -> None:
        """Build an index of a map's graphs and open it, in a temporary folder that lives as long as this object."""
        folder = Path(tempfile.mkdtemp(prefix="salframe-"))
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.build(graphs, folder / "index")
        self.open(folder / "index")


def scene_index_notes(config: Any, num_scenes: int) -> list[str]:
    """Return the notes of all scene indexes in a configuration, in its slots and those of its components, each once."""
    notes: dict[str, None] = {}
    for _, inner in components_in(config):
        kind = inner.component
        note = kind.note(inner, num_scenes) if issubclass(kind, SceneIndex) else None
        notes |= dict.fromkeys([note] if note else scene_index_notes(inner, num_scenes))
    return list(notes)
