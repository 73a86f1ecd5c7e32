"""Tables of results: in the terminal, and as Markdown, LaTeX or CSV text."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich import table as rich_table
from rich.console import Console
from rich.markup import escape

if TYPE_CHECKING:
    from salframe.evaluation.runs.task import Result
    from salframe.evaluation.studies.experiment import ExperimentResult
    from salframe.evaluation.studies.study import StudyResult
    from salframe.evaluation.tables.reported import Reported, ReportedTable
    from salframe.evaluation.tables.table import Table
    from salframe.evaluation.tasks.sensor.measurement import SensorMeasurement


LATEX_COLUMNS = 6
"""Maximum number of columns of a LaTeX table without --columns. As many fit the width of a page."""
INPUT_WIDTH = 22
"""Maximum width of the column with the inputs of a method, in characters. Longer text wraps."""


def _console() -> Console:
    """Return a console on stdout, 100 columns wide if stdout is a file or a pipe."""
    console = Console()
    return console if console.is_terminal else Console(width=100)


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a plain table. The first column does not wrap."""
    table = rich_table.Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        table.add_column(heading, overflow="fold", no_wrap=heading is headings[0])
    for row in rows:
        table.add_row(*map(escape, row))
    _console().print(table)


def print_result(
    result: Result[Any] | StudyResult, columns: Sequence[str] = (), details: bool = False, printed: Collection[str] = ()
) -> None:
    """Print the tables and notes of a result, and the folder in which it is stored.

    Args:
        result: The result.
        columns: Names of the columns of the tables; empty: the main columns.
        details: Whether to print the detailed tables too.
        printed: Notes that were printed before, which are left out.
    """
    for table in result.tables(columns):
        print_measured(table)
    for table in result.kind.details(result.rows) if details else ():
        print_table(table.headings, table.rows)
    _print_notes(result, printed)
    for line in result.kind.legend(result.rows):
        _say(line, dim=False)
    print_reported(result.reported)
    _say(result.where, dim=False)


def print_experiment(result: ExperimentResult, columns: Sequence[str] = (), printed: Collection[str] = ()) -> None:
    """Print the tables of an experiment, the corresponding tables of papers, and the path of the results file.
    For the arguments, see `print_result`. Without columns, the experiment states them."""
    _say(f"{result.experiment.title}: {result.experiment.question}", dim=False)
    for table in result.tables:
        for part in table.tables(columns):
            print_measured(part)
        if table.stored is not None:
            _say(f"{table.name}: measured on {table.stored.date}, {table.stored.machine}")
        if table.skipped is not None:
            _say(f"{table.name}: skipped: {table.skipped}")
        for note in () if table.fresh is None else table.fresh.notes:
            if note not in printed:
                _say(note)
    for source, reported in result.reported:
        _console().print(_reported([reported]))
        _say(f"{source}. {result.experiment.differs}")
    _say(f"stored in {result.file}", dim=False)


def print_measured(table: Table) -> None:
    """Print a table of measured rows.

    A table that is too wide for the terminal is split into several tables. The columns with the cost of the methods are
    the first to be moved to a separate table.
    """
    from salframe.evaluation.tables.table import split_table

    console = _console()

    def fits(part: Table) -> bool:
        return console.measure(_rich(part), options=console.options.update(width=1000)).maximum <= console.width

    for part in split_table(table, fits):
        console.print(_rich(part))


def _rich(table: Table) -> rich_table.Table:
    from salframe.evaluation.tables.columns import INPUT

    title = None if table.title is None else escape(table.title)
    rich = rich_table.Table(
        box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), title=title, title_justify="left"
    )
    for column, heading in enumerate(table.headings):
        if column < table.leading:
            rich.add_column(escape(heading), overflow="fold")
        elif heading == INPUT.heading:
            rich.add_column(escape(heading), max_width=INPUT_WIDTH)
        else:
            rich.add_column(escape(heading), justify="right", no_wrap=True)
    for i, row in enumerate(table.rows):
        leading = [text.replace("[", "\n  [").replace(",", ",\n   ") for text in row[: table.leading]]
        cells = enumerate(map(escape, [*leading, *row[table.leading :]]))
        rich.add_row(*(f"[bold]{text}[/bold]" if (i, j) in table.best else text for j, text in cells))
    return rich


def format_result(result: Result[Any] | StudyResult, style: str, columns: Sequence[str] = ()) -> str:
    """Return the tables of a result as text in the style "md", "latex" or "csv".

    "latex" has at most LATEX_COLUMNS columns unless `columns` names them. "csv" has all columns, and numbers with more
    digits.
    """
    from salframe.evaluation.tables.formats import to_csv, to_markdown

    if style == "csv":
        return to_csv([row.to_json() for row in result.rows], getattr(result, "settings", ()))
    measured = result.tables(columns)
    reported = _reported_by_title([part for paper in result.reported for part in paper.tables])
    if style == "md":
        return "\n".join(map(to_markdown, [*measured, *(table for _, table in reported)]))
    titles = [", ".join(filter(None, (result.caption, table.title))) for table in measured]
    return _to_latex([*zip(titles, measured, strict=True), *reported], () if columns else measured, result.task)


def format_experiment(result: ExperimentResult, style: str, columns: Sequence[str] = ()) -> str:
    """Return the tables of an experiment as text in the style "md", "latex" or "csv".

    In "md" and "latex", each table has its title, and tables of papers come last. "latex" has at most LATEX_COLUMNS
    columns unless `columns` names them. "csv" has only the measured tables, and numbers with more digits.
    """
    from salframe.evaluation.tables.formats import to_csv, to_markdown

    if style == "csv":
        tables = ((table.name, table.stored) for table in result.tables if table.stored)
        return "\n".join(
            to_csv(stored.rows, [{"table": name, **settings} for settings in stored.settings])
            for name, stored in tables
        )
    measured = [part for table in result.tables for part in table.tables(columns)]
    tables_by_title = [(str(part.title), part) for part in measured]
    tables_by_title += _reported_by_title([part for _, part in result.reported])
    if style == "md":
        return "\n".join(f"**{title}**\n\n{to_markdown(table)}" for title, table in tables_by_title)
    return _to_latex(tables_by_title, () if columns else measured, result.name)


def _reported_by_title(parts: Sequence[ReportedTable]) -> list[tuple[str, Table]]:
    """Return the tables of papers with their titles."""
    from salframe.evaluation.tables.reported import reported_table

    return [(f"reported, not measured: {part.title}", reported_table(part)) for part in parts]


def _to_latex(tables_by_title: Sequence[tuple[str, Table]], wide: Sequence[Table], name: str) -> str:
    """Return tables as LaTeX floats with captions and labels.

    A label is derived from the caption, and starts with `name`. Repeated labels are numbered.

    Args:
        tables_by_title: The captions and the tables.
        wide: Those of the tables that get at most LATEX_COLUMNS columns. A comment names the columns that are left out.
        name: Name of the task or experiment.
    """
    from salframe.evaluation.tables.formats import to_latex
    from salframe.evaluation.tables.table import narrow_table

    floats: list[str] = []
    labels: list[str] = []
    for title, table in tables_by_title:
        words = [word for word in re.findall(r"[a-z0-9]+", title.lower()) if word != "on"]
        label = "-".join(words if words[:1] == [name] else [name, *words])
        labels.append(label)
        number = f"-{labels.count(label)}" if labels.count(label) > 1 else ""
        table, left_out = narrow_table(table, LATEX_COLUMNS) if table in wide else (table, [])
        headings = ", ".join(" ".join(heading.split()) for heading in left_out)
        note = f"% columns left out, which --columns can select: {headings}\n" if headings else ""
        floats.append(note + to_latex(table, title, f"tab:{label}{number}"))
    return "\n".join(floats)


def print_sensor(measurement: SensorMeasurement) -> None:
    """Print the measured and modelled recall of a detector by size, range and occlusion, and a summary."""
    table = measurement.table()
    print_table(table.headings, table.rows)
    for line in measurement.summary():
        _say(line, dim=False)


def _print_notes(result: Result[Any] | StudyResult, printed: Collection[str]) -> None:
    """Print the notes of a result that were not printed before, and for each method its remark and its numbers of
    failures by status."""
    notes = [note for note in result.notes if note not in printed]
    for row in result.rows:
        failures = ", ".join(f"{count} {status}" for status, count in row.status.items() if status != "ok")
        if remarks := "; ".join(part for part in (row.remark, failures) if part):
            notes.append(f"{row.title}: {remarks}")
    for note in notes:
        _say(note)


def print_reported(papers: Sequence[Reported]) -> None:
    """Print the tables that papers report, separately from the measured tables."""
    for paper in papers:
        _console().print(_reported(paper.tables))
        _console().print(f"{paper.source}. {paper.note}", style="dim", markup=False, highlight=False)


def _say(line: str, dim: bool = True) -> None:
    _console().print(line, style="dim" if dim else None, markup=False, highlight=False, soft_wrap=True)


def _reported(parts: Sequence[ReportedTable]) -> rich_table.Table:
    """Return the tables of a paper as one table. The first line of each table has the headings of its numbers."""
    table = rich_table.Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("reported, not measured", overflow="fold")
    for _ in range(max(len(part.figures) for part in parts)):
        table.add_column("", justify="right", no_wrap=True)
    for part in parts:
        table.add_row(escape(part.title), *map(escape, part.figures), style="bold")
        for method, numbers in part.rows.items():
            table.add_row(
                f"  {escape(method)}", *(f"{number:g}" for number in numbers), end_section=method == list(part.rows)[-1]
            )
    return table
