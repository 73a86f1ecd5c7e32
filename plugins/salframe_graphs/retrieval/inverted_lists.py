"""The scene index `inverted-lists`: compares labels, heights and sizes of objects, without their positions."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.files.writing import new_folder
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.scene_index import SceneCandidates, SceneIndex
from salframe_graphs.retrieval.index_query import IndexQuery
from salframe_graphs.retrieval.postings import read_postings, write_postings
from salframe_graphs.retrieval.scoring import best_scenes


class InvertedLists(SceneIndex):
    """Ranks reference frames by a Jaccard index of their objects and the objects of the query.

    Objects with the same label are compared by the height of their centroid relative to the camera, and by the length
    and height of their box. Each object of the query is compared with the most similar object of the frame. Rare labels
    count more.
    """

    name = "inverted-lists"
    version = "1"

    class Config(ComponentConfig):
        height_scale_m: float = match_only(
            0.2,
            gt=0,
            description="difference in height (m) of the centroids of two objects that halves their similarity",
        )
        size_scale: tuple[float, float] = match_only(
            (0.8, 0.5),
            description="scales [a, b] of the differences in size. The similarity of two objects is halved if one box "
            "is exp(a) times as long as the other, and also if one box is exp(b) times as high as the other",
        )

    def build(self, graphs: Iterable[SaliencyGraph], folder: Path) -> None:
        with new_folder(folder) as parts:
            write_postings(graphs, parts, positions=False)

    def open(self, folder: Path) -> None:
        self._postings = read_postings(folder)

    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        scale = np.array([self.config.height_scale_m, *self.config.size_scale])
        scene, score = best_scenes(self._postings, IndexQuery.of(query, self._postings, scale), max(count, 1))
        order = np.lexsort((scene, -score))[:count]
        return SceneCandidates(scene[order], score[order])
