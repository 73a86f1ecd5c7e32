"""Run folders: what was asked, what each method answered, and where. Finished work is never asked again."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

import yaml

from salframe.evaluation.runs.request import Resolved
from salframe.evaluation.runs.rows import PieceRow, read_rows
from salframe.framework.component import ComponentConfig
from salframe.framework.components.auto import Choice
from salframe.framework.components.identity import identity
from salframe.framework.components.installation import environment
from salframe.framework.components.registry import registry
from salframe.framework.config import read_yaml
from salframe.framework.errors import ConfigError, DataError, describe_error, shorten
from salframe.framework.files.bounded import parse_yaml
from salframe.framework.files.hashes import digest
from salframe.framework.files.reading import read_as, read_model
from salframe.framework.files.writing import write_json, write_text
from salframe.framework.validation import Settings, validate

REQUEST, NOTES, METHODS = "request.yaml", "notes.json", "methods"
"""In a run folder: what was asked, what must be said of it, and a folder for each method."""
ROWS, DESCRIPTIONS, MAPS = "rows.jsonl", "descriptions.jsonl", "maps.jsonl"
OUTCOME, IDENTITY, CRASH_LOG = "outcome.json", "identity.json", "crash.log"
"""In a method's folder."""
LONGEST = 200
"""Characters of a folder's name: file systems take 255 bytes."""


class MethodStatus(StrEnum):
    """How a method's work ended."""

    DONE = "done"
    UNAVAILABLE = "unavailable"
    CRASHED = "crashed"
    UNFINISHED = "unfinished"


Kind = TypeVar("Kind", bound=PieceRow)


@dataclass(frozen=True)
class Outcome:
    """How a method's work ended, and why, or with which warning; `given`: which parts of panoramas it was given;
    `seconds`: how long all of it took, None where it was resumed."""

    status: MethodStatus
    reason: str | None = None
    given: tuple[str, ...] = ()
    seconds: float | None = None


def identity_of(config: ComponentConfig) -> dict[str, Any]:
    """The identity of a configured method; of one that cannot tell it, its settings and why: its own row will tell."""
    try:
        return identity(config)
    except Exception as error:
        return {"unknown": describe_error(error), "settings": config.model_dump(mode="json")}


class _Identity(Settings):
    """identity.json: what answers depend on, and the folder of the run that they were taken from."""

    sha256: str | None = None
    source: str | None = None


class _Request(Settings):
    """request.yaml."""

    task: dict[str, Any]
    seed: int
    data: dict[str, Any]
    methods: dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Run:
    """A run folder. `content` is that of its request.yaml: task, seed, data, methods by label, settings with values."""

    directory: Path
    content: Mapping[str, Any] = field(repr=False)

    @classmethod
    def open(cls, runs: Path, name: str, task: Mapping[str, Any], resolved: Resolved, seed: int) -> Run:
        """Make or resume runs/<name>-<hash8>; the hash changes with whatever is part of an identity.

        `task`: its name and what it asks, as JSON. Raises ConfigError where the folder holds another request.
        """
        if not name or "/" in name or name in (".", "..") or not name.isprintable():
            raise ConfigError(f"received the run name {shorten(name)!r}, expected printable text without slashes")
        if (size := len(name.encode())) > LONGEST:
            raise ConfigError(f"received a run name of {size} bytes, expected at most {LONGEST}")
        key = _known_as(task, seed, resolved.data, resolved.methods)
        settings = {label: config.model_dump(mode="json") for label, config in resolved.methods.items()}
        asked = {"task": dict(task), "seed": seed, "data": resolved.data.model_dump(mode="json"), "methods": settings}
        text = yaml.safe_dump(asked, sort_keys=False)
        directory, content = runs / f"{name}-{key[:8]}", parse_yaml(text)
        path = directory / REQUEST
        if not path.exists():
            write_text(path, text)
        elif read_yaml(path) != content:  # the same files may have other names today
            run = cls.load(directory)
            roles = {label: config.component.role for label, config in resolved.methods.items()}
            methods = {label: run.method(label, roles[label]) for label in run.labels if label in roles}
            if run.labels != list(roles) or _known_as(run.task, run.seed, run.data(), methods) != key:
                raise ConfigError(f"{path} was edited since the run began: restore it, or remove {directory}")
            return run
        return cls(directory, content)

    @classmethod
    def load(cls, directory: Path) -> Run:
        """Open an existing run folder. Raises ConfigError where it is none."""
        path = directory / REQUEST
        if not path.exists():
            raise ConfigError(f"{directory} is no run folder: it has no {REQUEST}")
        content = read_yaml(path)
        validate(_Request, content, f"{path}:")
        return cls(directory, content)

    @property
    def seed(self) -> int:
        return self.content["seed"]

    @property
    def task(self) -> Mapping[str, Any]:
        """The task's name and what it asks."""
        return self.content["task"]

    @property
    def labels(self) -> list[str]:
        """The methods, in the order they were given."""
        return list(self.content["methods"])

    def data(self) -> ComponentConfig:
        """The data set's configuration. Raises ConfigError, UnknownName where this installation does not know it."""
        return self._component("dataset", self.content["data"], "data")

    def method(self, label: str, role: str, choice: Choice | None = None) -> ComponentConfig:
        """A method's configuration; `choice` decides slots that were left undecided, for nothing could run in them.

        Raises ConfigError, UnknownName where this installation does not know it, InputMissing where nothing can run in
        such a slot.
        """
        return self._component(role, self.content["methods"][label], label, choice)

    def _component(
        self, role: str, settings: Mapping[str, Any], where: str, choice: Choice | None = None
    ) -> ComponentConfig:
        model = registry().get(role, settings.get("kind", "")).Config
        return validate(model, settings, f"{self.directory / REQUEST}: {where}", choice)

    def folder(self, label: str) -> Path:
        """The folder of a method. Labels are escaped, so that no two share one and none lies elsewhere."""
        name = quote(label, safe="[]=,; ")
        if not name.strip("."):
            name = name.replace(".", "%2E")
        if len(name) > LONGEST:
            name = f"{name[: LONGEST - 17]}-{digest(label)[:16]}"
        return self.directory / METHODS / name

    def rows(self, label: str, kind: type[Kind]) -> list[Kind]:
        """Return the rows that a method has so far. Raises DataError on a row that is none of `kind`."""
        return list(read_rows(self.folder(label) / ROWS, kind))

    def outcome(self, label: str) -> Outcome | None:
        """How the method's work ended, None where it has not."""
        path = self.folder(label) / OUTCOME
        if not path.exists():
            return None
        outcome: Outcome = read_as(path, Outcome)
        return outcome

    def begin(self, label: str) -> Path:
        """Make the method's folder ready for work, which has not ended; returns it."""
        folder = self.folder(label)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / OUTCOME).unlink(missing_ok=True)
        return folder

    def end(self, label: str, outcome: Outcome) -> None:
        """Keep how the method's work ended."""
        write_json(self.folder(label) / OUTCOME, {**asdict(outcome), "given": list(outcome.given)})

    def bind(self, fingerprint: str) -> None:
        """Tie the run to the data's content and write env.json. Raises DataError where that is not what it began on."""
        path = self.directory / "env.json"
        if not path.exists():
            write_json(path, {"dataset_fingerprint": fingerprint, **environment()})
        elif self.environment().get("dataset_fingerprint") != fingerprint:
            raise DataError(
                f"the dataset of {self.directory} has changed since the run began: "
                "give the run another --name, or remove it"
            )

    def environment(self) -> Mapping[str, Any]:
        """What `bind` wrote: the data's fingerprint, versions, machine."""
        content: dict[str, Any] = read_as(self.directory / "env.json", dict[str, Any])
        return content

    def notes(self) -> list[str]:
        """What must be said beside the table: which method ran instead of another, whose answers were reused."""
        path = self.directory / NOTES
        reused = filter(None, map(self._reused, self.labels))
        return [*(read_as(path, list[str]) if path.exists() else []), *reused]

    def _reused(self, label: str) -> str | None:
        """What must be said of where a method's answers are from."""
        path = self.folder(label) / IDENTITY
        try:
            source = read_model(path, _Identity).source if path.exists() else None
        except DataError as error:
            return f"{label}: whether its answers are of another run is not known: {error}"
        return f"{label}: answers of {source}, with their times, are reused" if source else None

    def set_notes(self, notes: Sequence[str]) -> None:
        """Keep what must be said of the request that the run serves now."""
        write_json(self.directory / NOTES, list(notes))

    def reuse(self, label: str, known_by: str) -> None:
        """Take over what the same method answered to the same pieces of the same data in another run, if any did.

        `known_by`: the hash of all that answers depend on. A method that has begun in this run is left alone.
        """
        folder = self.folder(label)
        if (folder / IDENTITY).exists():
            return
        others = [path.parent for path in sorted(self.directory.parent.glob(f"*/{METHODS}/*/{IDENTITY}"))]
        alike = [other for other in others if (other / ROWS).exists() and _identity(other).sha256 == known_by]
        best = max(alike, key=lambda other: (other / ROWS).stat().st_size, default=None)
        folder.mkdir(parents=True, exist_ok=True)
        # Rows first: a run in progress has described whatever its rows speak of.
        for name in (ROWS, DESCRIPTIONS, MAPS, OUTCOME):
            if best is not None and (best / name).exists():
                shutil.copyfile(best / name, folder / name)
        source = None if best is None else str(best.parent.parent)
        write_json(folder / IDENTITY, {"sha256": known_by, "source": source})


def _known_as(task: Mapping[str, Any], seed: int, data: ComponentConfig, methods: Mapping[str, ComponentConfig]) -> str:
    """The hash of all that a run depends on."""
    known_by = {label: identity_of(config) for label, config in methods.items()}
    return digest({"task": dict(task), "seed": seed, "data": identity(data), "methods": known_by})


def _identity(folder: Path) -> _Identity:
    """What a method's folder is known by; nothing where that cannot be read."""
    try:
        return read_model(folder / IDENTITY, _Identity)
    except DataError:
        return _Identity()
