"""The task `navigation`: methods in closed loop, the same episodes and the same noise for all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.report.view import NavigationView
from salframe.evaluation.runs.request import Request, Resolved, resolve
from salframe.evaluation.runs.result import Result
from salframe.evaluation.runs.rows import EpisodeRow
from salframe.evaluation.runs.run_folder import Row, Run
from salframe.evaluation.runs.runner import run_task
from salframe.evaluation.runs.task import (
    MethodRow,
    Part,
    Record,
    Survey,
    Task,
    Worker,
    by_method,
    check_needs,
    in_common,
)
from salframe.evaluation.statistics import bootstrap_interval, holm, paired_test, proportion_interval
from salframe.evaluation.tasks.navigation.published import Published, find_published
from salframe.framework.config import merge, validate
from salframe.framework.errors import ConfigError
from salframe.framework.files import write_json
from salframe.framework.identity import settings_identity
from salframe.localization.localizer import Localizer
from salframe.navigation.episodes import Asked, Episode, Site, draw_episodes, place_episodes, read_asked
from salframe.navigation.guide import Guide
from salframe.navigation.sight import Sight, see_place
from salframe.navigation.walk import LOOSER_M, NavigationConfig, walk
from salframe.navigation.world import open_worlds
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.opening import Progress

WITHOUT = " without positioning"
"""What the label of a method ends with that is run without its poses."""
TRUE_PLACE = "true place"
"""The label of the arm that no method localizes."""
MEANS = {"travelled_m": "path_m", "panoramas": "panoramas", "collisions": "collisions"}
"""Fields with a mean over the episodes that ended, by the key of an episode's row."""


class Positioning(StrEnum):
    """Which arms to run: each method with its poses, by place and odometry alone, or both; ALL: and an agent that is
    told its true place, and goes by that and odometry."""

    ON = "on"
    OFF = "off"
    BOTH = "both"
    ALL = "all"


ARMS = {
    Positioning.ON: ("",),
    Positioning.OFF: (WITHOUT,),
    Positioning.BOTH: ("", WITHOUT),
    Positioning.ALL: ("", WITHOUT),
}
"""What the labels of methods end with."""


@dataclass(frozen=True, kw_only=True)
class NavigationRow(MethodRow):
    """A method's line: rates over all episodes with their 95 % intervals, a crashed episode a failure; means over those
    that ended; p_value of the exact paired test of success, clustered by goal, against the first measured method, and
    p_adjusted, as by Holm over all that are tested so. scores: of episodes of a published task, the metrics
    of its own scorer by name, means over the data sets where there are several.
    """

    episodes: int
    success_rate: float | None = None
    success_rate_low: float | None = None
    success_rate_high: float | None = None
    oracle_success_rate: float | None = None
    oracle_success_rate_low: float | None = None
    oracle_success_rate_high: float | None = None
    spl: float | None = None
    spl_low: float | None = None
    spl_high: float | None = None
    success_rate_1m: float | None = None
    success_rate_1m_low: float | None = None
    success_rate_1m_high: float | None = None
    success_rate_3m: float | None = None
    success_rate_3m_low: float | None = None
    success_rate_3m_high: float | None = None
    path_m: float | None = None
    panoramas: float | None = None
    collisions: float | None = None
    p_value: float | None = None
    p_adjusted: float | None = None
    scores: Mapping[str, float] = field(default_factory=dict)

    @property
    def measured(self) -> bool:
        return self.success_rate is not None


RATES = {
    "success": "success_rate",
    "oracle": "oracle_success_rate",
    "spl": "spl",
    "success_1m": "success_rate_1m",
    "success_3m": "success_rate_3m",
}
"""Fields with a mean and a 95 % interval (`_low`, `_high`) by the key of an episode's row."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NavigationSurvey(Survey[Episode]):
    """Episodes, and the worlds they are walked in by id."""

    sites: Mapping[str, Site]


def navigate(
    request: Request,
    *,
    episodes: int | str | Path = 100,
    positioning: Positioning = Positioning.ON,
    progress: Progress | None = None,
) -> Result[NavigationRow]:
    """Send an agent through a data set's buildings with each method as its localizer; a run that was begun is resumed.

    `episodes`: how many to draw, a JSON file of them, or "TASK:SPLIT", those of a published task whose scorer has them
    and whose files are in the data set's `root`: the agent is told their goals, and the answers of each method are
    written in the task's form. Without `positioning` a method's poses are ignored: the agent
    takes itself to stand at the node it is nearest to by the method's first place, and its heading from odometry alone;
    the arm TRUE_PLACE does the same with the node that it is really nearest to, and has no method.
    Settings "navigation.KEY" are for NavigationConfig; the request's seed is that of episodes, noise and intervals.
    Raises SalframeError on names, settings and files that are wrong, InputMissing on a data set that cannot render,
    before anything runs.
    """
    task, resolved = plan_navigation(request, episodes, positioning)
    return run_task(task, request, resolved, progress=progress)


def plan_navigation(
    request: Request, episodes: int | str | Path, positioning: Positioning
) -> tuple[NavigationTask, Resolved]:
    """The task of a request, and its methods, one for each arm. Raises SalframeError as `navigate`."""
    if isinstance(episodes, int) and episodes < 1:
        raise ConfigError(f"received {episodes} episodes, expected at least 1")
    resolved: Resolved = resolve(request, scopes=("navigation",))
    content: dict[str, Any] = {}
    for given in resolved.scopes["navigation"]:
        content = merge(content, given)
    positioning = Positioning(positioning)
    arms = {label + arm: label for label in resolved.methods for arm in ARMS[positioning]}
    methods = {arm: resolved.methods[label] for arm, label in arms.items()}
    asked_as = {arm: resolved.asked_as[label] for arm, label in arms.items()}
    if positioning is Positioning.ALL:  # a run folder knows labels with methods: the first stands for none
        methods[TRUE_PLACE] = next(iter(resolved.methods.values()))
    published = find_published(episodes)
    if published:
        asked: int | tuple[Asked, ...] = published.episodes(resolved.data)
    else:
        asked = episodes if isinstance(episodes, int) else read_asked(Path(episodes))
    task = NavigationTask(validate(NavigationConfig, content, "navigation"), asked, request.seed, published)
    return task, replace(resolved, methods=methods, asked_as=asked_as)


@dataclass(frozen=True)
class NavigationTask(Task[Episode, NavigationSurvey]):
    """Does the agent get there? `asked`: how many episodes to draw, or which to walk; `published`: the task that they
    are of."""

    config: NavigationConfig
    asked: int | tuple[Asked, ...]
    seed: int
    published: Published | None = None

    name = "navigation"
    version = "2"
    prefix = "navigate-"
    counts = "episodes"
    key_fields = ("episode",)
    row = EpisodeRow
    maps = True

    def asks(self) -> dict[str, Any]:
        asked = self.asked if isinstance(self.asked, int) else [one.model_dump(mode="json") for one in self.asked]
        known = {"episodes": asked, "seed": self.seed, "settings": self.config.model_dump(mode="json")}
        return {**known, **({"published": str(self.published)} if self.published else {})}

    def identity(self) -> dict[str, Any]:
        return {**self.asks(), "settings": settings_identity(self.config)}

    @classmethod
    def from_run(cls, run: Run) -> NavigationTask:
        asked, config = run.task["episodes"], validate(NavigationConfig, run.task["settings"], "navigation")
        given = asked if isinstance(asked, int) else tuple(Asked.model_validate(one) for one in asked)
        return cls(config, given, run.task["seed"], find_published(run.task.get("published", "")))

    def mode(self, label: str) -> str:
        return next((mode for mode in (TRUE_PLACE, WITHOUT) if label.endswith(mode)), "")

    def given(self, label: str, method: Localizer, dataset: Dataset) -> tuple[str, ...]:
        return (TRUE_PLACE,) if label == TRUE_PLACE else super().given(label, method, dataset)

    def survey(self, dataset: Dataset) -> NavigationSurvey:
        sites = {world.id: Site(world, Guide(world.chart, self.config.planner)) for world in open_worlds(dataset)}
        if isinstance(self.asked, int):
            episodes, left_out = draw_episodes(sites, self.asked, self.seed)
        else:
            episodes, left_out = place_episodes(self.asked, sites, self.seed)
        if self.published:
            left_out.append(self.published.note)
        # World by world: a localizer takes a world's map in once.
        order = {world: number for number, world in enumerate(dict.fromkeys(one.world for one in episodes))}
        pieces = sorted(episodes, key=lambda one: order[one.world])
        return NavigationSurvey(dataset, pieces, tuple(left_out), sites=sites)

    def key(self, piece: Episode) -> tuple[int]:
        return (piece.number,)

    def open(
        self, label: str, method: Localizer, survey: NavigationSurvey, todo: Sequence[Episode], folder: Path
    ) -> Worker[Episode]:
        if label == TRUE_PLACE:
            return _Walking(None, survey.sites, self.config, self.seed)
        check_needs(method, survey.dataset)
        sight = Sight(method, survey.dataset.content_key, positioning=not self.mode(label))
        return _Walking(sight, survey.sites, self.config, self.seed)

    def failed(self, piece: Episode) -> Row:
        failure = {"success": False, "oracle": False, "spl": 0.0, **dict.fromkeys(LOOSER_M, False)}
        return {"world": piece.world, "goal": piece.goal, **failure, "shortest_m": piece.shortest_m}

    def summarize(self, parts: Sequence[Part[NavigationSurvey]], seed: int) -> tuple[NavigationRow, ...]:
        episodes = sum(len(survey.pieces) for survey, _ in parts)
        lines: list[NavigationRow] = []
        first: np.ndarray | None = None
        for records in by_method(parts):
            line = NavigationRow(**in_common(records), episodes=episodes)
            if all(record.done for record in records):
                walked = [_in_order(record) for record in records]
                rows = [row for part in walked for row in part]
                goals = [f"{number}/{row['world']}/{row['goal']}" for number, part in enumerate(walked) for row in part]
                success = np.array([row["success"] for row in rows], bool)
                p_value = None if first is None else paired_test(first, success, goals)
                line = replace(
                    line, **_measure(rows, goals, seed), p_value=p_value, scores=self._scores(parts, records)
                )
                if len(walked) > 1:
                    line = replace(
                        line, by_part=tuple(float(np.mean([row["success"] for row in part])) for part in walked)
                    )
                first = success if first is None else first
            lines.append(line)
        adjusted = holm([line.p_value for line in lines])
        return tuple(replace(line, p_adjusted=p) for line, p in zip(lines, adjusted, strict=True))

    def _scores(self, parts: Sequence[Part[NavigationSurvey]], records: Sequence[Record]) -> dict[str, float]:
        """As in NavigationRow, of one method."""
        if self.published is None or isinstance(self.asked, int):
            return {}
        paired = zip(parts, records, strict=True)
        found = [self.published.score(part.dataset.config, len(self.asked), record) for (part, _), record in paired]
        return {
            name: float(np.mean([row[name] for row in found]))
            for name, value in found[0].items()
            if isinstance(value, float)
        }

    def view(
        self, result: Result[NavigationRow], records: Sequence[Record], survey: NavigationSurvey
    ) -> NavigationView:
        return NavigationView(result, records, {id: site.world.chart.map for id, site in survey.sites.items()})

    def write_files(self, run: Run, survey: NavigationSurvey, records: Sequence[Record]) -> None:
        episodes = sorted(survey.pieces, key=lambda episode: episode.number)
        write_json(run.directory / "episodes.json", [asdict(episode) for episode in episodes])


class _Walking(Worker[Episode]):
    """An agent that looks through a localizer, or is told its true place."""

    def __init__(self, sight: Sight | None, sites: Mapping[str, Site], config: NavigationConfig, seed: int) -> None:
        self._sight, self._sites, self._config, self._seed = sight, sites, config, seed

    def work(self, piece: Episode) -> Row:
        site = self._sites[piece.world]
        look = see_place if self._sight is None else self._sight.look
        return walk(site, partial(look, site.world), piece, self._config, self._seed)

    @property
    def warning(self) -> str | None:
        return None if self._sight is None else self._sight.warning


def _in_order(record: Record) -> list[Row]:
    """A method's episodes as they are numbered."""
    return sorted((row for row in record.rows if row is not None), key=lambda row: row["episode"])


def _measure(rows: Sequence[Row], goals: Sequence[str], seed: int) -> dict[str, Any]:
    """The measured fields of a method's line, from all its episodes, clustered by goal."""
    summary: dict[str, Any] = {}
    for key, name in RATES.items():
        values = np.array([row[key] for row in rows])
        low, high = (
            proportion_interval(values, goals) if values.dtype == bool else bootstrap_interval(values, goals, seed)
        )
        summary |= {name: float(values.mean()), f"{name}_low": low, f"{name}_high": high}
    ended = [row for row in rows if "path" in row]
    for key, name in MEANS.items():
        summary[name] = float(np.mean([row[key] for row in ended])) if ended else None
    return summary
