"""Methods side by side on one dataset: predict each in a process of its own, then evaluate."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from salframe.evaluation.engine import Engine
from salframe.evaluation.evaluate import measure
from salframe.evaluation.predict import describe_error, predict
from salframe.evaluation.report import write_report
from salframe.evaluation.reported import Reported, read_reported
from salframe.evaluation.run import Outcome, Run
from salframe.framework.config import ComponentConfig, parse_override
from salframe.framework.errors import ConfigError, RequirementMissing, WeightsMissing
from salframe.framework.files import write_json
from salframe.framework.presets import Overrides, configure, otherwise, settings
from salframe.framework.registry import registry
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Fold
from salframe.panoramas.opening import dataset_settings, open_dataset

POLL_SECONDS = 0.3

Progress = Callable[[str, int, int], None]
"""progress(what, done, total): `what` is the dataset's name while it is prepared, then a method's label."""


@dataclass(frozen=True)
class Comparison:
    """A run and its table: a row a method with the keys of evaluate.COLUMNS, None where a number is absent; what papers
    report apart.

    `notes`: which method ran instead of one that was asked for, and why, a line each.
    """

    run: Path
    rows: tuple[dict[str, Any], ...]
    reported: tuple[Reported, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def report(self) -> Path:
        """The report of the run."""
        return self.run / "report.html"

    @property
    def measured(self) -> bool:
        """Whether some method was measured."""
        return any(row["accuracy"] is not None for row in self.rows)

    @property
    def crashed(self) -> bool:
        """Whether some method raised or died, on a query or altogether."""
        return any("crashed" in row["status"] for row in self.rows)

    def to_json(self) -> dict[str, Any]:
        """{"run": path, "rows": [...], "notes": [...]}, and "reported": [...] where figures of papers were asked for."""
        content: dict[str, Any] = {"run": str(self.run), "rows": list(self.rows), "notes": list(self.notes)}
        if self.reported:
            content["reported"] = [paper.model_dump(mode="json") for paper in self.reported]
        return content


def compare(
    methods: Sequence[str],
    data: str = "house-12",
    *,
    data_dir: Path | None = None,
    overrides: Sequence[str] = (),
    name: str | None = None,
    runs: Path = Path("runs"),
    engine: str = "processes",
    seed: int = 0,
    progress: Progress | None = None,
    reported: bool = False,
) -> Comparison:
    """Run methods (presets or localizers, by name) on a dataset and measure them; a run that was begun is resumed.

    `data` is a preset, a dataset, or a folder with a manifest.json; `data_dir` sets the dataset's root; `overrides` are
    "key.path=value"; `reported` adds what papers report beside the rows. Raises SalframeError on names and settings
    that are wrong, before anything runs.
    """
    configs, given = configure_methods(methods, overrides)
    configs, notes = choose_runnable(configs, given)
    papers = read_reported() if reported else ()
    comparison = run_methods(configs, data, data_dir, given, name, runs, engine, seed, progress, papers)
    return replace(comparison, notes=notes)


def configure_methods(methods: Sequence[str], overrides: Sequence[str]) -> tuple[dict[str, ComponentConfig], Overrides]:
    """The methods' configurations by name, and all that was set. Raises SalframeError on names and settings that are
    wrong."""
    if not methods:
        raise ConfigError("received no method, expected at least one")
    contents = {method: settings("localizer", method) for method in methods}
    given = Overrides(map(parse_override, overrides), contents)
    return {
        method: configure("localizer", method, contents[method], given.methods[method]) for method in methods
    }, given


def choose_runnable(
    configs: Mapping[str, ComponentConfig], given: Overrides
) -> tuple[dict[str, ComponentConfig], tuple[str, ...]]:
    """The configurations, where a method cannot run here that of the preset which its own names instead, by that one's
    name; and why.

    What was set of a method is set of the one in its place. Where that cannot run either, the method stays, and with it
    the reason.
    """
    chosen, notes = {}, []
    for method, config in configs.items():
        other = otherwise("localizer", method)
        if other is not None and (missing := _missing(config)):
            instead = configure("localizer", other, settings("localizer", other), given.methods[method])
            if not _missing(instead):
                notes.append(f"{other}, not {method}: {missing}")
                method, config = other, instead
        chosen[method] = config
    return chosen, tuple(notes)


def _missing(config: ComponentConfig) -> str | None:
    """Why a method cannot run here, None where it can."""
    try:
        config.component.check(config)
    except (RequirementMissing, WeightsMissing) as error:
        return str(error)
    return None


def run_methods(
    methods: Mapping[str, ComponentConfig],
    data: str,
    data_dir: Path | None,
    given: Overrides,
    name: str | None,
    runs: Path,
    engine: str,
    seed: int,
    progress: Progress | None,
    reported: tuple[Reported, ...] = (),
) -> Comparison:
    """Run configured methods by their label; `given` holds what was set of the dataset and the engine. Else as
    `compare`."""
    run, dataset, runner = open_run(methods, data, data_dir, given, name, runs, engine, seed, progress)
    folds = dataset.folds()
    frames = {frame.id for fold in folds for frame in (*fold.mapping, *fold.queries)}
    total = len(frames) + sum(len(fold.queries) for fold in folds)
    todo = [label for label in methods if not _finished(run, label, folds)]
    with watch(run, run.count_rows, total, progress):
        work_through(run, runner, predict, todo)
    return _conclude(run, dataset, reported)


def open_run(
    methods: Mapping[str, ComponentConfig],
    data: str,
    data_dir: Path | None,
    given: Overrides,
    name: str | None,
    runs: Path,
    engine: str,
    seed: int,
    progress: Progress | None,
    prefix: str = "",
    task: Mapping[str, Any] = {},
) -> tuple[Run, Dataset, Engine]:
    """The run folder, made or resumed, its prepared dataset, and what runs the methods. Without a name it is the prefix
    and the dataset's.

    `task` as in Run.open.
    """
    data_name, content = dataset_settings(data, data_dir)
    dataset_config = configure("dataset", data_name, content, given.data)
    runner: Engine = registry().build("engine", configure("engine", engine, settings("engine", engine), given.engine))
    run = Run.open(runs, name or prefix + data_name, dataset_config, methods, seed, task)
    dataset = open_dataset(dataset_config, progress and partial(progress, data_name))
    run.bind(dataset.fingerprint)
    return run, dataset, runner


def work_through(run: Run, runner: Engine, work: Callable[[Path, str], None], todo: Sequence[str]) -> None:
    """work(run folder, label) for each method; one whose process dies has crashed."""
    for label, result in zip(todo, runner.map(partial(work, run.directory), todo), strict=True):
        if isinstance(result, Exception):
            run.end(label, Outcome("crashed", describe_error(result)))


def _finished(run: Run, label: str, folds: Sequence[Fold]) -> bool:
    outcome, answers = run.outcome(label), run.predictions(label)
    keys = ((fold.id, query.id) for fold in folds for query in fold.queries)
    return (
        outcome is not None
        and outcome.status == "done"
        and all(key in answers and answers[key]["status"] != "crashed" for key in keys)
    )


@contextmanager
def watch(run: Run, count: Callable[[str], int], total: int, progress: Progress | None) -> Iterator[None]:
    """Tell the progress of each method while the block runs, `count` giving the rows in its folder: whatever engine
    runs it."""
    if progress is None:
        yield
        return
    done = threading.Event()

    def tell() -> None:
        for label in run.labels:
            progress(label, min(count(label), total), total)

    def poll() -> None:
        while not done.wait(POLL_SECONDS):
            tell()

    thread = threading.Thread(target=poll, daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        tell()


def evaluate(directory: Path) -> Comparison:
    """Measure a run again from its answers and the dataset's truth, and write its metrics and report. Runs no method.

    Raises ConfigError where `directory` is no run, DataError where the dataset is not the one the run was made on.
    """
    run = Run.load(directory)
    dataset = open_dataset(run.dataset())
    run.bind(dataset.fingerprint)
    return _conclude(run, dataset)


def _conclude(run: Run, dataset: Dataset, reported: tuple[Reported, ...] = ()) -> Comparison:
    evaluation = measure(run, dataset)
    for method in evaluation.methods:
        write_json(run.folder(method.label) / "metrics.json", method.row)
    comparison = Comparison(run.directory, tuple(method.row for method in evaluation.methods), reported)
    write_report(comparison.report, run.directory.name, evaluation, dataset.floors(), reported)
    return comparison
