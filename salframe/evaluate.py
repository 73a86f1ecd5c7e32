"""What a finished run has measured: answers against truth, as rows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from salframe.errors import DataError
from salframe.metrics import Judged, count_statuses, judge, mcnemar_exact, summarize
from salframe.predict import open_dataset
from salframe.roles import Dataset
from salframe.runs import Outcome, Run
from salframe.storage import write_json

COLUMNS = (
    "method", "queries", "accuracy", "accuracy_low", "accuracy_high", "recall_at_5", "median_translation_m", "median_rotation_deg",
    "recall_025m_2deg", "recall_05m_5deg", "recall_1m_10deg", "bytes_per_scene", "describe_ms", "query_ms", "peak_memory_mb", "p_value",
    "available", "reason", "status",
)  # fmt: skip


@dataclass(frozen=True)
class Comparison:
    """A finished run: a row a method with the keys of COLUMNS, None where a number is absent."""

    run: Path
    rows: tuple[dict[str, Any], ...]

    @property
    def measured(self) -> bool:
        """Whether some method was measured."""
        return any(row["accuracy"] is not None for row in self.rows)

    @property
    def crashed(self) -> bool:
        """Whether some method raised or died, on a query or altogether."""
        return any("crashed" in row["status"] for row in self.rows)

    def to_json(self) -> dict[str, Any]:
        """{"run": path, "rows": [...]}."""
        return {"run": str(self.run), "rows": list(self.rows)}


def evaluate(directory: Path) -> Comparison:
    """Measure a run again from its answers and the dataset's truth, and write metrics.json. Runs no method.

    Raises ConfigError where `directory` is no run, DataError where the dataset is not the one the run was made on.
    """
    run = Run.load(directory)
    dataset = open_dataset(run.config.dataset)
    run.bind(dataset.fingerprint)
    return measure(run, dataset)


def measure(run: Run, dataset: Dataset) -> Comparison:
    """The rows of a run on its opened dataset. Raises DataError on a dataset without queries."""
    folds = dataset.folds()
    keys = [(fold.id, query.id) for fold in folds for query in fold.queries]
    if not keys:
        raise DataError(f"{dataset.name} has no query, expected at least one")
    truths = [dataset.truth(query) for _, query in keys]
    map_frames = {frame.id for fold in folds for frame in fold.mapping}
    rows: list[dict[str, Any]] = []
    first: Judged | None = None
    for label in run.config.methods:
        known = run.predictions(label)
        answers = [known.get(key) for key in keys]
        judged = judge(answers, truths)
        outcome = run.outcome(label) or Outcome("unfinished", f"unfinished: {len(known)} of {len(keys)} queries answered")
        row: dict[str, Any] = {**dict.fromkeys(COLUMNS), "method": label, "queries": len(keys), "status": {}}
        row["available"], row["reason"] = outcome.status != "unavailable", outcome.reason
        if outcome.status in ("done", "crashed"):
            row["status"] = count_statuses(judged.statuses)
        if outcome.status == "done":
            row |= summarize(judged, answers, run.descriptions(label), map_frames, run.config.seed)
            row["p_value"] = mcnemar_exact(first.correct, judged.correct) if first else None
            first = first or judged
        rows.append(row)
        write_json(run.folder(label) / "metrics.json", row)
    return Comparison(run.directory, tuple(rows))
