"""Methods side by side in closed loop: the same episodes, the same noise, finished episodes never walked again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from salframe.evaluation.compare import Progress, configure_methods, open_run, watch, work_through
from salframe.evaluation.metrics import count_statuses
from salframe.evaluation.navigation_metrics import COLUMNS, success_p_value, summarize
from salframe.evaluation.navigation_report import write_report
from salframe.evaluation.predict import conclude, describe_error, log_crash, open_method
from salframe.evaluation.run import Outcome, RowWriter, Run, read_rows
from salframe.framework.config import merge, nest, parse_override, validate
from salframe.framework.errors import ConfigError
from salframe.framework.files import read_json, write_json
from salframe.navigation.episodes import Episode, Site, draw_episodes, group_by_world, read_episodes
from salframe.navigation.guide import Guide
from salframe.navigation.sight import Sight
from salframe.navigation.walk import NavigationConfig, Row, walk
from salframe.panoramas.dataset import Dataset

Positioning = Literal["on", "off", "both"]
WITHOUT = " without positioning"
"""What the label of a method ends with that is run without its poses."""


@dataclass(frozen=True)
class Navigation:
    """A run and its table: a row a method with the keys of metrics.COLUMNS; `notes`: what could not be asked, a line
    each."""

    run: Path
    rows: tuple[dict[str, Any], ...]
    notes: tuple[str, ...] = ()

    @property
    def report(self) -> Path:
        """The report of the run, with every trajectory."""
        return self.run / "navigation.html"

    @property
    def measured(self) -> bool:
        """Whether some method was measured."""
        return any(row["success_rate"] is not None for row in self.rows)

    @property
    def crashed(self) -> bool:
        """Whether some method raised or died, in an episode or altogether."""
        return any("crashed" in row["status"] for row in self.rows)

    def to_json(self) -> dict[str, Any]:
        """{"run": path, "rows": [...], "notes": [...]}."""
        return {"run": str(self.run), "rows": list(self.rows), "notes": list(self.notes)}


def navigate(
    methods: Sequence[str],
    data: str = "house-12",
    *,
    episodes: int | Path = 100,
    positioning: Positioning = "on",
    data_dir: Path | None = None,
    overrides: Sequence[str] = (),
    name: str | None = None,
    runs: Path = Path("runs"),
    engine: str = "processes",
    seed: int = 0,
    progress: Progress | None = None,
) -> Navigation:
    """Send an agent through a dataset's buildings with each method as its localizer; a run that was begun is resumed.

    `episodes`: how many to draw, or a JSON file of them. Without `positioning` a method's poses are ignored: the agent
    takes itself to stand at the node it is nearest to by the method's first place, and its heading from odometry alone.
    `overrides` are "key.path=value", "navigation.KEY" for NavigationConfig; `seed` is that of episodes, noise and
    intervals; the rest as in `compare`. Raises SalframeError on names, settings and files that are wrong, InputMissing
    on a dataset that cannot render, before anything runs.
    """
    if isinstance(episodes, int) and episodes < 1:
        raise ConfigError(f"received {episodes} episodes, expected at least 1")
    pairs = [parse_override(text) for text in overrides]
    content: dict[str, Any] = {}
    for path, value in pairs:
        if path[0] == "navigation":
            content = merge(content, nest(path[1:], value))
    config: NavigationConfig = validate(NavigationConfig, content, "navigation")
    own = [text for text, (path, _) in zip(overrides, pairs, strict=True) if path[0] != "navigation"]
    plain, given = configure_methods(methods, own)
    arms = {"on": [""], "off": [WITHOUT], "both": ["", WITHOUT]}[positioning]
    configs = {method + arm: localizer for method, localizer in plain.items() for arm in arms}
    asked = episodes if isinstance(episodes, int) else read_json(episodes)
    task = {"episodes": asked, **config.model_dump(mode="json")}
    run, dataset, runner = open_run(
        configs, data, data_dir, given, name, runs, engine, seed, progress, "navigate-", {"navigation": task}
    )
    sites = _sites(dataset, config)
    drawn = draw_episodes(sites, episodes, seed) if isinstance(episodes, int) else read_episodes(episodes, sites, seed)
    write_json(run.directory / "episodes.json", [asdict(episode) for episode in drawn[0]])
    todo = [label for label in configs if not _finished(run, label, drawn[0])]
    with watch(run, lambda label: len(_rows(run, label)), len(drawn[0]), progress):
        work_through(run, runner, play, todo)
    rows = _measure(run, drawn[0])
    for row in rows:
        write_json(run.folder(row["method"]) / "metrics.json", row)
    navigation = Navigation(run.directory, tuple(rows), tuple(drawn[1]))
    known = {label: _rows(run, label) for label in configs}
    write_report(
        navigation.report, run.directory.name, rows, known, {id: site.world.chart.map for id, site in sites.items()}
    )
    return navigation


def _sites(dataset: Dataset, config: NavigationConfig) -> dict[str, Site]:
    return {world.id: Site(world, Guide(world.chart, config.planner)) for world in dataset.worlds()}


def _rows(run: Run, label: str) -> dict[int, Row]:
    """Rows by episode; of an episode walked again, the last."""
    return {row["episode"]: row for row in read_rows(run.folder(label) / "episodes.jsonl")}


def _finished(run: Run, label: str, episodes: Sequence[Episode]) -> bool:
    outcome, rows = run.outcome(label), _rows(run, label)
    return (
        outcome is not None
        and outcome.status == "done"
        and all(e.number in rows and rows[e.number]["status"] != "crashed" for e in episodes)
    )


def play(directory: Path, label: str) -> None:
    """Walk the episodes of a run that the method `label` has not ended yet."""
    conclude(Run.load(directory), label, _play)


def _play(run: Run, label: str) -> Outcome:
    localizer, dataset = open_method(run, label)
    config: NavigationConfig = validate(
        NavigationConfig, {k: v for k, v in run.content["navigation"].items() if k != "episodes"}, "navigation"
    )
    ended = {number for number, row in _rows(run, label).items() if row["status"] != "crashed"}
    episodes = [
        Episode(**{**entry, "start": tuple(entry["start"])}) for entry in read_json(run.directory / "episodes.json")
    ]
    sites = _sites(dataset, config)
    sight = Sight(localizer, dataset.fingerprint, positioning=not label.endswith(WITHOUT))
    with RowWriter(run.folder(label) / "episodes.jsonl") as rows:
        for world, own in group_by_world(episodes).items():
            for episode in own:
                if episode.number in ended:
                    continue
                try:
                    row = walk(sites[world], partial(sight.look, sites[world].world), episode, config, run.seed)
                except Exception as error:  # an episode that breaks the method must not take the other episodes with it
                    log_crash(run, label, f"episode {episode.number}")
                    row = _crashed_row(episode, error)
                rows.append(row)
    return Outcome("done", sight.warning)


def _crashed_row(episode: Episode, error: Exception) -> Row:
    return {
        "episode": episode.number,
        "world": episode.world,
        "goal": episode.goal,
        "status": "crashed",
        "success": False,
        "oracle": False,
        "spl": 0.0,
        "success_3m": False,
        "shortest_m": episode.shortest_m,
        "error": describe_error(error),
    }


def _measure(run: Run, episodes: Sequence[Episode]) -> list[dict[str, Any]]:
    """A row of the table for each method, None where a number is absent; p_value is against the first measured one."""
    table: list[dict[str, Any]] = []
    first: list[Row] | None = None
    for label in run.labels:
        known, outcome = _rows(run, label), run.outcome(label)
        rows = [known[episode.number] for episode in episodes if episode.number in known]
        line: dict[str, Any] = {**dict.fromkeys(COLUMNS), "method": label, "episodes": len(episodes), "status": {}}
        if outcome is None or (outcome.status == "done" and len(rows) < len(episodes)):
            outcome = Outcome("unfinished", f"unfinished: {len(rows)} of {len(episodes)} episodes walked")
        line["available"], line["reason"] = outcome.status != "unavailable", outcome.reason
        if outcome.status in ("done", "crashed"):
            line["status"] = count_statuses(row["status"] for row in rows) or {"crashed": len(episodes)}
        if outcome.status == "done":
            line |= summarize(rows, run.seed)
            line["p_value"] = success_p_value(first, rows) if first else None
            first = first or rows
        table.append(line)
    return table
