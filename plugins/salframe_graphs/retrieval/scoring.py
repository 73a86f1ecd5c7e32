"""Scores of all scenes of a map for a query, in numpy."""

from __future__ import annotations

import numpy as np

from salframe_graphs.retrieval.index_query import FULL, IndexQuery
from salframe_graphs.retrieval.postings import Postings


def best_scenes(postings: Postings, query: IndexQuery, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the scenes (K,) int64 that share most with a query and their scores (K,) float64, in the order of the map.

    At least the best `count` scenes that share anything, and more where scores are equal. The score is the Jaccard
    index of both sides' objects, weighted by rarity: an object shares as much as the most similar object of the other
    side is like it, and the smaller of both sums counts. So four chairs do not share four with a scene of one.
    """
    shared = np.zeros(len(postings.weight), np.int64)
    for label, first, last in zip(query.label.tolist(), query.first.tolist(), query.last.tolist(), strict=True):
        listed = slice(*postings.start[label : label + 2])
        scene, (height, length, box_height) = postings.scene[listed], postings.code[listed].T.astype(np.intp)
        likeness = np.stack(
            [
                one.take(height) * two.take(length) * three.take(box_height)
                for one, two, three in query.likeness[first:last]
            ]
        )
        begin = np.flatnonzero(np.append(True, scene[1:] != scene[:-1]))
        common = np.maximum.reduceat(likeness, begin, axis=1).sum(0, dtype=np.int64)
        if len(likeness) > 1:  # one object shares no more than the scene's objects do
            common = np.minimum(common, np.add.reduceat(likeness.max(0), begin, dtype=np.int64))
        shared[scene[begin]] += postings.rarity[label] * common
    scene = np.flatnonzero(shared)
    score = shared[scene] / (FULL * (query.rarity + postings.weight[scene].astype(np.int64)) - shared[scene])
    if len(scene) > count:
        is_best = score >= np.partition(score, len(score) - count)[len(score) - count]
        scene, score = scene[is_best], score[is_best]
    return scene, score
