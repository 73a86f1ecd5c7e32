"""Draw the tables of docs/results.md from docs/results/*.json, which `salframe experiment` writes. Run it after that.

A line `<!-- experiment: NAME -->` is followed by what is drawn, up to the line `<!-- drawn -->`, and `<!-- hours -->`
by how long all tables took, up to `<!-- /hours -->`; all else is written by hand.
"""

from __future__ import annotations

import re
from pathlib import Path

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

PAGE = Path(__file__).with_name("results.md")
RESULTS = Path(__file__).with_name("results")
HOURS = re.compile(r"(<!-- hours -->).*?(<!-- /hours -->)")
BLOCK = re.compile(r"(<!-- experiment: ([\w-]+) -->\n).*?(<!-- drawn -->\n)", re.DOTALL)


def draw(name: str) -> str:
    """The tables of an experiment: question, command, what was measured, what papers report."""
    experiment, results = read_experiment(name), read_results(RESULTS / f"{name}.json")
    parts = [experiment.question, f"```\nsalframe experiment {name}{_options(experiment)}\n```"]
    for table, study in experiment.tables.items():
        whole, quick = results.whole.get(table), results.quick.get(table)
        short = in_quick(study, table) if whole is None else None
        if whole is not None:
            parts += _table(study, whole, "")
        elif quick is not None and short is not None:
            parts += _table(short, quick, ", with `--quick`: fewer seeds, queries and methods")
        else:
            parts.append(f"**{study.title}**: not measured yet.")
    for source, part in reported_in(experiment):
        parts.append(f"Reported, not measured: {part.title}. {source}. {experiment.differs}")
        parts.append(to_markdown(reported_table(part)).rstrip())
    return "\n\n".join(parts) + "\n"


def _options(experiment: Experiment) -> str:
    folders = any("matterport" in str(study.data) for study in experiment.tables.values())
    return " --data-dir DIR    # of the real buildings" if folders else ""


def _table(study: TableStudy, stored: StoredTable, how: str) -> list[str]:
    took = "" if stored.seconds is None else f", {duration(stored.seconds)}"
    parts = [f"**{study.title}** ({stored.date}, {stored.machine}{took}{how})"]
    for table in stored_tables(study, stored, study.columns):
        parts += [f"*{table.title}*"] if table.title else []
        parts.append(to_markdown(table).rstrip())
    return parts


def duration(seconds: float) -> str:
    """Whole seconds of less than two minutes, otherwise whole minutes."""
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def hours() -> str:
    """How long all tables took that were measured in one go, and how many are not among them."""
    kept = [table for name in experiment_names() for table in read_results(RESULTS / f"{name}.json").whole.values()]
    timed = [table.seconds for table in kept if table.seconds is not None]
    return f"{sum(timed) / 3600:.1f} h, {len(timed)} of {len(kept)} tables"


def page(text: str) -> str:
    """The page with its tables drawn anew."""
    text = HOURS.sub(lambda found: f"{found[1]}{hours()}{found[2]}", text)
    return BLOCK.sub(lambda found: f"{found[1]}\n{draw(found[2])}\n{found[3]}", text)


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    absent = set(experiment_names()) - set(re.findall(r"<!-- experiment: ([\w-]+) -->", text))
    if absent:
        raise SystemExit(f"{PAGE} has no place for {', '.join(sorted(absent))}")
    PAGE.write_text(page(text), encoding="utf-8")
