"""Figures that papers report, as data with their source: shown beside a comparison, never among its rows."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, model_validator

from salframe.config import read_yaml, validate
from salframe.presets import CONFIGS


class ReportedTable(BaseModel):
    """One table of a paper, as printed: `rows` holds a number for each of `figures`, by method."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    title: str
    figures: tuple[str, ...] = Field(min_length=1)
    rows: dict[str, tuple[float, ...]]

    @model_validator(mode="after")
    def _check(self) -> ReportedTable:
        for method, numbers in self.rows.items():
            if len(numbers) != len(self.figures):
                raise ValueError(f"{self.title}, {method}: received {len(numbers)} numbers, expected {len(self.figures)}")
        return self


class Reported(BaseModel):
    """The tables of one paper: `source` names it, `note` says on what the figures were obtained."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    source: str
    note: str
    tables: tuple[ReportedTable, ...]


def read_reported() -> tuple[Reported, ...]:
    """What is shipped in configs/reported/, a paper a file, by file name. Raises ConfigError."""
    return tuple(validate(Reported, read_yaml(path), f"{path.name}:") for path in sorted((CONFIGS / "reported").glob("*.yaml")))
