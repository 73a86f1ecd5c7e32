"""Results that papers report, with their source. They are shown beside a comparison, never among its rows."""

from __future__ import annotations

from pydantic import Field, model_validator

from salframe.evaluation.tables.table import Table
from salframe.framework.components.registry import registry
from salframe.framework.config import read_yaml
from salframe.framework.validation import Settings, validate


class ReportedTable(Settings):
    """One table of a paper, with shares as percent.

    Attributes:
        title: Title of the table.
        figures: Headings of the columns.
        rows: Mapping from each method to its numbers, one for each column.
    """

    title: str
    figures: tuple[str, ...] = Field(min_length=1)
    rows: dict[str, tuple[float, ...]]

    @model_validator(mode="after")
    def _check(self) -> ReportedTable:
        for method, numbers in self.rows.items():
            if len(numbers) != len(self.figures):
                raise ValueError(
                    f"table {self.title!r}, row {method!r}: received {len(numbers)} numbers, expected "
                    f"{len(self.figures)}, one for each of `figures`"
                )
        return self


class Reported(Settings):
    """The tables of one paper.

    Attributes:
        source: Authors and title of the paper.
        note: What the paper measured, and whether its numbers can be compared with measured results.
        tables: The tables of the paper, with shares as percent.
    """

    source: str
    note: str
    tables: tuple[ReportedTable, ...]


def read_reported() -> tuple[Reported, ...]:
    """Return the results that papers report, one entry per paper, ordered by file name.

    The files are in the subfolders `reported/` of the folders of presets.

    Raises:
        ConfigError: A file is not valid.
    """
    presets = registry()
    paths = [presets.find_preset("reported", name) for name in presets.list_presets("reported")]
    return tuple(validate(Reported, read_yaml(path), f"{path.name}:") for path in paths if path is not None)


def reported_table(part: ReportedTable) -> Table:
    """Return a table published in a paper, for comparison with measured results."""
    rows = [[method, *(f"{number:g}" for number in numbers)] for method, numbers in part.rows.items()]
    return Table(("reported, not measured", *part.figures), rows, title=part.title)
