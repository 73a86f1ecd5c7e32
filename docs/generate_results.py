"""Draw the measured tables of docs/results.md and docs/results/*.md from docs/results/*.json. Run it after experiments.

`salframe experiment NAME --results docs/results` writes the JSON files. Drawn are the blocks between
`<!-- experiment: NAME -->` and `<!-- drawn -->`, the table of a block `<!-- table: EXPERIMENT TABLE [COLUMNS] -->`, the
table of `<!-- experiments: questions -->`, the definitions of all terms in `<!-- terms -->`, and the time of all tables
in `<!-- hours -->`. All else is written by hand. result_terms.yaml defines the terms. The page of an experiment lists
the terms that its tables use and its text does not define.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
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
from salframe.evaluation.tables.table import METHOD, Table

SUMMARY = Path(__file__).with_name("results.md")
RESULTS = Path(__file__).with_name("results")
READING = RESULTS / "reading-the-tables.md"
EXPERIMENTS = Path(__file__).parent / "how-to" / "experiments.md"
TERMS: dict[str, dict[str, str]] = yaml.safe_load(
    Path(__file__).with_name("result_terms.yaml").read_text(encoding="utf-8")
)
GROUPS = {"columns": "column", "rows": "method or detector", "inputs": "input", "data": "word in a title"}
"""Heading of the definitions of each group of terms."""
ACCURACY, SUCCESS_RATE = "accuracy %", "SR %"
"""Columns that only tables of localization and only tables of navigation have."""
IN_NAVIGATION = {f"{name} in tables with {SUCCESS_RATE}" for name in ("95 % CI", "p (Holm)")}
"""Terms that explain what differs in tables of navigation, on pages that also have tables of localization."""
HOURS = re.compile(r"(<!-- hours -->).*?(<!-- /hours -->)")
TABLE = re.compile(r"(<!-- table: ([\w-]+) ([\w-]+) (\[.*?\]) -->\n).*?(<!-- /table -->\n)", re.DOTALL)
QUESTIONS = re.compile(r"(<!-- experiments: questions -->\n).*?(<!-- /experiments -->\n)", re.DOTALL)
DEFINITIONS = re.compile(r"(<!-- terms -->\n).*?(<!-- /terms -->\n)", re.DOTALL)
BLOCK = re.compile(r"(<!-- experiment: ([\w-]+) -->\n).*?(<!-- drawn -->\n)", re.DOTALL)


def pages() -> list[Path]:
    """Return the pages with drawn parts: summary, definitions of terms, questions, and a page per experiment."""
    return [SUMMARY, READING, EXPERIMENTS, *(RESULTS / f"{name}.md" for name in experiment_names())]


def draw(name: str, text: str) -> str:
    """Return the content of an experiment's page: command, definitions, measured tables, figures reported by papers.

    Args:
        name: Name of the experiment.
        text: What is written by hand on its page. Terms that it defines in tables are not defined again.
    """
    experiment, results = read_experiment(name), read_results(RESULTS / f"{name}.json")
    parts: list[str] = []
    tables: list[Table] = []
    for key, study in experiment.tables.items():
        whole, quick = results.whole.get(key), results.quick.get(key)
        short = in_quick(study, key) if whole is None else None
        if whole is not None:
            parts += _table(study, whole, "", tables)
        elif quick is not None and short is not None:
            parts += _table(short, quick, ", with `--quick`: fewer seeds, queries and methods", tables)
        else:
            parts.append(f"**{study.title}**: not measured yet.")
    reported = reported_in(experiment)
    if reported:
        named = any("proposed" in row for _, part in reported for row in part.rows)
        note = (
            " In this part, *proposed* is the method of the paper. The other rows are methods that the paper "
            "compares with it."
            if named
            else ""
        )
        parts.append(f"**Reported by a paper, not measured here** ({reported[0][0]}). {experiment.differs}{note}")
    for _, part in reported:
        parts += [f"*{part.title}*", to_markdown(reported_table(part)).rstrip()]
    titles = " ".join(study.title for study in experiment.tables.values())
    terms = draw_terms({group: used - defined_in(text) for group, used in used_terms(tables, titles).items()})
    command = f"```\nsalframe experiment {name}{_options(experiment)}\n```"
    return "\n\n".join([command, *([terms] if terms else []), _notation(tables), *parts]) + "\n"


def _notation(tables: Sequence[Table]) -> str:
    """Return the explanation of the marks in tables."""
    sentences = ["The brackets after the title of a table contain date, machine and run time of the measurement."]
    if any(table.best for table in tables):
        group = any(table.headings and table.headings[0] != METHOD for table in tables)
        sentences.append("A number in **bold** is the best of its column.")
        if group:
            sentences.append(
                "In tables with columns left of *method*, it is the best among the rows with the same values in these "
                "columns."
            )
    if any(re.search(r"\w\[\w", cell) for table in tables for row in table.rows for cell in row[: table.leading]):
        sentences.append("Square brackets after the name of a method contain the settings that were changed.")
    return " ".join(sentences)


def used_terms(tables: Sequence[Table], titles: str = "") -> dict[str, set[str]]:
    """Return the terms of tables, by group: headings, names of rows, inputs, and words for data in the titles."""
    used: dict[str, set[str]] = {group: set() for group in GROUPS}
    for table in tables:
        headings = [" ".join(heading.split()) for heading in table.headings]
        plain = {heading.replace(" (95 % CI)", "") for heading in headings}
        used["columns"] |= plain - {METHOD, "input"}
        used["columns"] |= {"95 % CI" for heading in headings if "95 % CI" in heading}
        for row in table.rows:
            cells = dict(zip(headings, row, strict=True))
            used["rows"] |= set(re.sub(r"\[.*| \(.*for .*", "", cells[METHOD]).split(", "))
            used["inputs"] |= {_input(part) for part in re.split(r", | \+ ", cells.get("input", "-"))} - {"-"}
    if {SUCCESS_RATE, ACCURACY} <= used["columns"]:
        used["columns"] |= IN_NAVIGATION
    used["data"] |= {word for word in TERMS["data"] if word in titles.lower()}
    return used


def _input(part: str) -> str:
    """Return the term of a part of an input, without numbers."""
    views = re.fullmatch(r"\d+ (views \w+)", part)
    return views[1] if views else "missed, mislabelled, range_share" if part.startswith("missed ") else part


def defined_in(text: str) -> set[str]:
    """Return the terms in the first column of the tables of a page."""
    cells = re.findall(r"^\| (.*?) \|", text, re.MULTILINE)
    return {part.replace("`", "") for cell in cells for part in (*cell.split(", "), cell)}


def undefined(text: str) -> set[str]:
    """Return the headings, names of rows and inputs of a page's drawn tables that the page does not define."""
    by_hand = BLOCK.sub("", DEFINITIONS.sub("", text))
    used: set[str] = set()
    for _, name, _ in BLOCK.findall(text):
        experiment, results = read_experiment(name), read_results(RESULTS / f"{name}.json")
        for key, stored in results.whole.items():
            study = experiment.tables[key]
            used |= set().union(*used_terms(stored_tables(study, stored, study.columns)).values())
    return used - set().union(*TERMS.values()) - defined_in(by_hand)


def draw_terms(used: Mapping[str, Collection[str]]) -> str:
    """Return tables with the definitions of the used terms, a table per group, in the order of TERMS."""
    tables = []
    for group, heading in GROUPS.items():
        other = TERMS["navigation"] if SUCCESS_RATE in used[group] and ACCURACY not in used[group] else {}
        meanings = TERMS[group] | {name: other[name] for name in TERMS[group] if name in other}
        lines = [f"| {name} | {meaning} |" for name, meaning in meanings.items() if name in used[group]]
        tables += ["\n".join([f"| {heading} | meaning |", "|---|---|", *lines])] if lines else []
    return "\n\n".join(tables)


def draw_table(name: str, table: str, columns: list[str]) -> str:
    """Return one table of an experiment with the chosen columns."""
    study, stored = read_experiment(name).tables[table], read_results(RESULTS / f"{name}.json").whole[table]
    return "\n".join(to_markdown(one).rstrip() for one in stored_tables(study, stored, columns)) + "\n"


def draw_questions() -> str:
    """Return a table of all experiments with their questions."""
    lines = ["| page | question |", "|---|---|"]
    lines += [
        f"| [{_title(name)}](../results/{name}.md) | {read_experiment(name).question} |" for name in experiment_names()
    ]
    return "\n".join(lines) + "\n"


def _title(name: str) -> str:
    return (RESULTS / f"{name}.md").read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")


def _options(experiment: Experiment) -> str:
    folders = any("matterport" in str(study.data) for study in experiment.tables.values())
    return " --data-dir DIR    # DIR: the files of the real buildings" if folders else ""


def _table(study: TableStudy, stored: StoredTable, how: str, tables: list[Table]) -> list[str]:
    """Return the title and the tables of a study as text, and append the tables to `tables`."""
    time = "" if stored.seconds is None else f", {duration(stored.seconds)}"
    parts = [f"**{study.title}** ({stored.date}, {stored.machine}{time}{how})"]
    for table in stored_tables(study, stored, study.columns):
        tables.append(table)
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
    return f"{sum(timed) / 3600:.1f} h for {len(timed)} of the {len(tables)} tables"


def redraw(text: str) -> str:
    """Return the text of a page with its tables drawn again."""
    text = HOURS.sub(lambda match: f"{match[1]}{hours()}{match[2]}", text)
    text = QUESTIONS.sub(lambda match: f"{match[1]}\n{draw_questions()}\n{match[2]}", text)
    text = TABLE.sub(
        lambda match: f"{match[1]}\n{draw_table(match[2], match[3], yaml.safe_load(match[4]))}\n{match[5]}", text
    )
    text = DEFINITIONS.sub(lambda match: f"{match[1]}\n{draw_terms(TERMS)}\n\n{match[2]}", text)
    by_hand = BLOCK.sub("", text)
    return BLOCK.sub(lambda match: f"{match[1]}\n{draw(match[2], by_hand)}\n{match[3]}", text)


if __name__ == "__main__":
    for page in pages():
        page.write_text(redraw(page.read_text(encoding="utf-8")), encoding="utf-8")
