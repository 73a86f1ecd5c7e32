"""The task `tracking`: does a tracker know where a moving camera is?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ConfigDict

from salframe.evaluation.runs.inputs import check_needs
from salframe.evaluation.runs.records import Part, Record
from salframe.evaluation.runs.request import Request, Resolved, resolve
from salframe.evaluation.runs.rows import Row
from salframe.evaluation.runs.run_folder import REQUEST, Run
from salframe.evaluation.runs.task import Task, TaskOptions, Worker
from salframe.evaluation.tasks.tracking.measures import summarize_beliefs
from salframe.evaluation.tasks.tracking.options import TrackingOptions
from salframe.evaluation.tasks.tracking.rows import WalkRow
from salframe.evaluation.tasks.tracking.survey import TrackingSurvey
from salframe.evaluation.tasks.tracking.table import COLUMNS, DEFAULT_COLUMNS, TrackingRow
from salframe.evaluation.tasks.tracking.walking import NUM_KIDNAPPED, Tracking
from salframe.evaluation.tasks.tracking.walks import Walk, draw_walk
from salframe.framework.component import ComponentConfig
from salframe.framework.components.defaults import default_of
from salframe.framework.components.identity import settings_identity
from salframe.framework.components.presets import configure_default
from salframe.framework.files.writing import write_json
from salframe.framework.validation import Seed, Settings, validate
from salframe.localization.localizer import Localizer
from salframe.navigation.episodes import Site
from salframe.navigation.guide import Guide
from salframe.navigation.world import open_worlds
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.opening import open_dataset


class _SavedTracking(Settings):
    """The parameters of the task in a run folder. The runner adds other keys."""

    model_config = ConfigDict(extra="ignore")
    options: TrackingOptions
    seed: Seed


@dataclass(frozen=True)
class TrackingTask(Task[Walk, TrackingSurvey, WalkRow, TrackingRow]):
    """The task `tracking`: does a tracker know where a moving camera is?

    Attributes:
        options: The options, with one number of views and one kind of odometry.
        seed: Seed of the walks and of the errors of odometry.
    """

    options: TrackingOptions = field(default_factory=TrackingOptions)
    seed: int = 0

    name = "tracking"
    prefix = "track-"
    counts = "walks"
    key_fields = ("walk",)
    row = WalkRow
    line = TrackingRow
    columns = COLUMNS
    default_columns = DEFAULT_COLUMNS
    Options = TrackingOptions
    maps = True

    @classmethod
    def vary(cls, options: TaskOptions) -> list[tuple[dict[str, Any], TaskOptions]]:
        options = _checked(options)
        return [
            (
                {
                    **({"odometry": name} if len(options.odometry) > 1 else {}),
                    **({"views": str(views)} if len(options.views) > 1 else {}),
                },
                options.model_copy(update={"odometry": {name: errors}, "views": (views,)}),
            )
            for name, errors in options.odometry.items()
            for views in options.views
        ]

    @classmethod
    def plan(cls, request: Request, options: TaskOptions) -> tuple[TrackingTask, Resolved]:
        return cls(_checked(options), request.seed), resolve(request, cls.role)

    def parameters(self) -> dict[str, Any]:
        return {"options": self.options.model_dump(mode="json"), "seed": self.seed}

    def identity(self) -> dict[str, Any]:
        content = self.options.model_dump(mode="json", exclude={"beliefs"})
        beliefs = {name: settings_identity(belief) for name, belief in self.options.beliefs.items()}
        return {"options": {**content, "beliefs": beliefs}, "seed": self.seed}

    @classmethod
    def from_run(cls, run: Run) -> TrackingTask:
        saved: _SavedTracking = validate(_SavedTracking, run.task, f"{run.directory / REQUEST}: task")
        return cls(saved.options, saved.seed)

    def survey(self, dataset: Dataset) -> TrackingSurvey:
        planner = configure_default("planner", default_of("navigation_planner"))
        sites = [Site(world, Guide(world.chart, planner)) for world in open_worlds(dataset)]
        walks = [draw_walk(sites[number % len(sites)], number, self.seed) for number in range(self.options.walks)]
        other = _another_building(dataset.config)
        notes = () if other is None else (f"other building: {dataset.name} with the seed {other.config.seed}",)
        worlds = {site.world.id: site.world for site in sites}
        return TrackingSurvey(dataset, walks, notes, worlds=worlds, other=other)

    def key(self, piece: Walk) -> tuple[str]:
        return (piece.id,)

    def open(
        self, label: str, method: Localizer, survey: TrackingSurvey, todo: Sequence[Walk], folder: Path
    ) -> Worker[Walk]:
        check_needs(method, survey.dataset)
        kidnapped: dict[str, Walk] = {}
        for world in survey.worlds:
            walks = [walk for walk in survey.pieces if walk.world == world]
            kidnapped |= {walk.id: walks[(number + 1) % len(walks)] for number, walk in enumerate(walks)}
        (errors,), (views,) = self.options.odometry.values(), self.options.views
        return Tracking(
            method.config,
            survey.dataset,
            survey.other,
            survey.worlds,
            kidnapped,
            self.options.beliefs,
            errors,
            views,
            self.seed,
        )

    def failed(self, piece: Walk) -> Row:
        return {"start": piece.places[0]}

    def summarize(self, parts: Sequence[Part[TrackingSurvey, WalkRow]], seed: int) -> tuple[TrackingRow, ...]:
        return summarize_beliefs(parts, list(self.options.beliefs), seed)

    def write_files(self, run: Run, survey: TrackingSurvey, records: Sequence[Record[WalkRow]]) -> None:
        rows = self.summarize([(survey, records)], run.seed)
        write_json(run.directory / "beliefs.json", [row.to_json() for row in rows])

    @classmethod
    def legend(cls, rows: Sequence[TrackingRow]) -> list[str]:
        return [
            "recovered: after 12 views, the camera is moved to another walk without odometry; the place is correct "
            f"after at least one of the next {NUM_KIDNAPPED} views."
        ]


def _checked(options: TaskOptions) -> TrackingOptions:
    """Return the options. Raises TypeError if they are options of another task."""
    if not isinstance(options, TrackingOptions):
        raise TypeError(f"the argument options has the type {type(options).__name__}, expected TrackingOptions")
    return options


def _another_building(config: ComponentConfig) -> Dataset | None:
    """Return a generated data set with the next seed; None for data sets that are not generated from a seed."""
    seed = getattr(config, "seed", None)
    return None if seed is None else open_dataset(config.model_copy(update={"seed": seed + 1}))
