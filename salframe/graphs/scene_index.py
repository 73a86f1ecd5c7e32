"""The role `scene-index`: of a map of many scenes, those that are worth matching to a query."""

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

from salframe.framework.component import Role
from salframe.framework.config import components_in
from salframe.graphs.graph import SaliencyGraph


@dataclass(frozen=True, eq=False)
class SceneCandidates:
    """K scenes worth matching, best first: scene (K,) int64, their numbers in the map; score (K,) float64, finite,
    larger is better. Of equal scores the lower number comes first."""

    scene: np.ndarray
    score: np.ndarray

    def __len__(self) -> int:
        return len(self.scene)


class SceneLookup(Protocol):
    """Whatever tells which scenes are worth matching."""

    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        """See SceneIndex."""


class SceneIndex(Role):
    """Keeps what it takes to find a query's scene among many in a folder, which is read by mapping it into memory."""

    role = "scene-index"
    word = "scene index"

    @classmethod
    def note(cls, config: Any, num_scenes: int) -> str | None:
        """Return what a user should know about an index with this config of this many scenes; None where there is
        nothing, which is the default."""
        return None

    @abstractmethod
    def build(self, graphs: Iterable[SaliencyGraph], folder: Path) -> None:
        """Index a map's graphs, scenes 0, 1, 2, ..., into a new folder, which appears whole. The graphs come one by one
        and are not kept: memory does not grow with their number. Raises ConfigError where the folder is there."""

    @abstractmethod
    def open(self, folder: Path) -> None:
        """Use the index in a folder, which may be removed while it is in use. Raises DataError where there is none that
        `build` wrote."""

    @abstractmethod
    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        """At most `count` scenes of the index that is open; none that shares nothing with the query, which may have
        bearings only (SaliencyGraph)."""

    def take(self, graphs: Iterable[SaliencyGraph]) -> None:
        """Index a map's graphs and use the index, which is kept in a temporary folder while this object is in use."""
        folder = Path(tempfile.mkdtemp(prefix="salframe-"))
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.build(graphs, folder / "index")
        self.open(folder / "index")


def scene_index_notes(config: Any, num_scenes: int) -> list[str]:
    """Return the notes of all scene indexes in a configuration, in its slots and those of its components, each once."""
    notes: dict[str, None] = {}
    for _, inner in components_in(config):
        kind = inner.component
        own = kind.note(inner, num_scenes) if issubclass(kind, SceneIndex) else None
        notes |= dict.fromkeys([own] if own else scene_index_notes(inner, num_scenes))
    return list(notes)
