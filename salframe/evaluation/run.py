"""TODO."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any
from urllib.parse import quote

import yaml

from salframe.framework.config import ComponentConfig, read_yaml, validate
from salframe.framework.errors import ConfigError, DataError
from salframe.framework.files import read_json, write_json, write_text
from salframe.framework.identity import digest, identity
from salframe.framework.installation import environment
from salframe.framework.registry import registry

Row = dict[str, Any]


@dataclass(frozen=True)
class Outcome:
    """How a method's prediction ended: "done", "unavailable" or "crashed", and why, or with which warning."""

    status: str
    reason: str | None = None


@dataclass(frozen=True)
class Run:
    """A run folder. `content` is that of its config.yaml: seed, dataset, and methods by label, every setting with its
    value."""

    directory: Path
    content: Mapping[str, Any] = field(repr=False)

    @classmethod
    def open(
        cls,
        runs: Path,
        name: str,
        dataset: ComponentConfig,
        methods: Mapping[str, ComponentConfig],
        seed: int,
        task: Mapping[str, Any] = {},
    ) -> Run:
        """Make or resume runs/<name>-<hash8>; the hash changes with any setting and with any component's version.

        `seed` is that of the confidence intervals; `task`, what all methods are asked beyond the dataset's queries, is
        kept under its own keys. Raises ConfigError where the folder holds another configuration.
        """
        if not name or "/" in name:
            raise ConfigError(f"received the run name {name!r}, expected one without slashes")
        known_by = {label: identity(config) for label, config in methods.items()}
        directory = (
            runs / f"{name}-{digest({'seed': seed, 'dataset': identity(dataset), 'methods': known_by, **task})[:8]}"
        )
        settings = {label: config.model_dump(mode="json") for label, config in methods.items()}
        text = yaml.safe_dump(
            {"seed": seed, "dataset": dataset.model_dump(mode="json"), "methods": settings, **task}, sort_keys=False
        )
        path, content = directory / "config.yaml", yaml.safe_load(text)
        if not path.exists():
            write_text(path, text)
        elif read_yaml(path) != content:
            raise ConfigError(
                f"{path} was edited since the run began: restore it, or remove {directory} to start afresh"
            )
        return cls(directory, content)

    @classmethod
    def load(cls, directory: Path) -> Run:
        """Open an existing run folder. Raises ConfigError where it is none."""
        path = directory / "config.yaml"
        if not path.exists():
            raise ConfigError(f"{directory} is no run folder: it has no config.yaml")
        content = read_yaml(path)
        absent = [key for key in ("seed", "dataset", "methods") if key not in content]
        if absent:
            raise ConfigError(f"{path} has no key {', '.join(absent)}")
        return cls(directory, content)

    @property
    def seed(self) -> int:
        return self.content["seed"]

    @property
    def labels(self) -> list[str]:
        """The methods, in the order they were given."""
        return list(self.content["methods"])

    def dataset(self) -> ComponentConfig:
        """The dataset's configuration. Raises ConfigError, UnknownName where this installation does not know it."""
        return self._component("dataset", self.content["dataset"], "dataset")

    def method(self, label: str) -> ComponentConfig:
        """A method's configuration. Raises ConfigError, UnknownName where this installation does not know it."""
        return self._component("localizer", self.content["methods"][label], label)

    def _component(self, role: str, settings: Mapping[str, Any], where: str) -> ComponentConfig:
        return validate(
            registry().get(role, settings.get("kind", "")).Config,
            settings,
            f"{self.directory / 'config.yaml'}: {where}",
        )

    def folder(self, label: str) -> Path:
        """The folder of a method. Labels are escaped, so that no two share one."""
        return self.directory / quote(label, safe="[]=,; ")

    def predictions(self, label: str) -> dict[tuple[str, str], Row]:
        """Answers by (fold, query); of a query asked again, the last."""
        return {(row["fold"], row["query"]): row for row in read_rows(self.folder(label) / "predictions.jsonl")}

    def descriptions(self, label: str) -> dict[str, Row]:
        """The cost of each described frame by its id: ms and bytes."""
        return {row["frame"]: row for row in read_rows(self.folder(label) / "descriptions.jsonl")}

    def count_rows(self, label: str) -> int:
        """How many frames the method has described and queries it has answered so far."""
        paths = (self.folder(label) / name for name in ("descriptions.jsonl", "predictions.jsonl"))
        return sum(path.read_bytes().count(b"\n") for path in paths if path.exists())

    def outcome(self, label: str) -> Outcome | None:
        """How the method's prediction ended, None where it has not."""
        path = self.folder(label) / "outcome.json"
        return Outcome(**read_json(path)) if path.exists() else None

    def end(self, label: str, outcome: Outcome) -> None:
        """Keep how the method's prediction ended."""
        write_json(self.folder(label) / "outcome.json", {"status": outcome.status, "reason": outcome.reason})

    def bind(self, fingerprint: str) -> None:
        """Tie the run to the dataset's content and write env.json. Raises DataError where the content is not what the
        run began with."""
        path = self.directory / "env.json"
        if not path.exists():
            write_json(path, {"dataset_fingerprint": fingerprint, **environment()})
        elif read_json(path)["dataset_fingerprint"] != fingerprint:
            raise DataError(
                f"the dataset of {self.directory} has changed since the run began: give the run another --name, or remove it"
            )


def read_rows(path: Path) -> Iterator[Row]:
    """The rows of a .jsonl file; none where it is missing. What follows the last newline was cut off by a kill, and is
    left out."""
    if not path.exists():
        return
    for number, line in enumerate(path.read_bytes().split(b"\n")[:-1], 1):
        try:
            yield json.loads(line)
        except ValueError:
            raise DataError(
                f"{path}, line {number}, is not JSON: remove the line to have its query asked again"
            ) from None


class RowWriter:
    """Appends rows to a .jsonl file, each flushed at once; drops an unfinished last line first."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            os.truncate(path, path.read_bytes().rfind(b"\n") + 1)
        self._file = path.open("a")

    def append(self, row: Row) -> None:
        """Append one row. Raises ValueError on NaN, which JSON has not."""
        self._file.write(json.dumps(row, allow_nan=False) + "\n")
        self._file.flush()

    def __enter__(self) -> RowWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._file.close()
