"""The words of the project: no identifier and no phrase of the old dialect in code, configuration, pages, examples."""

from __future__ import annotations

import ast
import io
import json
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent
FOLDERS = ("salframe", "plugins", "baselines", "configs", "docs", "examples", "training")
PAGES = (".js", ".css", ".html", ".jinja")
"""Suffixes of files of web pages."""
IDENTIFIERS = re.compile(
    r"(.*_)?(asked|found|told|said|kept|given|seen|own|wanted|denied|not_here)(_.*)?"  # a part: GIVEN, is_kept
    r"|_?(least|most|largest|longest)_.+"  # the first part
    r"|_?(keep|least|most|largest|known_by|known_as|question_key)",  # the whole name
    re.IGNORECASE,
)
KEY = re.compile(r"""[\s{-]*["']?([\w.-]+)["']?:""")
"""A line of YAML or JSON that starts with a key."""
ALLOWED_IDENTIFIERS = {
    "least_squares": "the name of the method, in scipy too",
    "most_common": "a method of collections.Counter",
    "NOT_FOUND": "a status of HTTP in the standard library",
    "val_seen": "a split of the benchmark REVERIE",
}
ALLOWED_CLASSES = {"Config": "the settings of a component, nested in its class"}
PHRASES = {
    "limits": r"\bso many\b|\bso often\b|\bat the most\b|\bno more than so\b",
    "options": r"\bunless (told|given|said)\b",
    "reports": r"\b(is|are|was|were) told\b(?! apart)|\btells? (nobody|what)\b",
    "queries": r"\basked\b",
    "maps": r"\bmapping frames?\b|(?<!reference )(?<!scene )\bframes of the map\b",
    "transition frames": r"\bscenes[ -]only\b",
    "seeds": r"\bof each seed\b",
    "pose recall": r"\bpose within\b",
    "out of map": r"\bnot here\b|\baccepted though absent\b|\bdenied\b",
    "random": r"\bby lot\b",
    "false positives": r"\bmade up\b|\bmakes up\b",
    "identity": r"\bknown by\b|\bknown as\b",
    "workers": r"\bhow many work\b",
    "unknown range": r"\bmeans? no reading\b",
    "heights": r"\bover the (visible )?floor\b",
    "evidence": r"\bwhat speaks for\b|\bcame about\b",
    "truth": r", in truth\b",
    "drawing": r"\bdrawn anew\b|\bshine through\b",
}
ALLOWED_PHRASES = {("salframe/panoramas/object_noise.py", "made up"): "a key that seeds the noise of stored results"}
"""Files and the phrase that each may use, and why."""


def files(*suffixes: str) -> Iterator[Path]:
    """The files of the project with these suffixes."""
    for folder in FOLDERS:
        for path in sorted((REPOSITORY / folder).rglob("*")):
            is_result = path.suffix == ".json" and path.parent == REPOSITORY / "docs/results"
            is_foreign = is_result or path.name == "plotly-basic.min.js"
            if path.suffix in suffixes and "__pycache__" not in path.parts and not is_foreign:
                yield path


def identifiers(path: Path) -> Iterator[tuple[int, str]]:
    """The line and text of each name in a file: the names in Python, or the keys in YAML and JSON and the file name,
    divided at dots, with `_` for hyphens."""
    text = path.read_text(encoding="utf-8")
    if path.suffix in (".py", ".pyi"):
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.NAME:
                yield token.start[0], token.string
        return
    yield 1, path.stem.replace("-", "_")
    for number, line in enumerate(text.splitlines(), 1):
        if match := KEY.match(line):
            yield from ((number, part.replace("-", "_")) for part in match[1].split("."))


def class_names(path: Path) -> Iterator[str]:
    """The name of each class in a file of Python, nested ones too, without the underscore of private ones."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef):
            yield node.name.removeprefix("_")


def sentences(path: Path) -> Iterator[tuple[int, str]]:
    """The number and text of each line of a file; of a notebook, the number of each text cell and its lines."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".ipynb":
        yield from enumerate(text.splitlines(), 1)
        return
    for number, cell in enumerate(json.loads(text)["cells"], 1):
        if cell["cell_type"] == "markdown":
            yield from ((number, line) for line in "".join(cell["source"]).splitlines())


@pytest.mark.parametrize("folder", FOLDERS)
def test_identifiers_are_plain(folder):
    bad = defaultdict(set)
    for path in files(".py", ".pyi", ".yaml", ".json"):
        if folder in path.relative_to(REPOSITORY).parts[:1]:
            for line, name in identifiers(path):
                if IDENTIFIERS.fullmatch(name) and name not in ALLOWED_IDENTIFIERS:
                    bad[f"{path.relative_to(REPOSITORY)}:{line}"].add(name)
    assert not bad, "\n".join(f"{place} {', '.join(sorted(names))}" for place, names in bad.items())


def test_identifiers_of_scripts_are_plain():
    """Without strings and comments, every word of a script is an identifier or a keyword."""
    bad = []
    for path in files(".js"):
        code = re.sub(r'"(\\.|[^"\\])*"|`[^`]*`|//.*', "", path.read_text(encoding="utf-8"))
        names = {name for name in re.findall(r"[A-Za-z_]\w*", code) if IDENTIFIERS.fullmatch(name)}
        bad += [f"{path.relative_to(REPOSITORY)} {name}" for name in sorted(names)]
    assert not bad, "\n".join(bad)


@pytest.mark.parametrize("folder", FOLDERS)
def test_phrases_are_plain(folder):
    bad = []
    for path in files(".py", ".pyi", ".yaml", ".md", ".ipynb", *PAGES):
        name = path.relative_to(REPOSITORY)
        if name.parts[0] != folder:
            continue
        for number, line in sentences(path):
            for concept, pattern in PHRASES.items():
                for match in re.finditer(pattern, line, re.IGNORECASE):
                    if (str(name), match[0].lower()) not in ALLOWED_PHRASES:
                        bad.append(f"{name}:{number} {concept}: {match[0]!r}")
    assert not bad, "\n".join(bad)


def test_no_two_classes_share_a_name():
    places = defaultdict(list)
    for path in files(".py"):
        for name in class_names(path):
            places[name].append(str(path.relative_to(REPOSITORY)))
    shared = {name: where for name, where in places.items() if len(where) > 1 and name not in ALLOWED_CLASSES}
    assert not shared
