"""Run folders: the request and the answers of each method. Finished work is never repeated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import date
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal, TypeVar
from urllib.parse import quote

import yaml
from pydantic import BaseModel, ConfigDict, Field

from salframe.evaluation.runs.request import Resolved
from salframe.evaluation.runs.rows import PieceRow, read_rows
from salframe.framework.component import ComponentConfig
from salframe.framework.components.auto import Choice
from salframe.framework.components.identity import identity
from salframe.framework.components.installation import environment
from salframe.framework.components.registry import registry
from salframe.framework.config import read_yaml
from salframe.framework.errors import ConfigError, DataError, describe_error, format_advice, shorten
from salframe.framework.files.bounded import parse_yaml
from salframe.framework.files.hashes import digest
from salframe.framework.files.reading import copy_log, read_as, read_model
from salframe.framework.files.writing import write_json, write_text
from salframe.framework.validation import Seed, Settings, validate

REQUEST, NOTES, METHODS = "request.yaml", "notes.json", "methods"
"""Names in a run folder: the request, its notes, and the folder that contains a folder for each method."""
SUBSTITUTIONS = "substitutions"
"""Key of request.yaml: the methods that replace a requested one."""
RUN_FORMAT: Literal[2] = 2
"""Version of the layout of run folders. It changes when a key of their files is renamed."""
ROWS, DESCRIPTIONS, MAPS = "rows.jsonl", "descriptions.jsonl", "maps.jsonl"
OUTCOME, IDENTITY, CRASH_LOG = "outcome.json", "identity.json", "crash.log"
"""Names of files in a method's folder."""
MAX_NAME_BYTES = 200
"""Maximum length of the name of a folder in bytes. File systems allow 255 bytes."""


class MethodStatus(StrEnum):
    """The outcome of a method's work.

    DONE: it has finished, but some pieces may have failed. UNAVAILABLE: the method lacks a package, weights or an
    input. CRASHED: the method raised an exception, or its process died. UNFINISHED: some pieces have no row.
    """

    DONE = "done"
    UNAVAILABLE = "unavailable"
    CRASHED = "crashed"
    UNFINISHED = "unfinished"


Kind = TypeVar("Kind", bound=PieceRow)


@dataclass(frozen=True)
class Outcome:
    """The end of a method's work in a run.

    Attributes:
        status: How the work ended.
        reason: Why it ended so, or a warning.
        input: Parts of panoramas that the method received as input.
        seconds: Duration of the work; None if it was resumed.
    """

    status: MethodStatus
    reason: str | None = None
    input: tuple[str, ...] = ()
    seconds: float | None = None


def identity_of(config: ComponentConfig) -> dict[str, Any]:
    """Return the identity of a configured method: its settings, versions and file hashes, on which its answers depend.
    If it cannot be computed, return the error and the settings."""
    try:
        return identity(config)
    except Exception as error:
        return {"unknown": describe_error(error), "settings": config.model_dump(mode="json")}


class _Identity(Settings):
    """Content of identity.json: the hash of everything that answers depend on, and the run that the answers were copied
    from (None: this run)."""

    sha256: str | None = None
    source: str | None = None


class _Environment(BaseModel):
    """Content of env.json. Runs of older versions may lack some keys."""

    model_config = ConfigDict(frozen=True, extra="allow")
    date: str = ""
    dataset_fingerprint: str
    python: str = "?"
    packages: dict[str, str] = Field(default_factory=dict)
    plugins: list[dict[str, Any]] = Field(default_factory=list)
    machine: dict[str, Any] = Field(default_factory=dict)


class _SavedRequest(Settings):
    """Content of request.yaml."""

    format: Literal[2]
    task: dict[str, Any]
    seed: Seed
    data: dict[str, Any]
    methods: dict[str, dict[str, Any]]
    changes: dict[str, list[str]] = Field({})
    substitutions: dict[str, str] = Field({})


@dataclass(frozen=True)
class Run:
    """A run folder.

    `content` is the content of request.yaml: task, seed, data, and dictionaries from the label of a method to its
    settings, its changes, and the requested method that it replaces.
    """

    directory: Path
    content: Mapping[str, Any] = field(repr=False)

    @classmethod
    def open(cls, runs: Path, name: str, task: Mapping[str, Any], resolved: Resolved, seed: int) -> Run:
        """Create or resume the run folder runs/<name>-<hash8>. The hash depends on the identities of all components.

        Args:
            runs: The folder of run folders.
            name: Name of the run, without slashes.
            task: Name and parameters of the task, as JSON.
            resolved: The configurations.
            seed: The seed of the request.

        Raises:
            ConfigError: The name is invalid, or the folder holds another request.
        """
        if not name or "/" in name or name in (".", "..") or not name.isprintable():
            raise ConfigError(
                f"received the run name {shorten(name)!r}, expected printable text without "
                "slashes: choose another --name"
            )
        if (size := len(name.encode())) > MAX_NAME_BYTES:
            raise ConfigError(
                f"received a run name of {size} bytes, expected at most {MAX_NAME_BYTES}: choose a shorter --name"
            )
        key = _fingerprint(task, seed, resolved.data, resolved.methods)
        settings = {label: config.model_dump(mode="json") for label, config in resolved.methods.items()}
        request = {
            "format": RUN_FORMAT,
            "task": dict(task),
            "seed": seed,
            "data": resolved.data.model_dump(mode="json"),
            "methods": settings,
        }
        if resolved.changes:
            request["changes"] = {label: list(changes) for label, changes in resolved.changes.items()}
        if resolved.substitutions:
            request[SUBSTITUTIONS] = dict(resolved.substitutions)
        text = yaml.safe_dump(request, sort_keys=False)
        directory, content = runs / f"{name}-{key[:8]}", parse_yaml(text)
        path = directory / REQUEST
        if not path.exists():
            write_text(path, text)
        elif read_yaml(path) != content:  # the same files may have been renamed
            run = cls.load(directory)
            roles = {label: config.component.role for label, config in resolved.methods.items()}
            methods = {label: run.method(label, roles[label]) for label in run.labels if label in roles}
            if run.labels != list(roles) or _fingerprint(run.task, run.seed, run.data(), methods) != key:
                raise ConfigError(
                    f"the file {path} was edited after the run began: restore the file, or remove the run folder "
                    f"{directory}"
                )
            if {**run.content, SUBSTITUTIONS: None} != {**content, SUBSTITUTIONS: None}:
                return run
            write_text(path, text)  # the same methods, now requested directly or as a replacement
        return cls(directory, content)

    @classmethod
    def load(cls, directory: Path) -> Run:
        """Open an existing run folder. Raises ConfigError if `directory` is not a run folder."""
        path = directory / REQUEST
        if not path.exists():
            raise ConfigError(f"{directory} is not a run folder: it has no {REQUEST}")
        content = read_yaml(path)
        if isinstance(content, Mapping) and content.get("format") != RUN_FORMAT:
            version = content.get("format", 1)
            advice = format_advice(version, RUN_FORMAT, "repeat the run with this version and another --name")
            raise ConfigError(
                f"the run folder {directory} has the format {version} of another version of salframe, expected "
                f"{RUN_FORMAT}: {advice}"
            )
        validate(_SavedRequest, content, f"{path}:")
        return cls(directory, content)

    @property
    def seed(self) -> int:
        return self.content["seed"]

    @property
    def task(self) -> Mapping[str, Any]:
        """Name and parameters of the task."""
        return self.content["task"]

    @property
    def labels(self) -> list[str]:
        """Labels of the methods, in the order of the request."""
        return list(self.content["methods"])

    def changes(self, label: str) -> tuple[str, ...]:
        """Return the settings of a method that differ from its preset, "key=value" each."""
        return tuple(self.content.get("changes", {}).get(label, ()))

    def substitution(self, label: str) -> str | None:
        """Return the method that a method replaces, such as "for loftr"; None if it replaces no other method."""
        text: str | None = self.content.get(SUBSTITUTIONS, {}).get(label)
        return text

    def data(self) -> ComponentConfig:
        """Return the configuration of the data set. Raises ConfigError, and UnknownName if it is not installed."""
        return self._component("dataset", self.content["data"], "data")

    def method(self, label: str, role: str, choice: Choice | None = None) -> ComponentConfig:
        """Return the configuration of a method.

        Args:
            label: Label of the method.
            role: Role of the method.
            choice: Selects the component of each setting that still has the value `auto`.

        Raises:
            ConfigError: The request is invalid.
            UnknownName: The component is not installed.
            InputMissing: No component can be selected for such a setting.
        """
        return self._component(role, self.content["methods"][label], label, choice)

    def _component(
        self, role: str, settings: Mapping[str, Any], where: str, choice: Choice | None = None
    ) -> ComponentConfig:
        model = registry().get(role, settings.get("kind", "")).Config
        return validate(model, settings, f"{self.directory / REQUEST}: {where}", choice)

    def folder(self, label: str) -> Path:
        """Return the folder of a method. Labels are escaped, so that each has a separate folder inside the run."""
        name = quote(label, safe="[]=,; ")
        if not name.strip("."):
            name = name.replace(".", "%2E")
        if len(name) > MAX_NAME_BYTES:
            name = f"{name[: MAX_NAME_BYTES - 17]}-{digest(label)[:16]}"
        return self.directory / METHODS / name

    def rows(self, label: str, kind: type[Kind]) -> list[Kind]:
        """Return the results that the run stored for a method so far, one row of type `kind` per query.

        Args:
            label: The name of the method in the run.
            kind: The model of a row.

        Raises:
            DataError: A stored row is not a valid `kind`.
        """
        return list(read_rows(self.folder(label) / ROWS, kind))

    def outcome(self, label: str) -> Outcome | None:
        """Return the outcome of a method; None if its work has not ended."""
        path = self.folder(label) / OUTCOME
        if not path.exists():
            return None
        outcome: Outcome = read_as(path, Outcome)
        return outcome

    def begin(self, label: str) -> Path:
        """Create the folder of a method, remove an old outcome, and return the folder."""
        folder = self.folder(label)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / OUTCOME).unlink(missing_ok=True)
        return folder

    def end(self, label: str, outcome: Outcome) -> None:
        """Write the outcome of a method to its folder."""
        write_json(self.folder(label) / OUTCOME, {**asdict(outcome), "input": list(outcome.input)})

    def bind(self, fingerprint: str) -> None:
        """Bind the run to the fingerprint of its data, and write env.json. Raises DataError if the data changed."""
        path = self.directory / "env.json"
        if not path.exists():
            write_json(path, {"date": date.today().isoformat(), "dataset_fingerprint": fingerprint, **environment()})
        elif self.environment().get("dataset_fingerprint") != fingerprint:
            raise DataError(
                f"the dataset of the run {self.directory} has changed since the run began: choose another --name, "
                "or remove this run folder"
            )

    def environment(self) -> Mapping[str, Any]:
        """Return the content that `bind` wrote: the date, the fingerprint of the data, versions and the machine.

        Raises DataError if env.json is not as `bind` writes it.
        """
        return read_model(self.directory / "env.json", _Environment).model_dump()

    def notes(self) -> list[str]:
        """Return the notes beside the table: methods that replace others, and answers that were reused."""
        path = self.directory / NOTES
        reused = filter(None, map(self._reused, self.labels))
        return [*(read_as(path, list[str]) if path.exists() else []), *reused]

    def _reused(self, label: str) -> str | None:
        """Return a note on the run that a method's answers were copied from; None if they are from this run."""
        path = self.folder(label) / IDENTITY
        try:
            source = read_model(path, _Identity).source if path.exists() else None
        except DataError as error:
            return f"method {label}: cannot read whether the answers were copied from another run: {error}"
        return f"method {label}: the answers and times of the earlier run {source} are reused" if source else None

    def set_notes(self, notes: Sequence[str]) -> None:
        """Write the notes on the current request, which replace earlier notes."""
        write_json(self.directory / NOTES, list(notes))

    def reuse(self, label: str, fingerprint: str) -> None:
        """Copy the answers of a method from another run with the same method, data and queries, if there is one.

        Args:
            label: Label of the method. A method that has begun in this run keeps its answers.
            fingerprint: Hash of all that answers depend on.

        Raises:
            DataError: A file of the other run is not a regular file.
        """
        folder = self.folder(label)
        if (folder / IDENTITY).exists():
            return
        others = [path.parent for path in sorted(self.directory.parent.glob(f"*/{METHODS}/*/{IDENTITY}"))]
        alike = [
            other
            for other in others
            if (other / ROWS).exists()
            and _identity(other).sha256 == fingerprint
            and _has_present_format(other.parent.parent)
        ]
        best = max(alike, key=lambda other: (other / ROWS).stat().st_size, default=None)
        folder.mkdir(parents=True, exist_ok=True)
        # Rows first: a run in progress has already described the frames of its rows.
        for name in (ROWS, DESCRIPTIONS, MAPS, OUTCOME):
            if best is not None and (best / name).exists():
                copy_log(best / name, folder / name)
        source = None if best is None else str(best.parent.parent)
        write_json(folder / IDENTITY, {"sha256": fingerprint, "source": source})


def name_of(directory: Path) -> str:
    """Return the name of a run from its folder: the name of the folder without the hash at its end."""
    return directory.name.rpartition("-")[0]


def _fingerprint(
    task: Mapping[str, Any], seed: int, data: ComponentConfig, methods: Mapping[str, ComponentConfig]
) -> str:
    """Return the hash of all that a run depends on."""
    identities = {label: identity_of(config) for label, config in methods.items()}
    return digest({"task": dict(task), "seed": seed, "data": identity(data), "methods": identities})


def _has_present_format(directory: Path) -> bool:
    """Return whether a run folder has the format of this version."""
    try:
        return read_yaml(directory / REQUEST).get("format") == RUN_FORMAT
    except ConfigError:
        return False


def _identity(folder: Path) -> _Identity:
    """Return the identity in a method's folder. If it cannot be read, return an empty identity."""
    try:
        return read_model(folder / IDENTITY, _Identity)
    except DataError:
        return _Identity()
