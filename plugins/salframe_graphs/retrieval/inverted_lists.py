"""The scene index `inverted-lists`: by labels, heights and sizes of objects, wherever they stand."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from salframe.framework.config import ComponentConfig, match_only
from salframe.framework.files import new_folder
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.scene_index import SceneCandidates, SceneIndex
from salframe_graphs.retrieval import scoring
from salframe_graphs.retrieval.postings import CODE_LOW, CODE_STEP, appearance, read_postings, write_postings
from salframe_graphs.retrieval.scoring import Asked

LARGE = 10_000
"""So many scenes are worth the time that it takes to import numba."""


class InvertedLists(SceneIndex):
    """Scenes by the Jaccard index of their objects and the query's, weighed by the rarity of labels: an object shares
    as much as the most alike of its label is alike in height, length and box height. Compiled where numba is installed
    (`salframe[fast]`), with the same candidates without."""

    name = "inverted-lists"
    version = "1"

    class Config(ComponentConfig):
        height_scale_m: float = match_only(0.2, gt=0, description="difference in height that halves likeness")
        size_scale: tuple[float, float] = match_only(
            (0.8, 0.5), description="log ratios of box length and box height that halve likeness"
        )

    def build(self, graphs: Iterable[SaliencyGraph], folder: Path) -> None:
        with new_folder(folder) as parts:
            write_postings(graphs, parts)

    def open(self, folder: Path) -> None:
        self._postings = read_postings(folder)
        self._scoring = scoring
        if len(self._postings.weight) >= LARGE and importlib.util.find_spec("numba") is not None:
            self._scoring = importlib.import_module("salframe_graphs.retrieval.compiled")

    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        scene, score = self._scoring.best_scenes(self._postings, self._asked(query), max(count, 1))
        order = np.lexsort((scene, -score))[:count]
        return SceneCandidates(scene[order], score[order])

    def _asked(self, query: SaliencyGraph) -> Asked:
        """The query laid out beside the lists."""
        label = np.array([self._postings.labels.get(name, -1) for name in query.labels], int)
        order = np.argsort(label, kind="stable")[np.count_nonzero(label < 0) :]
        known, first = np.unique(label[order], return_index=True)
        return Asked(
            known, np.append(first, len(order)), self._alike(query)[order], int(self._postings.rarity[label].sum())
        )

    def _alike(self, query: SaliencyGraph) -> np.ndarray:
        """(n, 3, 256) int64: how alike each object is to each code, from 1 to 255: that where they do not differ, or
        nothing is known."""
        scales = np.array([self.config.height_scale_m, *self.config.size_scale])[:, None]
        stands_for = CODE_LOW[:, None] + CODE_STEP * np.arange(256)
        apart = (appearance(query)[..., None] - stands_for) / scales
        return np.where(np.isnan(apart), 255, np.maximum(np.round(255 / (1 + apart**2)), 1)).astype(np.int64)
