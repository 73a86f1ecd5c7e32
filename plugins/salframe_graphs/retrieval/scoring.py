"""Scores of all scenes of a map for a query, in NumPy."""

from __future__ import annotations

import numpy as np

from salframe_graphs.retrieval.index_query import FULL, IndexQuery
from salframe_graphs.retrieval.postings import Postings


def best_scenes(postings: Postings, query: IndexQuery, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the scenes with the best scores for a query, in the order of the map.

    The score is the Jaccard index of the objects of query and scene, weighted by rarity. Each object of the query
    contributes its similarity to the most similar object of the scene, and vice versa. The intersection is the smaller
    of the two sums. A query with four chairs and a scene with one chair thus have only one chair in common.

    Args:
        postings: The lists of the map.
        query: The query.
        count: Number of scenes to return. The result is shorter if fewer scenes share a label with the query, and
            longer if several scenes have the last score.

    Returns:
        Indices (K,) int64 of the scenes, and their scores (K,) float64.
    """
    shared = np.zeros(len(postings.weight), np.int64)
    for label, first, last in zip(query.label.tolist(), query.first.tolist(), query.last.tolist(), strict=True):
        rows = slice(*postings.start[label : label + 2])
        scene, (height, length, box_height) = postings.scene[rows], postings.code[rows].T.astype(np.intp)
        similarity = np.stack(
            [
                height_row.take(height) * length_row.take(length) * box_row.take(box_height)
                for height_row, length_row, box_row in query.similarity[first:last]
            ]
        )
        begin = np.flatnonzero(np.append(True, scene[1:] != scene[:-1]))
        label_shared = np.maximum.reduceat(similarity, begin, axis=1).sum(0, dtype=np.int64)
        if len(similarity) > 1:  # one query object never shares more than the scene's objects do
            label_shared = np.minimum(label_shared, np.add.reduceat(similarity.max(0), begin, dtype=np.int64))
        shared[scene[begin]] += postings.rarity[label] * label_shared
    scene = np.flatnonzero(shared)
    score = shared[scene] / (FULL * (query.rarity + postings.weight[scene].astype(np.int64)) - shared[scene])
    if len(scene) > count:
        is_best = score >= np.partition(score, len(score) - count)[len(score) - count]
        scene, score = scene[is_best], score[is_best]
    return scene, score
