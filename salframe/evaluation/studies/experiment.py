"""Experiments: the tables that are reported, each by one command, and what came of them as a file that lasts."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import identity_of
from salframe.evaluation.studies.kept import KEPT_FORMAT, Kept, has_ended, keep, kept_tables, read_results
from salframe.evaluation.studies.study import PooledRuns, Study, StudyResult, plan, run_study
from salframe.evaluation.tables.reported import ReportedTable, read_reported
from salframe.evaluation.tables.table import Table
from salframe.framework.components.identity import identity
from salframe.framework.components.presets import SUFFIXES
from salframe.framework.components.registry import registry
from salframe.framework.config import merge, read_yaml
from salframe.framework.errors import ConfigError, InputMissing, SalframeError, UnknownName, unknown
from salframe.framework.files.hashes import digest
from salframe.framework.files.writing import write_json
from salframe.framework.validation import Settings, validate
from salframe.panoramas.opening import Progress

FOLDER = "experiments"
"""Of presets, that holds the experiments."""
RESULTS = Path("docs") / "results"
"""Where results are kept unless somewhere else is named."""


class TableStudy(Study):
    """A study that is one table of an experiment."""

    title: str = Field(description="what stands above the table")
    columns: tuple[str, ...] = Field((), description="the columns to show; empty: the usual ones")
    quick: dict[str, Any] | Literal[False] = Field(
        {}, description="what `--quick` changes: keys of the table, laid over it; false: it leaves the table out"
    )


class Experiment(Settings):
    """The content of an experiment's file."""

    title: str
    question: str = Field(description="what it is to show")
    reported: tuple[str, ...] = Field((), description="titles of the reported tables to show beside it")
    differs: str = Field("", description="in what the data differ from those of the reported figures")
    tables: dict[str, TableStudy]


@dataclass(frozen=True, eq=False)
class TableResult:
    """A table of an experiment. kept: what came of it, now or before; skipped: why it was not measured; fresh: what was
    measured now."""

    name: str
    study: TableStudy
    kept: Kept | None = None
    skipped: str | None = None
    fresh: StudyResult | None = None

    def tables(self) -> list[Table]:
        """The rows as text."""
        shown = [] if self.kept is None else kept_tables(self.study, self.kept, self.study.columns)
        return [replace(table, title=", ".join(filter(None, (self.study.title, table.title)))) for table in shown]


@dataclass(frozen=True, eq=False)
class ExperimentResult:
    """An experiment and its tables, with the reported ones; file: where the results are kept."""

    name: str
    experiment: Experiment
    quick: bool
    file: Path
    tables: tuple[TableResult, ...]
    reported: tuple[tuple[str, ReportedTable], ...]

    @property
    def crashed(self) -> bool:
        """Whether a method that was measured now raised or died."""
        return any(table.fresh is not None and table.fresh.crashed for table in self.tables)

    def to_json(self) -> dict[str, Any]:
        """What was kept of it, and what was skipped."""
        kept = {table.name: table.kept.model_dump(mode="json") for table in self.tables if table.kept}
        skipped = {table.name: table.skipped for table in self.tables if table.skipped}
        return {"format": KEPT_FORMAT, "experiment": self.name, "quick": self.quick, "tables": kept, "skipped": skipped}


def experiment_names() -> list[str]:
    """The experiments that are shipped, in the order in which they are run."""
    return list(registry().list_presets(FOLDER))


def read_experiment(name: str | Path) -> Experiment:
    """The experiment of a name, or in a YAML file. Raises ConfigError, UnknownName."""
    path: Path | None = Path(name)
    if not str(name).endswith(SUFFIXES):
        path = registry().find_preset(FOLDER, str(name))
    if path is None:
        raise UnknownName(unknown("experiment", str(name), experiment_names()))
    experiment: Experiment = validate(Experiment, read_yaml(path), f"{name}:")
    for table in experiment.tables.values():
        absent = [column for column in table.columns if column not in table.kind.columns]
        if absent:
            raise ConfigError(f"{name}: {unknown('column', absent[0], list(table.kind.columns))}")
    return experiment


def run_experiment(
    name: str | Path,
    request: Request,
    *,
    quick: bool = False,
    force: bool = False,
    results: str | Path = RESULTS,
    progress: Progress | None = None,
) -> ExperimentResult:
    """Measure the tables of an experiment that were not measured yet, or not with these settings and versions.

    The request gives runs, engine, seed, and the folder of data that are not rendered (data_dir): tables on such data
    are skipped without it. `quick`: fewer seeds and methods; `force`: measure all again; `results`: the folder of the
    files that last. Raises SalframeError on settings that are wrong.
    """
    experiment, label = read_experiment(name), Path(name).stem
    file = Path(results) / f"{label}.json"
    found = []
    for number, (table_name, whole) in enumerate(experiment.tables.items()):
        if progress:
            progress("tables", number, len(experiment.tables))
        study = in_quick(whole, f"{name}: {table_name}") if quick else whole
        if study is not None:
            asked = replace(request, name=f"{label}-{table_name}")
            found.append(_table(table_name, study, asked, file, quick=quick, force=force, progress=progress))
    return ExperimentResult(label, experiment, quick, file, tuple(found), reported_in(experiment))


def _table(
    name: str, study: TableStudy, request: Request, file: Path, *, quick: bool, force: bool, progress: Progress | None
) -> TableResult:
    """A table, measured unless it is kept already, as a quick one or not. What is wrong with it costs no other."""
    results, part = read_results(file), "quick" if quick else "whole"
    kept, fresh = getattr(results, part).get(name), None
    try:
        request = _with_data(study, request)
        known_by = _known_by(plan(study, request))
        known = (one for one in (results.whole.get(name), results.quick.get(name)) if one and one.known_by == known_by)
        there = [one for one in known if has_ended(study, one)]
        if there and not force:
            kept = there[0]
        else:
            fresh = (_run_again if force else run_study)(study, request, progress=progress)
            kept = keep(fresh, known_by)
    except SalframeError as error:
        return TableResult(name, study, kept, skipped=str(error))
    results = read_results(file)  # another table may have been measured meanwhile
    tables = {**getattr(results, part), name: kept}
    if tables != getattr(results, part):
        write_json(file, results.model_copy(update={part: tables}).model_dump(mode="json"))
    return TableResult(name, study, kept, fresh=fresh)


def _run_again(study: Study, request: Request, *, progress: Progress | None) -> StudyResult:
    """As `run_study`, but by runs that take nothing over from those before, whose place they take when all are done."""
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
    """The request with its folder of data where the study's data is in a folder, otherwise without. Raises InputMissing
    where there is none."""
    without = replace(request, data_dir=None)
    if request.data_dir is not None and study.options.in_data_folder:
        return request  # its episodes are in the folder too
    configs = [resolved.data for arm in plan(study, without) for _, _, resolved in arm.runs]
    if not any(getattr(config, "root", "") is None for config in configs):
        return without
    if request.data_dir is None:
        raise InputMissing(f"its data, {configs[0].kind}, are not rendered: name their folder by --data-dir")
    return request


def _known_by(arms: Sequence[PooledRuns]) -> str:
    """The hash of all that a table depends on but for the content of folders."""
    runs = []
    for arm in arms:
        for task, asked, resolved in arm.runs:
            data = identity(resolved.data)
            data["settings"] = {key: value for key, value in data["settings"].items() if key != "root"}
            methods = {label: identity_of(config) for label, config in resolved.methods.items()}
            runs.append([task.name, task.version, task.identity(), asked.seed, data, methods])
    return digest(runs)


def in_quick(study: TableStudy, where: str) -> TableStudy | None:
    """The table as `--quick` measures it; None where it leaves it out. Methods that it lists are those of the table."""
    if study.quick is False:
        return None
    content = study.model_dump(mode="json", exclude={"quick"}, exclude_defaults=True)
    over = dict(study.quick)
    if isinstance(study.methods, dict) and "methods" in over:
        if absent := [name for name in over["methods"] if name not in content["methods"]]:
            raise ConfigError(f"{where}: quick: {unknown('method', absent[0], list(content['methods']))}")
        over["methods"] = {name: content["methods"][name] for name in over["methods"]}
        del content["methods"]
    return validate(TableStudy, merge(content, over), f"{where}: quick")


def reported_in(experiment: Experiment) -> tuple[tuple[str, ReportedTable], ...]:
    """The reported tables that stand beside an experiment, each with its source. Raises ConfigError on a title that no
    paper has."""
    known = {part.title: (paper.source, part) for paper in read_reported() for part in paper.tables}
    absent = [title for title in experiment.reported if title not in known]
    if absent:
        raise ConfigError(unknown("reported table", absent[0], list(known)))
    return tuple(known[title] for title in experiment.reported)
