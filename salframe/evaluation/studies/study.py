"""Studies: methods on datasets with varied settings, pooled over seeds. An ablation is a study."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, Field, model_validator

from salframe.evaluation.runs.changes import base_of, hidden_in, with_changes
from salframe.evaluation.runs.method_row import MethodRow
from salframe.evaluation.runs.request import Request, Resolved, Variant
from salframe.evaluation.runs.run_folder import name_of
from salframe.evaluation.runs.runner import pool, run_task
from salframe.evaluation.runs.task import RESULT_FORMAT, AnyTask, Result, ResultBase, TaskOptions
from salframe.evaluation.tables.reported import Reported
from salframe.evaluation.tables.table import METHOD, Table
from salframe.evaluation.tasks.all import DEFAULT, find_task
from salframe.framework.components.presets import SUFFIXES, settings, short_name
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import spell_value
from salframe.framework.config import read_yaml
from salframe.framework.errors import ConfigError, UnknownName, unknown, unknown_key
from salframe.framework.validation import Settings, validate
from salframe.panoramas.opening import Progress

DATA, ARM, SEED = "data", "arm", "data.seed"
CONDITION = "condition"
"""Heading of the table column that names the arm (a named set of data settings) of each row."""


class StudiedMethod(Settings):
    """A method to measure in a study, and its settings."""

    method: str = Field(description="name of a preset or component, or path of a YAML file")
    set: dict[str, Any] = Field({}, description="mapping from dotted keys to values: the settings of the method")


class Study(Settings):
    """Content of the file of a study, with the options of its task.

    Keys of `set` and `vary` are dotted, as in `--set`.
    """

    model_config = ConfigDict(extra="allow")

    task: str = Field(DEFAULT, description="name of the task that measures the methods, such as localization")
    method: str | None = Field(None, description="method to study; in the tasks detection and sensor, a detector")
    methods: tuple[str, ...] | dict[str, str | StudiedMethod] = Field(
        (),
        description="methods to study: a list of names, or a mapping from the name of a row to a method with its "
        "settings",
    )
    data: str | tuple[str, ...] | None = Field(
        None, description="name of the dataset, or a list of names; null: the default dataset"
    )
    seeds: tuple[int, ...] = Field(
        (), description="list of values of data.seed; the results of all of them are pooled in one row"
    )
    set: dict[str, Any] = Field(
        {}, description="mapping from dotted keys to values: the settings of all rows of the table"
    )
    vary: dict[str, tuple[Any, ...]] = Field(
        {},
        description="mapping from dotted keys to lists of values; each combination of values is a row, for the "
        "methods that have the keys",
    )
    arms: dict[str, dict[str, Any]] = Field(
        {}, description="mapping from row names to settings of the data; each entry is a row of the table"
    )

    @model_validator(mode="after")
    def _check(self) -> Study:
        if (self.method is None) == (not self.methods):
            received = "neither" if self.method is None else "both"
            raise ValueError(f"received {received} of the keys `method` and `methods`, expected exactly one of them")
        empty = [key for key, values in self.vary.items() if not values]
        if empty:
            raise ValueError(
                f"the key `vary` has no values for {', '.join(empty)}, expected at least one value for each key"
            )
        try:
            kind = self.kind
        except UnknownName as error:
            raise ValueError(str(error)) from None
        known_keys = [*type(self).model_fields, *kind.Options.model_fields]
        absent = [key for key in self.model_extra or {} if key not in known_keys]
        if absent:
            raise ValueError(unknown_key("key", absent[0], known_keys))
        try:
            validate(kind.Options, self.model_extra or {}, "")
        except ConfigError as error:
            raise ValueError(str(error)) from None
        return self

    @property
    def kind(self) -> type[AnyTask]:
        """Class of the task."""
        return find_task(self.task)

    @property
    def options(self) -> TaskOptions:
        """Options of the task."""
        return self.kind.Options.model_validate(self.model_extra or {})

    @property
    def role(self) -> str:
        """Role of the methods."""
        return self.kind.role

    def variants(self) -> tuple[list[Variant], list[Mapping[str, Any]]]:
        """Return the methods with every combination of the varied settings, and these settings for each.

        Raises ConfigError on a key that no method has.
        """
        variants: list[Variant] = []
        varied: list[Mapping[str, Any]] = []
        keys = self.varied(of_data=False)
        known_keys = {f"{DATA}.KEY"}
        for name, one in self._methods().items():
            model = registry().get(self.role, settings(self.role, one.method).get("kind", one.method)).Config
            firsts = {name, *model.model_fields} - {"kind"}
            keys_of_method = [key for key in keys if key.split(".")[0] in firsts]
            known_keys |= firsts
            for values in itertools.product(*(self.vary[key] for key in keys_of_method)):
                choice = dict(zip(keys_of_method, values, strict=True))
                suffix = (
                    f"[{','.join(f'{key}={spell_value(value)}' for key, value in choice.items())}]" if choice else ""
                )
                variants.append(Variant(one.method, {**one.set, **choice}, name, name + suffix))
                varied.append(choice)
        for key in keys:
            if key.split(".")[0] not in known_keys:
                problem = unknown_key("setting", key, sorted(known_keys), part=key.split(".")[0])
                raise ConfigError(f"the key `vary` has an {problem}")
        labels = [variant.label for variant in variants]
        twice = [label for label in labels if labels.count(label) > 1]
        if twice:
            raise ConfigError(
                f"two combinations of settings have the same label {twice[0]}, expected different labels: remove "
                "repeated values from `vary`"
            )
        return variants, varied

    def _methods(self) -> dict[str, StudiedMethod]:
        """Return the methods by name."""
        if isinstance(self.methods, dict):
            items = self.methods.items()
            return {name: StudiedMethod(method=one) if isinstance(one, str) else one for name, one in items}
        return {short_name(name): StudiedMethod(method=name) for name in self.methods or (str(self.method),)}

    def varied(self, *, of_data: bool) -> list[str]:
        """Return the varied keys: settings of the dataset if `of_data`, otherwise all other settings."""
        return [key for key in self.vary if key.startswith(f"{DATA}.") == of_data]


@dataclass(frozen=True, eq=False)
class StudyResult(ResultBase):
    """The result of a study: a row for each method and combination of varied settings.

    Attributes:
        kind: The task.
        runs: The run folders.
        rows: The rows.
        settings: The varied settings of each row by key. If there are several datasets or arms (named settings of the
            data), also "data" or "arm".
        notes: Notes of the runs.
        reported: Figures that papers report.
        report: Path of the report if there is a single run.
    """

    kind: type[AnyTask]
    runs: tuple[Path, ...]
    rows: tuple[Any, ...]
    settings: tuple[Mapping[str, Any], ...]
    notes: tuple[str, ...] = ()
    reported: tuple[Reported, ...] = ()
    report: Path | None = None

    @property
    def task(self) -> str:
        """Name of the task."""
        return self.kind.name

    @property
    def where(self) -> str:
        """Path of the report of a single run, or the paths of the run folders."""
        if self.report is not None:
            return f"report: {self.report}"
        return f"runs: {' '.join(map(str, self.runs))}"

    @property
    def caption(self) -> str:
        """The task and the name of the study in words, such as "Localization: study top-k"."""
        return f"{self.task.capitalize()}: study {name_of(self.runs[0])}"

    def tables(self, columns: Sequence[str] = ()) -> list[Table]:
        """Return the rows as tables: a column for each varied setting, then the columns of these names."""
        return self.kind.tables(self.rows, columns, leading_columns(self.kind, self.rows, self.settings))

    def to_json(self) -> dict[str, Any]:
        """Return the result as JSON. The key "format" is the version of the layout."""
        rows = [
            {"settings": dict(varied), **row.to_json()} for varied, row in zip(self.settings, self.rows, strict=True)
        ]
        runs = [str(run) for run in self.runs]
        return {"format": RESULT_FORMAT, "task": self.task, "runs": runs, "rows": rows, "notes": list(self.notes)}


def leading_columns(
    kind: type[AnyTask],
    rows: Sequence[MethodRow],
    settings: Sequence[Mapping[str, Any]],
    shared: Mapping[str, Any] | None = None,
) -> dict[str, list[str]]:
    """Return the leading columns of a study's table, as a mapping from heading to the texts of all rows: the varied
    settings of the data, the method, and the varied settings of the method.

    A text is empty if a setting does not apply to the row. `settings` are the varied settings of each row, and `shared`
    the settings that all rows share.
    """
    keys = list(dict.fromkeys(key for row_settings in settings for key in row_settings))
    texts_by_key = {
        key: [spell_value(row_settings[key]) if key in row_settings else "" for row_settings in settings]
        for key in keys
    }
    names = (DATA, ARM, *kind.Options.model_fields)
    of_data = {key: texts for key, texts in texts_by_key.items() if key in names or key.startswith(f"{DATA}.")}
    of_method = {key: texts for key, texts in texts_by_key.items() if key not in of_data}
    changes = [hidden_in(row.changes, shared or {}) for row in rows]
    methods = {
        METHOD: [
            with_changes(base_of(row.method), one, row.substitution) for row, one in zip(rows, changes, strict=True)
        ]
    }
    return {**{CONDITION if key == ARM else key: texts for key, texts in of_data.items()}, **methods, **of_method}


def read_study(file: Path) -> Study:
    """Read the file of a study, or an ablation that a plugin ships, by name. Raises ConfigError, UnknownName."""
    shipped = None if file.exists() else registry().find_preset("ablations", str(file))
    if shipped is None and not file.exists() and file.suffix not in SUFFIXES:
        names = list(registry().list_presets("ablations"))
        raise UnknownName(f"{unknown('ablation', str(file), names)} A path of a YAML file is accepted too.")
    return validate(Study, read_yaml(shipped or file), f"{file}:")


def ablate(file: str | Path, request: Request, *, progress: Progress | None = None) -> StudyResult:
    """Measure every combination of the values under `vary:` in a file, one row each.

    Args:
        file: A YAML file, or the name of a shipped ablation.
        request: A request without methods. Its data and settings override those of the file.
        progress: Reports the progress.

    Raises:
        ConfigError: A key is wrong.
    """
    file = Path(file)
    study = read_study(file)
    try:
        return run_study(study, replace(request, name=request.name or file.stem), progress=progress)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None


@dataclass(frozen=True, eq=False)
class PooledRuns:
    """Runs whose rows are pooled into one table row per method.

    Attributes:
        runs: Task, request and configurations of each run.
        settings: The settings of the dataset that the study varies, with their values in these runs.
    """

    runs: Sequence[tuple[AnyTask, Request, Resolved]]
    settings: Mapping[str, Any]


def plan(study: Study, request: Request) -> list[PooledRuns]:
    """Return the runs of a study. Raises ConfigError on unknown keys."""
    of_data = study.varied(of_data=True)
    arm_items = list(study.arms.items()) or [("", {})]
    names = study.data if isinstance(study.data, tuple) and not request.data else (request.data or study.data,)
    variants, _ = study.variants()
    arms = []
    varied = (study.vary[key] for key in of_data)
    options = study.kind.vary(study.options)
    for name, (arm, arm_settings), (varied_options, option), *values in itertools.product(
        names, arm_items, options, *varied
    ):
        chosen = dict(zip(of_data, values, strict=True))
        runs = []
        for seed in [{SEED: seed} for seed in study.seeds] or [{}]:
            fixed_settings = {**study.set, **arm_settings, **chosen, **seed}
            fixed = [f"{key}={json.dumps(value)}" for key, value in fixed_settings.items()]
            run_request = replace(request, methods=variants, data=name, settings=(*fixed, *request.settings))
            task, resolved = study.kind.plan(run_request, option)
            runs.append((task, run_request, resolved))
        varied_settings = {**({DATA: name} if len(names) > 1 else {}), **({ARM: arm} if study.arms else {})}
        varied_settings |= {**varied_options, **chosen}
        arms.append(PooledRuns(runs, varied_settings))
    return arms


def run_study(study: Study, request: Request, *, progress: Progress | None = None) -> StudyResult:
    """Run a study. Finished runs are not repeated.

    Raises ConfigError on unknown keys, and SalframeError as `run_task`.
    """
    arms = plan(study, request)
    variants, varied = study.variants()
    of_method = {variant.label: choice for variant, choice in zip(variants, varied, strict=True)}
    count = sum(len(arm.runs) for arm in arms)
    results: list[Result[Any]] = []
    rows: list[MethodRow] = []
    settings: list[Mapping[str, Any]] = []
    for arm in arms:
        first = len(results)
        for task, run_request, resolved in arm.runs:
            if progress and count > 1:
                progress("runs", len(results), count)
            results.append(run_task(task, run_request, resolved, progress=progress))
        arm_results = results[first:]
        arm_rows = (
            arm_results[0].rows
            if len(arm_results) == 1
            else pool(arm.runs[0][0], [result.run for result in arm_results])
        )
        rows += arm_rows
        requested_labels = arm.runs[0][2].requested_as
        settings += [
            {**arm.settings, **row.settings, **of_method.get(requested_labels.get(row.method, ""), {})}
            for row in arm_rows
        ]
    notes = dict.fromkeys(note for result in results for note in result.notes)
    report = results[0].report if count == 1 else None
    runs = tuple(result.run for result in results)
    return StudyResult(study.kind, runs, tuple(rows), tuple(settings), tuple(notes), report=report)
