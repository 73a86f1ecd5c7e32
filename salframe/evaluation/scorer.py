"""The role `scorer`: the metrics that a published task defines."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.component import Role
from salframe.framework.components.registry import registry
from salframe.framework.errors import InputMissing, InvalidAnswer
from salframe.navigation.episodes import EpisodeRequest


class Scorer(Role):
    """Scores the answers of any program to a published task by the rules of that task."""

    role = "scorer"

    @abstractmethod
    def score(self, answers: Path, root: Path) -> Sequence[Mapping[str, Any]]:
        """Return a row for each split that the file contains answers to.

        Args:
            answers: The file of answers.
            root: The folder of the task's data.

        Returns:
            Rows with the keys "split" and "episodes" (number of scored episodes), then the task's metrics by name.

        Raises:
            DataError: The file does not answer the task. The message is one line.
        """

    def episodes(self, split: str, root: Path) -> Sequence[EpisodeRequest]:
        """Return the episodes of a split of a navigation task, for an agent that knows the goal.

        Raises:
            UnknownName: The task has no such split.
            DataError: The task's data is invalid.
            InputMissing: The task is not a navigation task.
        """
        raise InputMissing(f"the task {self.name} has no episodes to walk")

    def submission(self, split: str, root: Path, walked: Sequence[np.ndarray | None]) -> Any:
        """Return the answers of an agent to a split, as the JSON that `score` reads.

        Args:
            split: The split of the task.
            root: The folder of the task's data.
            walked: For each of `episodes` the poses (K, 4) of the agent: x, y, z in metres and yaw in radians, starting
                at the start pose; None where the agent did not move.
        """
        raise InputMissing(f"the task {self.name} has no episodes to walk")


def find_scorer(task: str) -> Scorer:
    """Return the scorer of this name with its default settings. Raises UnknownName."""
    scorer: Scorer = registry().build("scorer", registry().get("scorer", task).Config())
    return scorer


def score(task: str, answers: str | Path, root: str | Path) -> list[Mapping[str, Any]]:
    """Score a file of answers to a published task.

    Args:
        task: Name of the scorer.
        answers: The file of answers.
        root: The folder of the task's data.

    Returns:
        The rows of the scorer, at least one.

    Raises:
        UnknownName: There is no such scorer.
        DataError: The file does not answer the task.
    """
    rows = list(find_scorer(task).score(Path(answers), Path(root)))
    if not rows:
        raise InvalidAnswer(f"the scorer {task} returned no row for {answers}, expected one per split")
    return rows
