"""Compute the table row of each method from its rows per pair of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from salframe.evaluation.runs.records import Record, in_common
from salframe.evaluation.runs.rows import PieceStatus
from salframe.evaluation.statistics import Estimate, estimate_mean
from salframe.evaluation.tasks.matching.judging import THRESHOLDS_PX
from salframe.evaluation.tasks.matching.rows import PairRow
from salframe.evaluation.tasks.matching.table import MatchingRow
from salframe.framework.errors import counted


def summarize_pairs(records: Sequence[Record[PairRow]], places: Sequence[str], seed: int) -> MatchingRow:
    """Return the row of a method in the table. `places` (P,) are the places of the P pairs.

    A failed pair counts as a pair without correct matches.
    """
    pairs = len(places)
    line = MatchingRow(**in_common(records), pairs=pairs)
    if not all(record.done for record in records):
        return line
    rows = [row for record in records for row in record.rows]
    finished = [row for row in rows if row is not None]
    good, failed = ([row for row in finished if (row.status == PieceStatus.OK) == ok] for ok in (True, False))
    if failed:
        line = replace(
            line, reason=f"{counted(len(failed), 'pair')} of panoramas failed, the first error: {failed[0].error}"
        )
    if not good:
        return line
    if len({row.kind for row in good}) > 1:
        return replace(
            line, reason="the method matched points in some pairs of panoramas, but objects (graph nodes) in others"
        )
    kind, matches = good[0].kind, sum(row.matches or 0 for row in good) / pairs
    done = np.array([row is not None and row.status == PieceStatus.OK for row in rows])
    shares, others = (_points if kind == "points" else _nodes)(good, done)
    means: dict[str, Any] = {name: _mean(*share, places, seed) for name, share in shares.items()}
    return replace(line, kind=kind, matches_per_pair=matches, **others, **means)


Share = tuple[np.ndarray, np.ndarray]
"""A share of each of P pairs, failed pairs included, (P,) float64, and whether the pair counts in the mean, (P,)
bool."""


def _points(rows: Sequence[PairRow], done: np.ndarray) -> tuple[dict[str, Share], dict[str, Any]]:
    """Return the accuracies of pairs of points, and other fields of the row.

    The accuracy of a pair is the share of its judged matches within a threshold, 0 if there are none. `done` (P,)
    bool marks the pairs that have a row.
    """
    judged = np.array([row.judged for row in rows])
    within = np.zeros((len(done), len(THRESHOLDS_PX)))
    within[done] = np.array([row.within_px for row in rows]) / np.maximum(judged, 1)[:, None]
    shares = {f"mma_{px}": (share, np.ones(len(done), bool)) for px, share in zip(THRESHOLDS_PX, within.T, strict=True)}
    return shares, {"pairs_without_match": len(done) - int((judged > 0).sum())}


def _nodes(rows: Sequence[PairRow], done: np.ndarray) -> tuple[dict[str, Share], dict[str, Any]]:
    """Return precision and recall of pairs of graphs, and other fields of the row.

    The precision of a pair is the share of its matches that are correct, 0 without matches. The recall is the share of
    the objects in both graphs that were matched; pairs whose graphs share no object do not count. `done` (P,) bool
    marks the pairs that have a row.
    """
    matches, correct, true = np.array([(row.matches, row.correct, row.true) for row in rows]).T
    precision, recall = np.zeros((2, len(done)))
    precision[done], recall[done] = correct / np.maximum(matches, 1), correct / np.maximum(true, 1)
    shared = np.ones(len(done), bool)
    shared[done] = true > 0
    shares = {"precision": (precision, np.ones(len(done), bool)), "recall": (recall, shared)}
    return shares, {"true_per_pair": float(true.sum() / len(done))}


def _mean(share: np.ndarray, counts: np.ndarray, places: Sequence[str], seed: int) -> Estimate | None:
    """Return the mean of the shares for which `counts` (P,) is true. None if there are none."""
    if not counts.any():
        return None
    chosen = np.flatnonzero(counts).tolist()
    return estimate_mean(share[chosen], [places[i] for i in chosen], seed)
