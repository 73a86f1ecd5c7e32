"""Episodes of benchmarks for an agent that knows the goals, and its answers in the format of the benchmark."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.runs.records import Record
from salframe.evaluation.scorer import find_scorer
from salframe.evaluation.tasks.navigation.rows import EpisodeRow
from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.errors import InputMissing
from salframe.framework.files.writing import write_json
from salframe.navigation.episodes import EpisodeRequest

SUBMISSION = "submission.json"
"""Name of the file of answers in a method's folder, in the format of `salframe score`."""


@dataclass(frozen=True)
class Published:
    """A split of a benchmark, identified by the name of its scorer."""

    task: str
    split: str

    def __str__(self) -> str:
        return f"{self.task}:{self.split}"

    @property
    def note(self) -> str:
        """Note that the results are upper bounds, and where the answers are stored."""
        return (
            f"{self}: the agent knows the goal of each episode, so the results are upper bounds; "
            f"the answers of a method are in methods/METHOD/{SUBMISSION} in the folder of the run"
        )

    def episodes(self, data: ComponentConfig) -> tuple[EpisodeRequest, ...]:
        """Return the episodes of the split.

        Raises UnknownName and DataError. Raises InputMissing if the data has no folder, or the task has no episodes.
        """
        return tuple(find_scorer(self.task).episodes(self.split, self._root(data)))

    def score(self, data: ComponentConfig, count: int, record: Record[EpisodeRow]) -> Mapping[str, Any]:
        """Write the answers of a method to `count` episodes into its folder, and return their scores.

        An episode that was not walked has the answer of an agent that does not move.
        """
        walked: list[np.ndarray | None] = [None] * count
        for row in record.rows:
            if row is not None and row.path is not None:
                walked[row.episode] = np.array(row.path)
        scorer, root, file = find_scorer(self.task), self._root(data), record.folder / SUBMISSION
        write_json(file, scorer.submission(self.split, root, walked))
        return next(row for row in scorer.score(file, root) if row["split"] == self.split)

    def _root(self, data: ComponentConfig) -> Path:
        root: Path | None = getattr(data, "root", None)
        if root is None:
            raise InputMissing(
                f"the episodes {self} need the folder of the dataset {data.kind}, received no folder: pass the folder "
                "as --data-dir DIR"
            )
        return root


def find_published(episodes: object) -> Published | None:
    """Return the published split that `episodes` names as "BENCHMARK:SPLIT", such as "reverie:val_seen".

    None if `episodes` is another value, or if no plugin scores this benchmark.
    """
    task, colon, split = str(episodes).partition(":")
    return Published(task, split) if colon and task in registry().names("scorer") else None
