"""What a run has measured: the answers of its methods against the truth of its dataset. Runs no method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from salframe.evaluation.metrics import Judged, count_statuses, judge, mcnemar_exact, summarize
from salframe.evaluation.run import Outcome, Row, Run
from salframe.framework.errors import DataError
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Truth

COLUMNS = (
    "method",
    "queries",
    "accuracy",
    "accuracy_low",
    "accuracy_high",
    "recall_at_5",
    "median_translation_m",
    "median_rotation_deg",
    "recall_025m_2deg",
    "recall_05m_5deg",
    "recall_1m_10deg",
    "bytes_per_scene",
    "describe_ms",
    "query_ms",
    "peak_memory_mb",
    "p_value",
    "available",
    "reason",
    "status",
)


@dataclass(frozen=True, eq=False)
class Measured:
    """One method of a run: its row with the keys of COLUMNS (None where a number is absent), its answers, and how they
    were judged.

    `answers`: a row of predictions.jsonl a query, None where there is none. Only a method that is done has numbers.
    """

    row: dict[str, Any]
    answers: tuple[Row | None, ...]
    judged: Judged

    @property
    def label(self) -> str:
        return self.row["method"]

    @property
    def done(self) -> bool:
        """Whether the method was measured."""
        return self.row["accuracy"] is not None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A run's queries in the order of its dataset, their truth, and its methods in the order they were given."""

    queries: tuple[str, ...]
    truths: tuple[Truth, ...]
    methods: tuple[Measured, ...]


def measure(run: Run, dataset: Dataset) -> Evaluation:
    """Judge every method of a run on its opened dataset. Raises DataError on a dataset without queries."""
    folds = dataset.folds()
    keys = [(fold.id, query.id) for fold in folds for query in fold.queries]
    if not keys:
        raise DataError(f"{dataset.name} has no query, expected at least one")
    truths = tuple(dataset.truth(query) for _, query in keys)
    map_frames = {frame.id for fold in folds for frame in fold.mapping}
    methods: list[Measured] = []
    for label in run.labels:
        known = run.predictions(label)
        answers = tuple(known.get(key) for key in keys)
        judged = judge(answers, truths)
        outcome = run.outcome(label) or Outcome(
            "unfinished", f"unfinished: {len(known)} of {len(keys)} queries answered"
        )
        row: dict[str, Any] = {**dict.fromkeys(COLUMNS), "method": label, "queries": len(keys), "status": {}}
        row["available"], row["reason"] = outcome.status != "unavailable", outcome.reason
        if outcome.status in ("done", "crashed"):
            row["status"] = count_statuses(judged.statuses)
        if outcome.status == "done":
            row |= summarize(judged, answers, run.descriptions(label), map_frames, run.seed)
            first = next((method for method in methods if method.done), None)
            row["p_value"] = mcnemar_exact(first.judged.correct, judged.correct) if first else None
        methods.append(Measured(row, answers, judged))
    return Evaluation(tuple(query for _, query in keys), truths, tuple(methods))
