"""The episodes of published tasks, walked by an agent that is told their goals, and its answers in the tasks' form."""

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
from salframe.navigation.episodes import Asked

SUBMISSION = "submission.json"
"""In a method's folder: its answers, as `salframe score` takes them."""


@dataclass(frozen=True)
class Published:
    """A split of a published task, known by the name of its scorer."""

    task: str
    split: str

    def __str__(self) -> str:
        return f"{self.task}:{self.split}"

    @property
    def note(self) -> str:
        """What must be said of the figures."""
        return (
            f"{self}: the agent is told the goal of each episode, so this is an upper bound; "
            f"its answers: methods/METHOD/{SUBMISSION} in the folder of the run"
        )

    def episodes(self, data: ComponentConfig) -> tuple[Asked, ...]:
        """The episodes of the split. Raises UnknownName, DataError, and InputMissing where the data has no folder or
        the task no episodes."""
        return tuple(find_scorer(self.task).episodes(self.split, self._root(data)))

    def score(self, data: ComponentConfig, count: int, record: Record[EpisodeRow]) -> Mapping[str, Any]:
        """What the task's scorer makes of a method's answers to `count` episodes, which are written into its folder.
        What was not walked is answered as by an agent that stays."""
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
            raise InputMissing(f"the episodes {self} are in the folder of {data.kind}, which has none: --data-dir DIR")
        return root


def find_published(episodes: object) -> Published | None:
    """The split that a text "TASK:SPLIT" names, None where it begins with the name of no scorer."""
    task, colon, split = str(episodes).partition(":")
    return Published(task, split) if colon and task in registry().names("scorer") else None
