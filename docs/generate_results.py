"""Draw the measured tables of docs/results.md and docs/results/*.md from docs/results/*.json. Run it after experiments.

`salframe experiment NAME --results docs/results` writes the JSON files. Drawn are the blocks between
`<!-- experiment: NAME -->` and `<!-- drawn -->`, the table of a block `<!-- table: EXPERIMENT TABLE [COLUMNS] -->`, the
list of `<!-- experiments -->`, and the time of all tables in `<!-- hours -->`. All else is written by hand.
"""

from __future__ import annotations

import re
from pathlib import Path

import yaml

from salframe.evaluation.studies.experiment import (
    Experiment,
    TableStudy,
    experiment_names,
    in_quick,
    read_experiment,
    reported_in,
)
from salframe.evaluation.studies.stored import StoredTable, read_results, stored_tables
from salframe.evaluation.tables.formats import to_markdown
from salframe.evaluation.tables.reported import reported_table

SUMMARY = Path(__file__).with_name("results.md")
RESULTS = Path(__file__).with_name("results")
HOURS = re.compile(r"(<!-- hours -->).*?(<!-- /hours -->)")
TABLE = re.compile(r"(<!-- table: ([\w-]+) ([\w-]+) (\[.*?\]) -->\n).*?(<!-- /table -->\n)", re.DOTALL)
LIST = re.compile(r"(<!-- experiments -->\n).*?(<!-- /experiments -->\n)", re.DOTALL)
BLOCK = re.compile(r"(<!-- experiment: ([\w-]+) -->\n).*?(<!-- drawn -->\n)", re.DOTALL)


def pages() -> list[Path]:
    """Return the pages with drawn tables: the summary, and a page per experiment."""
    return [SUMMARY, *(RESULTS / f"{name}.md" for name in experiment_names())]


def draw(name: str) -> str:
    """Return the tables of an experiment: command, measured tables, figures reported by papers."""
    experiment, results = read_experiment(name), read_results(RESULTS / f"{name}.json")
    parts = [f"```\nsalframe experiment {name}{_options(experiment)}\n```"]
    for table, study in experiment.tables.items():
        whole, quick = results.whole.get(table), results.quick.get(table)
        short = in_quick(study, table) if whole is None else None
        if whole is not None:
            parts += _table(study, whole, "")
        elif quick is not None and short is not None:
            parts += _table(short, quick, ", with `--quick`: fewer seeds, queries and methods")
        else:
            parts.append(f"**{study.title}**: not measured yet.")
    reported = reported_in(experiment)
    if reported:
        parts.append(f"**Reported by a paper, not measured here** ({reported[0][0]}). {experiment.differs}")
    for _, part in reported:
        parts += [f"*{part.title}*", to_markdown(reported_table(part)).rstrip()]
    return "\n\n".join(parts) + "\n"


def draw_table(name: str, table: str, columns: list[str]) -> str:
    """Return one table of an experiment with the chosen columns."""
    study, stored = read_experiment(name).tables[table], read_results(RESULTS / f"{name}.json").whole[table]
    return "\n".join(to_markdown(one).rstrip() for one in stored_tables(study, stored, columns)) + "\n"


def draw_list() -> str:
    """Return the list of experiments with their questions."""
    lines = ["| page | question |", "|---|---|"]
    for name in experiment_names():
        title = (RESULTS / f"{name}.md").read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
        lines.append(f"| [{title}](results/{name}.md) | {read_experiment(name).question} |")
    return "\n".join(lines) + "\n"


def _options(experiment: Experiment) -> str:
    folders = any("matterport" in str(study.data) for study in experiment.tables.values())
    return " --data-dir DIR    # DIR: the files of the real buildings" if folders else ""


def _table(study: TableStudy, stored: StoredTable, how: str) -> list[str]:
    time = "" if stored.seconds is None else f", {duration(stored.seconds)}"
    parts = [f"**{study.title}** ({stored.date}, {stored.machine}{time}{how})"]
    for table in stored_tables(study, stored, study.columns):
        parts += [f"*{table.title}*"] if table.title else []
        parts.append(to_markdown(table).rstrip())
    return parts


def duration(seconds: float) -> str:
    """Return whole seconds below two minutes, otherwise whole minutes."""
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def hours() -> str:
    """Return the time of all tables that were measured without a break, and their number."""
    tables = [table for name in experiment_names() for table in read_results(RESULTS / f"{name}.json").whole.values()]
    timed = [table.seconds for table in tables if table.seconds is not None]
    return f"{sum(timed) / 3600:.1f} h, {len(timed)} of {len(tables)} tables"


def redraw(text: str) -> str:
    """Return the text of a page with its tables drawn again."""
    text = HOURS.sub(lambda match: f"{match[1]}{hours()}{match[2]}", text)
    text = LIST.sub(lambda match: f"{match[1]}\n{draw_list()}\n{match[2]}", text)
    text = TABLE.sub(
        lambda match: f"{match[1]}\n{draw_table(match[2], match[3], yaml.safe_load(match[4]))}\n{match[5]}", text
    )
    return BLOCK.sub(lambda match: f"{match[1]}\n{draw(match[2])}\n{match[3]}", text)


if __name__ == "__main__":
    for page in pages():
        page.write_text(redraw(page.read_text(encoding="utf-8")), encoding="utf-8")
