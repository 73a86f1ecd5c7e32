"""The role `scorer`: a published task's own metrics."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from salframe.framework.component import Role
from salframe.framework.errors import InvalidAnswer
from salframe.framework.registry import registry


class Scorer(Role):
    """Scores answers that some other program gave to a published task, by that task's own rules."""

    role = "scorer"

    @abstractmethod
    def score(self, answers: Path, root: Path) -> Sequence[Mapping[str, Any]]:
        """One row a split that the file `answers` belongs to: "split", "episodes" (how many were scored), then the
        task's metrics by name. `root` holds the task's data.

        Raises DataError, in one line, on a file that is no answer to the task.
        """


def score(task: str, answers: str | Path, root: str | Path) -> list[Mapping[str, Any]]:
    """The rows that the scorer of a task gives for a file of answers, at least one; `root`: the folder of the task's
    data. Raises UnknownName, and DataError on a file that is no answer to the task."""
    rows = list(registry().build("scorer", registry().get("scorer", task).Config()).score(Path(answers), Path(root)))
    if not rows:
        raise InvalidAnswer(f"the scorer {task} gave no row for {answers}, expected one a split")
    return rows
