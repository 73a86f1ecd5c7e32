"""Tables as Markdown, LaTeX and CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from salframe.evaluation.tables.table import Table


def to_markdown(table: Table) -> str:
    """Return a table as Markdown, with the best cells in bold."""
    lines = [f"| {' | '.join(_inline(heading) for heading in table.headings)} |", f"|{'---|' * len(table.headings)}"]
    for i, row in enumerate(table.rows):
        cells = [f"**{text}**" if (i, j) in table.best else text for j, text in enumerate(map(_inline, row))]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _inline(text: str) -> str:
    return text.replace("\n", " ").replace("|", "\\|")


_LATEX = str.maketrans(
    {
        **{mark: f"\\{mark}" for mark in "&%$#_{}"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "°": r"\textdegree{}",
        "\n": " ",
    }
)


def to_latex(table: Table, caption: str = "", label: str = "") -> str:
    """Return a table as LaTeX for the package booktabs, with the best cells in bold.

    Args:
        table: The table.
        caption: Caption of the table environment; without one only the tabular is returned.
        label: Name for `\\ref`, such as "tab:localization".
    """
    columns = "l" * table.leading + "r" * (len(table.headings) - table.leading)
    lines = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule"]
    lines += [" & ".join(map(_latex_heading, table.headings)) + r" \\", r"\midrule"]
    for i, row in enumerate(table.rows):
        cells = (text.translate(_LATEX) for text in row)
        marked = (rf"\textbf{{{text}}}" if (i, j) in table.best else text for j, text in enumerate(cells))
        lines.append(" & ".join(marked) + r" \\")
    lines += [r"\bottomrule", r"\end{tabular}"]
    if caption:
        above = [r"\begin{table}", r"\centering", r"\small", rf"\caption{{{caption.translate(_LATEX)}}}"]
        lines = [*above, *([rf"\label{{{label}}}"] if label else []), *lines, r"\end{table}"]
    return "\n".join(lines) + "\n"


def _latex_heading(text: str) -> str:
    """Return a heading with its line breaks, so that columns are narrow."""
    lines = [line.translate(_LATEX) for line in text.split("\n")]
    return lines[0] if len(lines) == 1 else r"\shortstack[r]{" + r" \\ ".join(lines) + "}"


def to_csv(rows: Sequence[Mapping[str, Any]], leading: Sequence[Mapping[str, Any]] = ()) -> str:
    """Return rows as CSV in full precision, one column per key.

    Args:
        rows: The rows, as mappings from field names to JSON values.
        leading: For each row, the values of further columns on the left.
    """
    names = [name for name, value in (rows[0] if rows else {}).items() if not isinstance(value, dict)]
    out = io.StringIO()
    leading_keys = list(dict.fromkeys(key for one in leading for key in one))
    writer = csv.DictWriter(out, [*leading_keys, *names], extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for number, row in enumerate(rows):
        joined = {
            key: "; ".join(map(str, value)) if isinstance(value, tuple | list) else value for key, value in row.items()
        }
        writer.writerow({**(leading[number] if leading else {}), **joined})
    return out.getvalue()
