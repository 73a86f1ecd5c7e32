"""The role `scorer`: a published task's own metrics."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.component import Role
from salframe.framework.components.registry import registry
from salframe.framework.errors import InputMissing, InvalidAnswer
from salframe.navigation.episodes import Asked


class Scorer(Role):
    """Scores answers that some other program gave to a published task, by that task's own rules."""

    role = "scorer"

    @abstractmethod
    def score(self, answers: Path, root: Path) -> Sequence[Mapping[str, Any]]:
        """One row a split that the file `answers` belongs to: "split", "episodes" (how many were scored), then the
        task's metrics by name. `root` holds the task's data.

        Raises DataError, in one line, on a file that is no answer to the task.
        """

    def episodes(self, split: str, root: Path) -> Sequence[Asked]:
        """The episodes of a split for an agent that is told the goal, in a task that is one of navigation.

        Raises UnknownName on the split, DataError on the task's data, InputMissing in a task of another kind.
        """
        raise InputMissing(f"the task {self.name} has no episodes to walk")

    def submission(self, split: str, root: Path, walked: Sequence[np.ndarray | None]) -> Any:
        """The answers to a split, as the JSON that `score` takes, of an agent that walked: for each of `episodes` its
        poses (K, 4) x, y, z in metres and yaw in radians, from the start on; None where it has not moved."""
        raise InputMissing(f"the task {self.name} has no episodes to walk")


def find_scorer(task: str) -> Scorer:
    """The scorer of this name, as it is unless set. Raises UnknownName."""
    scorer: Scorer = registry().build("scorer", registry().get("scorer", task).Config())
    return scorer


def score(task: str, answers: str | Path, root: str | Path) -> list[Mapping[str, Any]]:
    """The rows that the scorer of a task gives for a file of answers, at least one; `root`: the folder of the task's
    data. Raises UnknownName, and DataError on a file that is no answer to the task."""
    rows = list(find_scorer(task).score(Path(answers), Path(root)))
    if not rows:
        raise InvalidAnswer(f"the scorer {task} gave no row for {answers}, expected one a split")
    return rows
