"""The role `scorer`: a published task's own metrics."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from salframe.framework.component import Role


class Scorer(Role):
    """Scores answers that some other program gave to a published task, by that task's own rules."""

    role = "scorer"

    @abstractmethod
    def score(self, answers: Path, root: Path) -> Sequence[Mapping[str, Any]]:
        """One row a split that the file `answers` belongs to: "split", "episodes" (how many were scored), then the
        task's metrics by name. `root` holds the task's data.

        Raises DataError, in one line, on a file that is no answer to the task.
        """
