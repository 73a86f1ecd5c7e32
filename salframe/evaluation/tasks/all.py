"""All tasks by name, and measuring a run again, whichever task it did."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from salframe.evaluation.runs.result import Result
from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.runs.runner import conclude
from salframe.evaluation.runs.task import Task
from salframe.evaluation.tasks.detection.task import DetectionTask
from salframe.evaluation.tasks.localization.task import LocalizationTask
from salframe.evaluation.tasks.matching.task import MatchingTask
from salframe.evaluation.tasks.navigation.task import NavigationTask
from salframe.evaluation.tasks.running.task import RunningTask
from salframe.evaluation.tasks.scale.task import ScaleTask
from salframe.evaluation.tasks.sensor.task import SensorTask
from salframe.framework.errors import ConfigError
from salframe.panoramas.opening import open_dataset

ALL = (LocalizationTask, MatchingTask, DetectionTask, SensorTask, NavigationTask, ScaleTask, RunningTask)
TASKS: dict[str, type[Task[Any, Any]]] = {task.name: task for task in ALL}


def evaluate(directory: str | Path) -> Result[Any]:
    """Measure a run again from its rows and the data set's truth, and write its metrics and report. Runs no method.

    Raises ConfigError where `directory` is no run, DataError where the data set is not the one the run was made on.
    """
    run, task = open_run(directory)
    dataset = open_dataset(run.data())
    run.bind(dataset.question_key)
    return conclude(task, run, task.survey(dataset))


def open_run(directory: str | Path) -> tuple[Run, Task[Any, Any]]:
    """A run and the task that it is of. Raises ConfigError where `directory` is no run of a task that is known."""
    run = Run.load(Path(directory))
    name = run.task.get("name")
    if name not in TASKS:
        raise ConfigError(f"{directory} is a run of the task {name!r}, expected one of {', '.join(TASKS)}")
    return run, TASKS[name].from_run(run)
