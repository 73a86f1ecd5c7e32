"""A common vocabulary of object names, in one spelling, for detectors and annotations of different datasets."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path

import numpy as np

from salframe.framework.config import read_yaml
from salframe.graphs.detections import Detections

NAMES = Path(__file__).with_name("vocabulary.yaml")
"""YAML file that lists the synonyms and the kinds of each name."""
WRITTEN_LABELS = "written_labels"
"""Key of `written_labels` in the description of a panorama."""
MAX_LABELS = 5
"""Maximum number of unknown labels to name in a note."""
_AROUND_NUMBERS = " #.,:;()[]"
"""Characters around a number at the end of a label, such as in chair#3, Chair.001 and chair (4)."""
_PLURAL = re.compile(r"[a-z]{2,}[b-hj-rtv-z]s")
"""A plural outside the vocabulary. Words that end like bias, iris, glass and cactus are none."""


@lru_cache(maxsize=2**16)
def object_label(label: str) -> str:
    """Return the name of a label of a detector or dataset: one name for all spellings and synonyms.

    Labels are compared without case, composition of characters, punctuation between words, a number at the end, and
    the difference of singular and plural: "Potted_Plants 2" is a plant. A label that is not in the vocabulary is
    returned in lower case, in the singular where it is an English word.
    """
    spelling, names = _spelling(label), _names()
    for form in (spelling, *_singular_forms(spelling)):
        if name := names.get(form) or names.get(form.replace(" ", "")):
            return name
    return _singular(spelling)


def common_label(label: str) -> str:
    """Return the name that detectors share for a label: its `object_label`, or the more general label for a kind (table
    for dining table)."""
    name = object_label(label)
    return _broader().get(name, name)


def vocabulary_names() -> tuple[str, ...]:
    """Return the names of the vocabulary: one for each kind of object, without synonyms and more special kinds."""
    return tuple(read_yaml(NAMES)["synonyms"])


def with_object_labels(detections: Detections) -> Detections:
    """Return the detections with labels that are equal for equal objects, for comparison with other panoramas."""
    return replace(detections, labels=tuple(map(object_label, detections.labels)))


def with_common_labels(detections: Detections) -> Detections:
    """Return the detections with the labels that detectors share, for comparison with another detector."""
    return replace(detections, labels=tuple(map(common_label, detections.labels)))


def written_labels(detections: Detections) -> dict[str, np.ndarray]:
    """Return the distinct labels as the detector writes them, (W,) str in alphabetical order, as a part of a
    description."""
    return {WRITTEN_LABELS: np.unique(np.array(detections.labels, np.str_))}


def unknown_labels(description: Mapping[str, np.ndarray], known: Collection[str]) -> tuple[str, ...]:
    """Return the labels of a description with `written_labels` whose object label is not known."""
    return tuple(str(label) for label in description.get(WRITTEN_LABELS, ()) if object_label(str(label)) not in known)


def unknown_labels_note(labels: Collection[str]) -> str:
    """Return a note that names labels of a query that the map does not know, at most MAX_LABELS of them."""
    named = ", ".join(repr(label) for label in sorted(labels)[:MAX_LABELS])
    more = f" and {len(labels) - MAX_LABELS} more" if len(labels) > MAX_LABELS else ""
    return f"no object of the map has the label {named}{more}"


def _spelling(label: str) -> str:
    """Return a label in lower case, with composed characters, single spaces between words, and no number at the end."""
    visible = "".join(char for char in label if unicodedata.category(char) != "Cf")
    composed = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", visible).casefold())
    # Underscores, dashes and control characters separate words.
    spaced = "".join(" " if unicodedata.category(char) in ("Pc", "Pd", "Cc") else char for char in composed)
    return _without_number(" ".join(spaced.split())) or composed


def _without_number(words: str) -> str:
    """Return a label without the numbers at its end, which count objects; a label of numbers only is unchanged."""
    end = len(words.rstrip(" )]"))
    if not words[:end][-1:].isdecimal():
        return words
    while end and (words[end - 1].isdecimal() or words[end - 1] in _AROUND_NUMBERS):
        end -= 1
    return words[:end] or words


def _singular_forms(spelling: str) -> Iterator[str]:
    """Yield the forms that may be the singular of a label; most of them are no words."""
    for plural, endings in (("s", ("",)), ("es", ("",)), ("ies", ("y",)), ("ves", ("f", "fe"))):
        if spelling.endswith(plural):
            yield from (spelling.removesuffix(plural) + ending for ending in endings)


def _singular(spelling: str) -> str:
    """Return a label outside the vocabulary in the singular, where its last word is an English plural."""
    if not _PLURAL.fullmatch(spelling.rpartition(" ")[2]):
        return spelling
    if spelling.endswith(("sses", "shes", "ches", "xes", "zzes")):
        return spelling.removesuffix("es")
    if spelling.endswith("ies") and len(spelling.rpartition(" ")[2]) > 4:
        return spelling.removesuffix("ies") + "y"
    return spelling.removesuffix("s")


@cache
def _names() -> dict[str, str]:
    """Return the name for each word of the vocabulary, and for each without its spaces (tvmonitor)."""
    vocabulary = read_yaml(NAMES)
    words = {kind: kind for kinds in vocabulary["kinds"].values() for kind in kinds}
    words |= {word: name for name, synonyms in vocabulary["synonyms"].items() for word in (name, *synonyms)}
    return {word.replace(" ", ""): name for word, name in words.items()} | words


@cache
def _broader() -> dict[str, str]:
    """Return the name for each kind of it."""
    return {kind: name for name, kinds in read_yaml(NAMES)["kinds"].items() for kind in kinds}
