"""The scene index `compiled-lists`: inverted lists with positions. Compiled code scans the lists, and verifies the best
scenes by two-point hypotheses."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from salframe.framework.component import match_only
from salframe.framework.errors import DataError
from salframe.framework.files.writing import new_folder
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.scene_index import SceneCandidates, SceneIndex
from salframe_graphs.retrieval.index_query import FULL, IndexQuery
from salframe_graphs.retrieval.inverted_lists import InvertedLists
from salframe_graphs.retrieval.kernel_cache import compile_kernels, load_kernels
from salframe_graphs.retrieval.postings import (
    CODE_LOW,
    CODE_STEP,
    POSITION_M,
    RARITY_UNIT,
    read_postings,
    write_postings,
)

MAX_VERIFIED = 2000
"""Maximum number of scenes to verify: the scenes with the best scores from the inverted lists."""
GEOMETRY_WEIGHT = 2.0
"""Weight of the Jaccard index of the objects consistent with one pose. The score from the inverted lists has weight
1."""
MIN_SIMILARITY = 0.1
"""Minimum similarity of two objects that may be the same."""
_HEIGHT_M = CODE_LOW[0] + CODE_STEP * np.arange(256)


class CompiledLists(SceneIndex):
    """Ranks reference frames as `inverted-lists` does, then re-ranks the best 2,000 by the positions of objects.

    A pose is computed from two objects of the query and two objects of the frame. The score of the pose counts the
    objects that coincide under it. The score of a frame is that of its best pose. This index is for maps of over 10,000
    reference frames. numba compiles its code when a map is built or opened.
    """

    name = "compiled-lists"
    version = "1"
    requires = ("numba",)
    extra = "salframe[fast]"

    class Config(InvertedLists.Config):
        tolerance_m: float = match_only(
            0.3, gt=0, description="maximum distance (m) between two objects that coincide, at a range of 0"
        )
        tolerance_share: float = match_only(
            0.05,
            ge=0,
            description="increase of `tolerance_m` with the range. Two objects with the ranges a and b coincide if "
            "their distance is at most `tolerance_m` + `tolerance_share` * sqrt(a^2 + b^2)",
        )
        max_shift_m: float = match_only(
            6.0,
            gt=0,
            description="maximum distance (m) between the computed position of the query and the reference frame. "
            "Poses with a larger distance are left out",
        )

    def build(self, graphs: Iterable[SaliencyGraph], folder: Path) -> None:
        with new_folder(folder) as parts:
            write_postings(graphs, parts, positions=True)
        type(self)(self.config).open(folder)  # compile now, so that opening the map takes no extra time

    def open(self, folder: Path) -> None:
        self._postings = read_postings(folder)
        if self._postings.position is None:
            raise DataError(
                f"the scene index in {folder} has no positions of objects, expected an index of the kind "
                f"{self.name}: build the map again, or only the index with SceneIndex.build"
            )
        if len(self._postings.scene):
            self._compile()

    def candidates(self, query: SaliencyGraph, count: int) -> SceneCandidates:
        scale = np.array([self.config.height_scale_m, *self.config.size_scale])
        index_query = IndexQuery.of(query, self._postings, scale)
        if not len(index_query.node):
            return SceneCandidates(np.zeros(0, np.int64), np.zeros(0))
        scene, score = self._scan(index_query, max(count, MAX_VERIFIED))
        if not query.bearings_only:
            best = np.sort(np.lexsort((scene, -score))[:MAX_VERIFIED])
            # The addition is at least 0, so no verified scene ranks below one that is not verified.
            score[best] += GEOMETRY_WEIGHT * self._geometry(query, index_query, scene[best])
        order = np.lexsort((scene, -score))[:count]
        return SceneCandidates(scene[order], score[order])

    def _scan(self, query: IndexQuery, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the `count` best scenes from the inverted lists, in the order of the map, and their scores.

        Among scenes with equal scores, lower indices are preferred.
        """
        kernels, postings = load_kernels(), self._postings
        rarity = postings.rarity[query.label]
        maximum = FULL * rarity * (query.last - query.first)
        rest = np.append(np.cumsum(maximum[::-1])[::-1], 0)
        lists = postings.scene, postings.code, postings.weight
        labels = query.first, query.last, postings.start[query.label + 1], rarity, rest
        scenes, scores = (np.empty(2 * count + kernels.BLOCK, kind) for kind in (np.int64, np.float64))
        state = np.concatenate([[0, 0], postings.start[query.label]])
        min_score = 0.0
        while state[0] < len(postings.weight):
            kernels.scan_lists(lists, labels, query.similarity, (query.rarity, FULL), state, min_score, scenes, scores)
            num_scenes = int(state[1])
            if num_scenes > count:
                is_best = _top_mask(scores[:num_scenes], count)
                min_score = float(scores[:num_scenes][is_best].min())
                scenes[:count], scores[:count] = scenes[:num_scenes][is_best], scores[:num_scenes][is_best]
                state[1] = count
        return scenes[: state[1]].copy(), scores[: state[1]].copy()

    def _geometry(self, query: SaliencyGraph, index_query: IndexQuery, scene: np.ndarray) -> np.ndarray:
        """Return the Jaccard index (K,) of the objects consistent with the best pose of each scene (K,), ascending."""
        postings = self._postings
        start, end = postings.start[index_query.label], postings.start[index_query.label + 1]
        lists = postings.scene, postings.code, postings.position, _HEIGHT_M, POSITION_M
        labels = index_query.first, index_query.last, start, end, (end - start) / len(postings.weight)
        weight = postings.rarity[index_query.object_label] / RARITY_UNIT
        xy_m = np.ascontiguousarray(query.centroid_m[index_query.node, :2])
        objects = xy_m, query.range_m[index_query.node], weight, index_query.similarity / 255
        limits = self.config.tolerance_m, self.config.tolerance_share, self.config.max_shift_m, MIN_SIMILARITY
        shared = np.zeros(len(scene))
        load_kernels().verify_scenes(lists, labels, objects, limits, scene, shared)
        total = (index_query.rarity + postings.weight[scene]) / RARITY_UNIT
        return shared / (total - shared)  # type: ignore[no-any-return]

    def _compile(self) -> None:
        """Run a small query, so that numba compiles the kernels or reads them from the cache."""
        labels = (next(iter(self._postings.labels)),)
        ones, origin = np.ones(1), np.zeros((1, 3))
        query = SaliencyGraph(labels, ones, ones, origin, origin + 1, 0 * ones, np.zeros((0, 2), np.int64))
        compile_kernels(lambda: self.candidates(query, 1))


def _top_mask(scores: np.ndarray, count: int) -> np.ndarray:
    """Return a mask (N,) of the `count` largest scores. Among equal scores, the first ones are preferred."""
    threshold = np.partition(scores, len(scores) - count)[len(scores) - count]
    is_best = scores > threshold
    is_best[np.flatnonzero(scores == threshold)[: count - np.count_nonzero(is_best)]] = True
    return is_best
