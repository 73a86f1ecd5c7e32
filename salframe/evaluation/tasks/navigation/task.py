"""The task `navigation`: methods in closed-loop navigation, all with the same episodes and the same noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.paged_task import PagedTask
from salframe.evaluation.runs.inputs import check_needs
from salframe.evaluation.runs.records import Part, Record
from salframe.evaluation.runs.request import Request, Resolved, resolve
from salframe.evaluation.runs.rows import Row
from salframe.evaluation.runs.run_folder import REQUEST, Run
from salframe.evaluation.runs.runner import run_task
from salframe.evaluation.runs.task import Result, TaskOptions, Worker
from salframe.evaluation.tables.table import Table
from salframe.evaluation.tasks.navigation.measures import summarize_agents
from salframe.evaluation.tasks.navigation.options import ARMS, TRUE_PLACE, WITHOUT, NavigationOptions, Positioning
from salframe.evaluation.tasks.navigation.published import Published, find_published
from salframe.evaluation.tasks.navigation.rows import EpisodeRow
from salframe.evaluation.tasks.navigation.survey import NavigationSurvey
from salframe.evaluation.tasks.navigation.table import ABOUT, COLUMNS, DEFAULT_COLUMNS, NavigationRow, score_tables
from salframe.evaluation.tasks.navigation.trajectories import write_trajectories
from salframe.evaluation.tasks.navigation.view import NavigationView
from salframe.evaluation.tasks.navigation.walking import Walking
from salframe.evaluation.tasks.navigation.walks import list_walks
from salframe.framework.components.identity import settings_identity
from salframe.framework.config import merge
from salframe.framework.errors import ConfigError, shorten
from salframe.framework.files.writing import write_json
from salframe.framework.validation import Seed, Settings, validate
from salframe.localization.localizer import Localizer
from salframe.navigation.agent_localizer import AgentLocalizer
from salframe.navigation.episodes import (
    MAX_EPISODES,
    Episode,
    EpisodeRequest,
    NumEpisodes,
    Site,
    draw_episodes,
    read_episode_requests,
    resolve_episodes,
)
from salframe.navigation.guide import Guide
from salframe.navigation.walk import SUCCESS_LIMITS_M, NavigationConfig
from salframe.navigation.world import open_worlds
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.opening import Progress


class _SavedTask(Settings):
    """The parameters of the task in a run folder. The runner adds other keys."""

    model_config = ConfigDict(extra="ignore")
    episodes: NumEpisodes | tuple[EpisodeRequest, ...]
    seed: Seed
    settings: dict[str, Any]
    published: str = ""


@dataclass(frozen=True)
class NavigationTask(PagedTask[Episode, NavigationSurvey, EpisodeRow, NavigationRow]):
    """The task `navigation`: does the agent reach its goal?

    Attributes:
        config: The settings of navigation.
        requests: The number of episodes to draw, or the episodes.
        seed: Seed of the episodes and of the noise.
        published: The benchmark of the episodes.
    """

    config: NavigationConfig
    requests: int | tuple[EpisodeRequest, ...]
    seed: int
    published: Published | None = None

    name = "navigation"
    version = "4"
    prefix = "navigate-"
    counts = "episodes"
    key_fields = ("episode",)
    row = EpisodeRow
    line = NavigationRow
    columns = COLUMNS
    default_columns = DEFAULT_COLUMNS
    about = ABOUT
    Options = NavigationOptions
    maps = True

    def parameters(self) -> dict[str, Any]:
        episodes = (
            self.requests if isinstance(self.requests, int) else [one.model_dump(mode="json") for one in self.requests]
        )
        parameters = {"episodes": episodes, "seed": self.seed, "settings": self.config.model_dump(mode="json")}
        return {**parameters, **({"published": str(self.published)} if self.published else {})}

    def identity(self) -> dict[str, Any]:
        return {**self.parameters(), "settings": settings_identity(self.config)}

    @classmethod
    def from_run(cls, run: Run) -> NavigationTask:
        saved: _SavedTask = validate(_SavedTask, run.task, f"{run.directory / REQUEST}: task")
        config = validate(NavigationConfig, saved.settings, f"{run.directory / REQUEST}: task.settings")
        return cls(config, saved.episodes, saved.seed, find_published(saved.published))

    def mode(self, label: str) -> str:
        return next((mode for mode in (TRUE_PLACE, WITHOUT) if label.endswith(mode)), "")

    def input(self, label: str, method: Localizer, dataset: Dataset) -> tuple[str, ...]:
        return (TRUE_PLACE,) if label == TRUE_PLACE else super().input(label, method, dataset)

    def survey(self, dataset: Dataset) -> NavigationSurvey:
        sites = {world.id: Site(world, Guide(world.chart, self.config.planner)) for world in open_worlds(dataset)}
        if isinstance(self.requests, int):
            episodes, left_out = draw_episodes(sites, self.requests, self.seed)
        else:
            episodes, left_out = resolve_episodes(self.requests, sites, self.seed)
        if self.published:
            left_out.append(self.published.note)
        # World by world, so that a localizer loads the map of each world once.
        order = {world: number for number, world in enumerate(dict.fromkeys(one.world for one in episodes))}
        pieces = sorted(episodes, key=lambda one: order[one.world])
        return NavigationSurvey(dataset, pieces, tuple(left_out), sites=sites)

    def key(self, piece: Episode) -> tuple[int]:
        return (piece.number,)

    def open(
        self, label: str, method: Localizer, survey: NavigationSurvey, todo: Sequence[Episode], folder: Path
    ) -> Worker[Episode]:
        if label == TRUE_PLACE:
            return Walking(None, survey.sites, self.config, self.seed)
        check_needs(method, survey.dataset)
        localizer = AgentLocalizer(method, survey.dataset.content_key, positioning=not self.mode(label))
        return Walking(localizer, survey.sites, self.config, self.seed)

    def failed(self, piece: Episode) -> Row:
        failure = {"success": False, "oracle": False, "spl": 0.0, **dict.fromkeys(SUCCESS_LIMITS_M, False)}
        return {"world": piece.world, "goal": piece.goal, **failure, "shortest_m": piece.shortest_m}

    def summarize(self, parts: Sequence[Part[NavigationSurvey, EpisodeRow]], seed: int) -> tuple[NavigationRow, ...]:
        return summarize_agents(parts, seed, self._scores)

    def _scores(
        self, parts: Sequence[Part[NavigationSurvey, EpisodeRow]], records: Sequence[Record[EpisodeRow]]
    ) -> dict[str, float]:
        """Return the `scores` of NavigationRow for one method."""
        if self.published is None or isinstance(self.requests, int):
            return {}
        paired = zip(parts, records, strict=True)
        scores = [self.published.score(part.dataset.config, len(self.requests), record) for (part, _), record in paired]
        return {
            name: float(np.mean([row[name] for row in scores]))
            for name, value in scores[0].items()
            if isinstance(value, float)
        }

    @classmethod
    def tables(
        cls,
        rows: Sequence[NavigationRow],
        columns: Sequence[str] = (),
        leading: Mapping[str, Sequence[str]] | None = None,
    ) -> list[Table]:
        return [*super().tables(rows, columns, leading), *([] if columns else score_tables(rows, leading))]

    @classmethod
    def plan(cls, request: Request, options: TaskOptions) -> tuple[NavigationTask, Resolved]:
        if not isinstance(options, NavigationOptions):
            raise TypeError(f"the argument options has the type {type(options).__name__}, expected NavigationOptions")
        return plan_navigation(request, options.episodes, options.positioning)

    def view(
        self, result: Result[NavigationRow], records: Sequence[Record[EpisodeRow]], survey: NavigationSurvey
    ) -> NavigationView:
        return NavigationView(result, records, survey, {id: site.world.chart.map for id, site in survey.sites.items()})

    @classmethod
    def part(cls, views: Sequence[NavigationView], arms: Sequence[Arm]) -> dict[str, Any]:
        return {"walks": list_walks(arms, views)}

    def write_files(self, run: Run, survey: NavigationSurvey, records: Sequence[Record[EpisodeRow]]) -> None:
        episodes = sorted(survey.pieces, key=lambda episode: episode.number)
        write_json(run.directory / "episodes.json", [asdict(episode) for episode in episodes])
        for record in records:
            write_trajectories(record)


def navigate(
    request: Request,
    *,
    episodes: int | str | Path = 100,
    positioning: Positioning = Positioning.ON,
    progress: Progress | None = None,
) -> Result[NavigationRow]:
    """Navigate an agent through the buildings of a dataset with each method as its localizer.

    An interrupted run is resumed. An agent without positioning ignores the poses of the method. Its position is the
    node of the method's first place, and its heading comes from odometry. The agent TRUE_PLACE uses no method. Its
    position is the node that is truly nearest.

    Args:
        request: The request. Settings "navigation.KEY" are those of NavigationConfig. The seed is used for episodes,
            noise and intervals.
        episodes: The number of random episodes, a JSON file of episodes, or "BENCHMARK:SPLIT": a split of a benchmark
            whose files are in the `root` of the dataset. In a benchmark the agent knows the goals, and the answers of
            each method are written in the format of the benchmark.
        positioning: The agents to run for each method: with positioning, without, or both.
        progress: Reports the progress.

    Raises:
        SalframeError: A name, a setting or a file is wrong.
        InputMissing: The dataset cannot render panoramas.
    """
    task, resolved = plan_navigation(request, episodes, positioning)
    return run_task(task, request, resolved, progress=progress)


def plan_navigation(
    request: Request, episodes: int | str | Path, positioning: Positioning
) -> tuple[NavigationTask, Resolved]:
    """Return the task of a request, and its methods with a label for each agent. Raises SalframeError as `navigate`."""
    if isinstance(episodes, int) and not 1 <= episodes <= MAX_EPISODES:
        raise ConfigError(
            f"received {shorten(str(episodes), 40)} as the number of episodes, expected 1 to {MAX_EPISODES}"
        )
    resolved: Resolved = resolve(request, scopes=("navigation",))
    content: dict[str, Any] = {}
    for one_scope in resolved.scopes["navigation"]:
        content = merge(content, one_scope)
    positioning = Positioning(positioning)
    arms = {label + arm: label for label in resolved.methods for arm in ARMS[positioning]}
    methods = {arm: resolved.methods[label] for arm, label in arms.items()}
    requested_as = {arm: resolved.requested_as[label] for arm, label in arms.items()}
    if positioning is Positioning.ALL:  # every label of a run folder needs a method; the first one is a placeholder
        methods[TRUE_PLACE] = next(iter(resolved.methods.values()))
    published = find_published(episodes)
    if published:
        task_episodes: int | tuple[EpisodeRequest, ...] = published.episodes(resolved.data)
    else:
        task_episodes = episodes if isinstance(episodes, int) else read_episode_requests(Path(episodes))
    task = NavigationTask(validate(NavigationConfig, content, "navigation"), task_episodes, request.seed, published)
    changes = {arm: resolved.changes[label] for arm, label in arms.items() if label in resolved.changes}
    substitutions = {
        arm: resolved.substitutions[label] for arm, label in arms.items() if label in resolved.substitutions
    }
    return task, replace(
        resolved, methods=methods, requested_as=requested_as, changes=changes, substitutions=substitutions
    )
