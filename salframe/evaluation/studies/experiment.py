"""Experiments: reported tables, each measured by one command, with their results stored in a file."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import identity_of
from salframe.evaluation.runs.task import AnyTask
from salframe.evaluation.studies.stored import (
    RESULTS_FORMAT,
    StoredTable,
    has_ended,
    read_results,
    store_table,
    stored_tables,
)
from salframe.evaluation.studies.study import DATA, PooledRuns, Study, StudyResult, plan, run_study
from salframe.evaluation.tables.reported import ReportedTable, read_reported
from salframe.evaluation.tables.table import Table
from salframe.framework.components.identity import identity
from salframe.framework.components.presets import SUFFIXES
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import spell_value
from salframe.framework.config import merge, read_yaml
from salframe.framework.errors import ConfigError, InputMissing, SalframeError, UnknownName, unknown
from salframe.framework.files.hashes import digest
from salframe.framework.files.writing import write_json
from salframe.framework.validation import Settings, validate
from salframe.panoramas.opening import Progress

FOLDER = "experiments"
"""Folder of presets that holds the experiments."""
RESULTS = Path("results")
"""Default folder of the files with the stored results of experiments."""


class TableStudy(Study):
    """A study whose results are one table of an experiment."""

    title: str = Field(description="title that is printed above the table")
    columns: tuple[str, ...] = Field(
        (), description="names of the columns of the table to print; empty: the default columns"
    )
    quick: dict[str, Any] | Literal[False] = Field(
        {},
        description="mapping from keys of the table (such as seeds) to the values that they have with the option "
        "`--quick`; false: `--quick` skips the table",
    )

    @property
    def shared_settings(self) -> str:
        """The settings of all methods of the table, "key=value" each; "" if there are none. Settings of the data are
        left out, because the title describes them."""
        return ", ".join(
            f"{key}={spell_value(value)}" for key, value in self.set.items() if not key.startswith(f"{DATA}.")
        )


class Experiment(Settings):
    """Content of the file of an experiment."""

    title: str
    question: str = Field(description="the question that the experiment answers")
    reported: tuple[str, ...] = Field(
        (), description="list of the titles of tables reported in papers that are printed beside the experiment"
    )
    differs: str = Field(
        "", description="how the data of the experiment differ from the data of the tables reported in papers"
    )
    tables: dict[str, TableStudy]


@dataclass(frozen=True, eq=False)
class TableResult:
    """A table of an experiment.

    Attributes:
        name: Name of the table.
        study: The study that the table shows.
        stored: The stored result of the table, of this run or an earlier run.
        skipped: Why the table was not measured.
        fresh: The result of this run; None if the table was not measured now.
    """

    name: str
    study: TableStudy
    stored: StoredTable | None = None
    skipped: str | None = None
    fresh: StudyResult | None = None

    def tables(self, columns: Sequence[str] = ()) -> list[Table]:
        """Return the stored rows as tables.

        `columns` are names of columns. Each table shows those that its task has. Without any, it shows the columns that
        the experiment states.
        """
        names = [name for name in columns if name in self.study.kind.columns] or self.study.columns
        shown = [] if self.stored is None else stored_tables(self.study, self.stored, names)
        shared = f"all rows: {self.study.shared_settings}" if self.study.shared_settings else ""
        return [
            replace(table, title=", ".join(filter(None, (self.study.title, table.title, shared)))) for table in shown
        ]


@dataclass(frozen=True, eq=False)
class ExperimentResult:
    """An experiment, its tables, and the tables reported in papers. `file` is the file with the stored results."""

    name: str
    experiment: Experiment
    quick: bool
    file: Path
    tables: tuple[TableResult, ...]
    reported: tuple[tuple[str, ReportedTable], ...]

    @property
    def crashed(self) -> bool:
        """Whether a method of this run raised an exception or died."""
        return any(table.fresh is not None and table.fresh.crashed for table in self.tables)

    def to_json(self) -> dict[str, Any]:
        """Return the stored results and the skipped tables as JSON."""
        stored = {table.name: table.stored.model_dump(mode="json") for table in self.tables if table.stored}
        skipped = {table.name: table.skipped for table in self.tables if table.skipped}
        return {
            "format": RESULTS_FORMAT,
            "experiment": self.name,
            "quick": self.quick,
            "tables": stored,
            "skipped": skipped,
        }


def experiment_names() -> list[str]:
    """Return the names of the shipped experiments, in the order in which they run."""
    return list(registry().list_presets(FOLDER))


def read_experiment(name: str | Path) -> Experiment:
    """Read a shipped experiment by name, or an experiment in a YAML file. Raises ConfigError, UnknownName."""
    path: Path | None = Path(name)
    if not str(name).endswith(SUFFIXES):
        path = registry().find_preset(FOLDER, str(name))
    if path is None:
        raise UnknownName(unknown("experiment", str(name), experiment_names()))
    experiment: Experiment = validate(Experiment, read_yaml(path), f"{name}:")
    for table_name, table in experiment.tables.items():
        absent = [column for column in table.columns if column not in table.kind.columns]
        if absent:
            raise ConfigError(
                f"{name}: the key `tables.{table_name}.columns` has an "
                f"{unknown('column', absent[0], list(table.kind.columns))}"
            )
    return experiment


def tasks_of(names: Sequence[str | Path]) -> list[type[AnyTask]]:
    """Return the classes of the tasks that the tables of experiments measure, each once. Raises as read_experiment."""
    studies = [study for name in names for study in read_experiment(name).tables.values()]
    return list(dict.fromkeys(study.kind for study in studies))


def run_experiment(
    name: str | Path,
    request: Request,
    *,
    quick: bool = False,
    force: bool = False,
    results: str | Path = RESULTS,
    progress: Progress | None = None,
) -> ExperimentResult:
    """Measure the tables of an experiment that have no stored result with the current settings and versions.

    Args:
        name: A shipped experiment or a YAML file.
        request: Provides `runs`, `engine`, `seed` and `data_dir`, the folder of the data that the user supplies.
            Tables on such data are skipped without `data_dir`.
        quick: Whether to run fewer seeds and methods.
        force: Whether to measure all tables again.
        results: The folder of the files of results.
        progress: Reports the progress.

    Raises:
        SalframeError: A setting is wrong.
    """
    experiment, label = read_experiment(name), Path(name).stem
    file = Path(results) / f"{label}.json"
    tables = []
    for number, (table_name, whole) in enumerate(experiment.tables.items()):
        if progress:
            progress("tables", number, len(experiment.tables))
        study = in_quick(whole, f"{name}: {table_name}") if quick else whole
        if study is not None:
            table_request = replace(request, name=f"{label}-{table_name}")
            tables.append(_table(table_name, study, table_request, file, quick=quick, force=force, progress=progress))
    return ExperimentResult(label, experiment, quick, file, tuple(tables), reported_in(experiment))


def _table(
    name: str, study: TableStudy, request: Request, file: Path, *, quick: bool, force: bool, progress: Progress | None
) -> TableResult:
    """Return a table. It is measured if no matching result is stored. Errors do not affect other tables."""
    results, part = read_results(file), "quick" if quick else "whole"
    stored, fresh = getattr(results, part).get(name), None
    try:
        request = _with_data(study, request)
        cache_key = _cache_key(plan(study, request))
        candidates = (
            one for one in (results.whole.get(name), results.quick.get(name)) if one and one.cache_key == cache_key
        )
        finished = [one for one in candidates if has_ended(study, one)]
        if finished and not force:
            stored = finished[0]
        else:
            fresh = (_run_again if force else run_study)(study, request, progress=progress)
            stored = store_table(fresh, cache_key)
    except SalframeError as error:
        return TableResult(name, study, stored, skipped=str(error))
    results = read_results(file)  # another table may have been measured meanwhile
    tables = {**getattr(results, part), name: stored}
    if tables != getattr(results, part):
        write_json(file, results.model_copy(update={part: tables}).model_dump(mode="json"))
    return TableResult(name, study, stored, fresh=fresh)


def _run_again(study: Study, request: Request, *, progress: Progress | None) -> StudyResult:
    """Run a study without reusing answers, and replace the earlier run folders when all runs are done."""
    apart = Path(request.runs) / f"{request.name}.again"
    fresh = run_study(study, replace(request, runs=apart), progress=progress)
    moved = {run: Path(request.runs) / run.name for run in fresh.runs}
    for run, place in moved.items():
        shutil.rmtree(place, ignore_errors=True)
        run.replace(place)
    apart.rmdir()
    report = fresh.report and moved[fresh.report.parent] / fresh.report.name
    return replace(fresh, runs=tuple(moved.values()), report=report)


def _with_data(study: Study, request: Request) -> Request:
    """Return the request, without its data folder if the study's dataset needs none.

    Raises InputMissing if the study needs a data folder and the request has none.
    """
    without = replace(request, data_dir=None)
    if request.data_dir is not None and study.options.in_data_folder:
        return request  # its episodes are in the folder too
    configs = [resolved.data for arm in plan(study, without) for _, _, resolved in arm.runs]
    if not any(getattr(config, "root", "") is None for config in configs):
        return without
    if request.data_dir is None:
        raise InputMissing(
            f"the dataset {configs[0].kind} needs files that you supply: pass their folder as --data-dir DIR"
        )
    return request


def _cache_key(arms: Sequence[PooledRuns]) -> str:
    """Return the hash of everything that a table depends on, except for the content of data folders."""
    runs = []
    for arm in arms:
        for task, request, resolved in arm.runs:
            data = identity(resolved.data)
            data["settings"] = {key: value for key, value in data["settings"].items() if key != "root"}
            methods = {label: identity_of(config) for label, config in resolved.methods.items()}
            runs.append([task.name, task.version, task.identity(), request.seed, data, methods])
    return digest(runs)


def in_quick(study: TableStudy, where: str) -> TableStudy | None:
    """Return the study of a table with the changes of `--quick` (fewer seeds and methods); None if `--quick` skips the
    table. `where` names the table in errors.

    The methods that `quick` lists must be methods of the table.
    """
    if study.quick is False:
        return None
    content = study.model_dump(mode="json", exclude={"quick"}, exclude_defaults=True)
    changes = dict(study.quick)
    if isinstance(study.methods, dict) and "methods" in changes:
        if absent := [name for name in changes["methods"] if name not in content["methods"]]:
            raise ConfigError(
                f"{where}: the key `quick` has an {unknown('method', absent[0], list(content['methods']))}"
            )
        changes["methods"] = {name: content["methods"][name] for name in changes["methods"]}
        del content["methods"]
    return validate(TableStudy, merge(content, changes), f"{where}: quick")


def reported_in(experiment: Experiment) -> tuple[tuple[str, ReportedTable], ...]:
    """Return the reported tables that an experiment shows, each with its source.

    Raises ConfigError on an unknown title.
    """
    tables_by_title = {part.title: (paper.source, part) for paper in read_reported() for part in paper.tables}
    absent = [title for title in experiment.reported if title not in tables_by_title]
    if absent:
        raise ConfigError(
            f"the key `reported` of the experiment {experiment.title!r} has an "
            f"{unknown('table title', absent[0], list(tables_by_title))}"
        )
    return tuple(tables_by_title[title] for title in experiment.reported)
