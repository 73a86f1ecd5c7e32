"""The list of all tasks."""

from __future__ import annotations

from pathlib import Path

from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.runs.task import AnyTask
from salframe.evaluation.tasks.asking.task import AskingTask
from salframe.evaluation.tasks.detection.task import DetectionTask
from salframe.evaluation.tasks.latency.task import LatencyTask
from salframe.evaluation.tasks.localization.task import LocalizationTask
from salframe.evaluation.tasks.matching.task import MatchingTask
from salframe.evaluation.tasks.navigation.task import NavigationTask
from salframe.evaluation.tasks.scale.task import ScaleTask
from salframe.evaluation.tasks.sensor.task import SensorTask
from salframe.evaluation.tasks.tracking.task import TrackingTask
from salframe.evaluation.tasks.turning.task import TurningTask
from salframe.framework.errors import ConfigError, UnknownName, unknown

ALL: tuple[type[AnyTask], ...] = (
    LocalizationTask,
    MatchingTask,
    DetectionTask,
    SensorTask,
    NavigationTask,
    TrackingTask,
    TurningTask,
    AskingTask,
    ScaleTask,
    LatencyTask,
)
TASKS: dict[str, type[AnyTask]] = {task.name: task for task in ALL}
"""The tasks by name."""
DEFAULT = LocalizationTask.name
"""Name of the default task of a study."""


def find_task(name: str) -> type[AnyTask]:
    """Return the task of this name. Raises UnknownName."""
    if name not in TASKS:
        raise UnknownName(unknown("task", name, list(TASKS)))
    return TASKS[name]


def open_run(directory: str | Path) -> tuple[Run, AnyTask]:
    """Return a run and its task. Raises ConfigError if `directory` is not a run of a known task."""
    run = Run.load(Path(directory))
    name = run.task.get("name")
    if name not in TASKS:
        raise ConfigError(f"the run folder {directory} has the task {name!r}, expected one of {', '.join(TASKS)}")
    return run, TASKS[name].from_run(run)
