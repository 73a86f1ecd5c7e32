"""The scene index `inverted-lists`: by labels, heights and sizes of objects, wherever they stand."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from salframe.framework.config import ComponentConfig, match_only
from salframe.framework.files import new_folder
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.scene_index import SceneCandidates, SceneIndex
from salframe_graphs import compilation
from salframe_graphs.retrieval import scoring
from salframe_graphs.retrieval.postings import appearance, read_postings, write_postings
from salframe_graphs.retrieval.scoring import Asked


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

    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        best_scenes = (compilation.compiled("salframe_graphs.retrieval.compiled") or scoring).best_scenes
        scene, score = best_scenes(self._postings, self._asked(query), max(count, 1))
        order = np.lexsort((scene, -score))[:count]
        return SceneCandidates(scene[order], score[order])

    def _asked(self, query: SaliencyGraph) -> Asked:
        """The query laid out beside the lists."""
        label = np.array([self._postings.labels.get(name, -1) for name in query.labels], int)
        order = np.argsort(label, kind="stable")[np.count_nonzero(label < 0) :]
        scale = np.array([self.config.height_scale_m, *self.config.size_scale])
        return Asked(label[order], appearance(query)[order], scale, int(self._postings.rarity[label].sum()))
