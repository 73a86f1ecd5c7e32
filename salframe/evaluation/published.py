"""The episodes of published tasks, walked by an agent that is told their goals, and its answers in the tasks' form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from salframe.evaluation.scorer import find_scorer
from salframe.evaluation.task import Record
from salframe.framework.config import ComponentConfig
from salframe.framework.errors import InputMissing
from salframe.framework.files import write_json
from salframe.framework.registry import registry
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
            f"`salframe score {self.task}` scores methods/METHOD/{SUBMISSION} in the folder of the run"
        )

    def episodes(self, data: ComponentConfig) -> tuple[Asked, ...]:
        """The episodes of the split. Raises UnknownName, DataError, and InputMissing where the data has no folder or
        the task no episodes."""
        return tuple(find_scorer(self.task).episodes(self.split, self._root(data)))

    def write(self, data: ComponentConfig, count: int, records: Sequence[Record]) -> None:
        """Write what each method that is done answered to `count` episodes into its folder; what was not walked is
        answered as by an agent that stays."""
        for record in records:
            if record.done:
                walked: list[np.ndarray | None] = [None] * count
                for row in record.rows:
                    if row is not None and "path" in row:
                        walked[row["episode"]] = np.array(row["path"])
                content = find_scorer(self.task).submission(self.split, self._root(data), walked)
                write_json(record.folder / SUBMISSION, content)

    def _root(self, data: ComponentConfig) -> Path:
        root: Path | None = getattr(data, "root", None)
        if root is None:
            raise InputMissing(f"the episodes {self} are in the folder of {data.kind}, which has none: --data-dir DIR")
        return root


def find_published(episodes: object) -> Published | None:
    """The split that a text "TASK:SPLIT" names, None where it begins with the name of no scorer."""
    task, colon, split = str(episodes).partition(":")
    return Published(task, split) if colon and task in registry().names("scorer") else None
