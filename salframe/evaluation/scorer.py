"""The role `scorer`: the metrics that a benchmark defines."""

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
    """Computes the metrics of a benchmark from a file of answers."""

    role = "scorer"

    @abstractmethod
    def score(self, answers: Path, root: Path) -> Sequence[Mapping[str, Any]]:
        """Return a row for each split that the file contains answers to.

        Args:
            answers: The file of answers.
            root: The folder of the benchmark's data.

        Returns:
            Rows with the keys "split" and "episodes" (number of scored items), then the metrics of the benchmark by
            name.

        Raises:
            DataError: The file has no valid answers to the benchmark. The message is one line.
        """

    def episodes(self, split: str, root: Path) -> Sequence[EpisodeRequest]:
        """Return the episodes of a split of a navigation benchmark, for an agent that knows the goal.

        Raises:
            UnknownName: The benchmark has no such split.
            DataError: The data of the benchmark are invalid.
            InputMissing: The benchmark is not about navigation.
        """
        raise InputMissing(
            f"the benchmark {self.name} has no episodes for navigation, expected a benchmark with "
            "episodes, such as reverie"
        )

    def submission(self, split: str, root: Path, walked: Sequence[np.ndarray | None]) -> Any:
        """Return the answers of an agent to a split, as the JSON that `score` reads.

        Args:
            split: The split of the benchmark.
            root: The folder of the benchmark's data.
            walked: For each of `episodes` the poses (K, 4) of the agent: x, y, z in metres and yaw in radians, starting
                at the start pose; None if the agent did not move.
        """
        raise InputMissing(
            f"the benchmark {self.name} has no episodes for navigation, expected a benchmark with "
            "episodes, such as reverie"
        )


def find_scorer(task: str) -> Scorer:
    """Return the scorer of this name with its default settings. Raises UnknownName."""
    scorer: Scorer = registry().build("scorer", registry().get("scorer", task).Config())
    return scorer


def score(task: str, answers: str | Path, root: str | Path) -> list[Mapping[str, Any]]:
    """Score a file of answers to a benchmark.

    Args:
        task: Name of the scorer.
        answers: The file of answers.
        root: The folder of the benchmark's data.

    Returns:
        The rows of the scorer, at least one.

    Raises:
        UnknownName: There is no such scorer.
        DataError: The file has no valid answers to the benchmark.
        InvalidAnswer: The scorer returned no row.
    """
    rows = list(find_scorer(task).score(Path(answers), Path(root)))
    if not rows:
        raise InvalidAnswer(
            f"the scorer {task} returned no result row for {answers}, expected one row for each split of the benchmark"
        )
    return rows
