"""Studies: methods on data, with some settings of both varied, each row pooled over seeds. An ablation is one."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, Field, model_validator

from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.runs.request import Request, Resolved, Variant
from salframe.evaluation.runs.runner import pool, run_task
from salframe.evaluation.runs.task import RESULT_FORMAT, AnyTask, Result, Rows, TaskOptions
from salframe.evaluation.tables.reported import Reported
from salframe.evaluation.tables.table import METHOD, Table
from salframe.evaluation.tasks.all import DEFAULT, find_task
from salframe.framework.components.presets import settings, short_name
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import spell_value
from salframe.framework.config import read_yaml
from salframe.framework.errors import ConfigError, UnknownName, unknown
from salframe.framework.validation import Settings, validate
from salframe.panoramas.opening import Progress

DATA, ARM, SEED = "data", "arm", "data.seed"


class StudiedMethod(Settings):
    """A method with settings of its own."""

    method: str = Field(description="a preset, a component or a YAML file")
    set: dict[str, Any] = Field({}, description="its settings, by dotted key")


class Study(Settings):
    """The content of a study's file, with the options of its task. Keys of `set` and `vary` are dotted, as `--set`
    takes them."""

    model_config = ConfigDict(extra="allow")

    task: str = Field(DEFAULT, description="what is measured")
    method: str | None = Field(None, description="the method to study; a detector of the tasks detection and sensor")
    methods: tuple[str, ...] | dict[str, str | StudiedMethod] = Field(
        (), description="or several; by what they are called where they have settings of their own"
    )
    data: str | tuple[str, ...] | None = Field(None, description="dataset to run on, or several; null: the default one")
    seeds: tuple[int, ...] = Field((), description="values of data.seed that are pooled into one row")
    set: dict[str, Any] = Field({}, description="settings that all have")
    vary: dict[str, tuple[Any, ...]] = Field(
        {}, description="values of each key; every combination is a row, of the methods that have the key"
    )
    arms: dict[str, dict[str, Any]] = Field(
        {}, description="settings of the data that go together, by what they are called; a row each"
    )

    @model_validator(mode="after")
    def _check(self) -> Study:
        if (self.method is None) == (not self.methods):
            raise ValueError("expected either method or methods")
        empty = [key for key, values in self.vary.items() if not values]
        if empty:
            raise ValueError(f"vary.{', '.join(empty)} holds no value, expected at least one")
        try:
            kind = self.kind
        except UnknownName as error:
            raise ValueError(str(error)) from None
        known = [*type(self).model_fields, *kind.Options.model_fields]
        absent = [key for key in self.model_extra or {} if key not in known]
        if absent:
            raise ValueError(f"unknown key {absent[0]} (known: {', '.join(known)})")
        try:
            validate(kind.Options, self.model_extra or {}, self.task)
        except ConfigError as error:
            raise ValueError(str(error)) from None
        return self

    @property
    def kind(self) -> type[AnyTask]:
        """The task."""
        return find_task(self.task)

    @property
    def options(self) -> TaskOptions:
        """The options of the task."""
        return self.kind.Options.model_validate(self.model_extra or {})

    @property
    def role(self) -> str:
        """What the methods are."""
        return self.kind.role

    def variants(self) -> tuple[list[Variant], list[Mapping[str, Any]]]:
        """The methods with every combination of the settings that vary, and what these are for each. Raises ConfigError
        on a key that no method has."""
        found: list[Variant] = []
        varied: list[Mapping[str, Any]] = []
        keys = self.varied(of_data=False)
        known = {f"{DATA}.KEY"}
        for name, one in self._methods().items():
            model = registry().get(self.role, settings(self.role, one.method).get("kind", one.method)).Config
            firsts = {name, *model.model_fields} - {"kind"}
            own = [key for key in keys if key.split(".")[0] in firsts]
            known |= firsts
            for values in itertools.product(*(self.vary[key] for key in own)):
                choice = dict(zip(own, values, strict=True))
                told = f"[{','.join(f'{key}={spell_value(value)}' for key, value in choice.items())}]" if choice else ""
                over = {**one.set, **{key.removeprefix(f"{name}."): value for key, value in choice.items()}}
                found.append(Variant(one.method, over, name, name + told))
                varied.append(choice)
        for key in keys:
            if key.split(".")[0] not in known:
                raise ConfigError(f"vary holds {key}: {unknown('key', key.split('.')[0], sorted(known))}")
        labels = [variant.label for variant in found]
        twice = [label for label in labels if labels.count(label) > 1]
        if twice:
            raise ConfigError(f"vary gives {twice[0]} twice, expected different values")
        return found, varied

    def _methods(self) -> dict[str, StudiedMethod]:
        """The methods by name."""
        if isinstance(self.methods, dict):
            given = self.methods.items()
            return {name: StudiedMethod(method=one) if isinstance(one, str) else one for name, one in given}
        return {short_name(name): StudiedMethod(method=name) for name in self.methods or (str(self.method),)}

    def varied(self, *, of_data: bool) -> list[str]:
        """The keys that vary: those of the data set, or the others."""
        return [key for key in self.vary if key.startswith(f"{DATA}.") == of_data]


@dataclass(frozen=True, eq=False)
class StudyResult(Rows):
    """The rows of a study, one for each method and combination of what varies; `settings`: what that is for each row,
    by key, the data set under "data" where there are several, an arm under "arm". runs: the folders; report: the page
    of a single one."""

    kind: type[AnyTask]
    runs: tuple[Path, ...]
    rows: tuple[Any, ...]
    settings: tuple[Mapping[str, Any], ...]
    notes: tuple[str, ...] = ()
    reported: tuple[Reported, ...] = ()
    report: Path | None = None

    @property
    def task(self) -> str:
        """The name of the task."""
        return self.kind.name

    @property
    def where(self) -> str:
        """Where to look on: the report of a single run, otherwise the runs."""
        if self.report is not None:
            return f"report: {self.report}"
        return f"runs: {' '.join(map(str, self.runs))}"

    def tables(self) -> list[Table]:
        """The rows as tables, a column for each setting that varies."""
        return self.kind.tables(self.rows, (), leading_columns(self.kind, self.rows, self.settings))

    def to_json(self) -> dict[str, Any]:
        """All of it; "format" numbers the layout."""
        rows = [{"settings": dict(given), **row.to_json()} for given, row in zip(self.settings, self.rows, strict=True)]
        runs = [str(run) for run in self.runs]
        return {"format": RESULT_FORMAT, "task": self.task, "runs": runs, "rows": rows, "notes": list(self.notes)}


def leading_columns(
    kind: type[AnyTask], rows: Sequence[MethodRow], settings: Sequence[Mapping[str, Any]]
) -> dict[str, list[str]]:
    """What names the rows of a study: the settings of the data, the method, its settings; a blank where one is not
    varied."""
    keys = list(dict.fromkeys(key for given in settings for key in given))
    told = {key: [spell_value(given[key]) if key in given else "" for given in settings] for key in keys}
    names = (DATA, ARM, *kind.Options.model_fields)
    of_data = {key: texts for key, texts in told.items() if key in names or key.startswith(f"{DATA}.")}
    methods = {METHOD: [_name(row.method) for row in rows]}
    return {**of_data, **methods, **{key: texts for key, texts in told.items() if key not in of_data}}


def _name(label: str) -> str:
    """A method's label without the settings in it, but with what follows them."""
    name, _, rest = label.partition("[")
    return name + rest.rpartition("]")[2]


def read_study(file: Path) -> Study:
    """Read a study's file, or an ablation that a plugin ships by its name. Raises ConfigError."""
    shipped = None if file.exists() else registry().find_preset("ablations", str(file))
    return validate(Study, read_yaml(shipped or file), f"{file}:")


def ablate(file: str | Path, request: Request, *, progress: Progress | None = None) -> StudyResult:
    """Measure every combination of the values under `vary:` in a file, a row each.

    `file`: a YAML file, or the name of a shipped ablation. The request names no method, for the file does; its data and
    settings overrule the file's. Raises ConfigError on wrong keys.
    """
    file = Path(file)
    study = read_study(file)
    try:
        return run_study(study, replace(request, name=request.name or file.stem), progress=progress)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None


@dataclass(frozen=True, eq=False)
class PooledRuns:
    """Runs whose rows are pooled, a request each with what it is resolved to; settings: those of the data that vary."""

    runs: Sequence[tuple[AnyTask, Request, Resolved]]
    settings: Mapping[str, Any]


def plan(study: Study, request: Request) -> list[PooledRuns]:
    """The runs of a study. Raises ConfigError on keys that nobody has."""
    of_data = study.varied(of_data=True)
    called = list(study.arms.items()) or [("", {})]
    names = study.data if isinstance(study.data, tuple) and not request.data else (request.data or study.data,)
    variants, _ = study.variants()
    arms = []
    varied = (study.vary[key] for key in of_data)
    options = study.kind.vary(study.options)
    for name, (arm, together), (varied_options, option), *values in itertools.product(names, called, options, *varied):
        chosen = dict(zip(of_data, values, strict=True))
        runs = []
        for seed in [{SEED: seed} for seed in study.seeds] or [{}]:
            given = {**study.set, **together, **chosen, **seed}
            fixed = [f"{key}={json.dumps(value)}" for key, value in given.items()]
            asked = replace(request, methods=variants, data=name, settings=(*fixed, *request.settings))
            task, resolved = study.kind.plan(asked, option)
            runs.append((task, asked, resolved))
        told = {**({DATA: name} if len(names) > 1 else {}), **({ARM: arm} if study.arms else {})}
        told |= {**varied_options, **chosen}
        arms.append(PooledRuns(runs, told))
    return arms


def run_study(study: Study, request: Request, *, progress: Progress | None = None) -> StudyResult:
    """Run a study; what was run before is not run again. Raises ConfigError on keys that nobody has, SalframeError as
    `run_task`."""
    arms = plan(study, request)
    variants, varied = study.variants()
    of_method = {variant.label: choice for variant, choice in zip(variants, varied, strict=True)}
    count = sum(len(arm.runs) for arm in arms)
    results: list[Result[Any]] = []
    rows: list[MethodRow] = []
    told: list[Mapping[str, Any]] = []
    for arm in arms:
        first = len(results)
        for task, asked, resolved in arm.runs:
            if progress and count > 1:
                progress("runs", len(results), count)
            results.append(run_task(task, asked, resolved, progress=progress))
        alike = results[first:]
        found = alike[0].rows if len(alike) == 1 else pool(arm.runs[0][0], [result.run for result in alike])
        rows += found
        asked_as = arm.runs[0][2].asked_as
        told += [{**arm.settings, **of_method.get(asked_as.get(row.method, ""), {})} for row in found]
    notes = dict.fromkeys(note for result in results for note in result.notes)
    report = results[0].report if count == 1 else None
    runs = tuple(result.run for result in results)
    return StudyResult(study.kind, runs, tuple(rows), tuple(told), tuple(notes), report=report)
