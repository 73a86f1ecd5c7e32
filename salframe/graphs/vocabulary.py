"""A common vocabulary of object names for the labels of all detectors and datasets."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.config import read_yaml
from salframe.framework.errors import MIN_SIMILARITY
from salframe.graphs.detections import Detections
from salframe.panoramas.label_table import spelling

NAMES = Path(__file__).with_name("vocabulary.yaml")
"""YAML file that lists the synonyms and the kinds (special types, such as "dining table" of "table") of each name, and
labels that are not objects."""
WRITTEN_LABELS = "written_labels"
"""Name of the array of `written_labels` in the description of a panorama (the arrays that a localizer stores)."""
MAX_LABELS = 5
"""Maximum number of unknown labels to name in a note."""
MAX_NEAR_NAMES = 3
"""Maximum number of names that resemble an unknown label."""
_BETWEEN_SYNONYMS = re.compile(r"; ?|, ")
"""Separators in a label that lists synonyms, as in the classes of ADE20K ("sofa, couch, lounge")."""
_PLURAL = re.compile(r"[a-z]{2,}[b-hj-rtv-z]s")
"""Pattern of a plural that is not in the vocabulary. It excludes words such as bias, iris, glass and cactus."""


@lru_cache(maxsize=2**16)
def object_label(label: str) -> str:
    """Return the name of a label of a detector or dataset in the vocabulary: one name for all spellings and synonyms.

    The comparison ignores case, Unicode composition, punctuation between words, a number at the end, and plural:
    "Potted_Plants 2" gives "plant". If a label lists synonyms ("sofa, couch, lounge"), the first word that is in the
    vocabulary is used. A label that is not in the vocabulary is returned in lower case, and in the singular if it looks
    like an English plural.
    """
    words, names = spelling(label), _names()
    synonyms = _BETWEEN_SYNONYMS.split(words)
    for word in (words, *(synonyms if all(synonyms) else ())):
        for form in (word, *_singular_forms(word)):
            if name := names.get(form) or names.get(form.replace(" ", "")):
                return name
    return _singular(words)


def common_label(label: str) -> str:
    """Return the general name of a label, by which different detectors are compared: "table" for "dining table". For
    most labels, it is the `object_label`."""
    name = object_label(label)
    return _broader().get(name, name)


def vocabulary_names() -> tuple[str, ...]:
    """Return the general names of the vocabulary, without synonyms and without special kinds such as "dining table"."""
    return tuple(read_yaml(NAMES)["synonyms"])


def vocabulary_words() -> tuple[str, ...]:
    """Return all words of the vocabulary that name objects: names, synonyms and kinds."""
    vocabulary = _vocabulary()
    kinds = (kind for kinds in vocabulary["kinds"].values() for kind in kinds)
    synonyms = (word for name, words in vocabulary["synonyms"].items() for word in (name, *words))
    return tuple(dict.fromkeys([*synonyms, *kinds]))


def with_object_labels(detections: Detections) -> Detections:
    """Return the detections with each label replaced by its `object_label`, for comparison with other panoramas."""
    return replace(detections, labels=tuple(map(object_label, detections.labels)))


def with_common_labels(detections: Detections) -> Detections:
    """Return the detections with each label replaced by its `common_label`, for comparison with another detector."""
    return replace(detections, labels=tuple(map(common_label, detections.labels)))


def is_moving(label: str) -> bool:
    """Return whether a label names people, animals or bags."""
    return common_label(label) in _vocabulary()["moving"]


def without_moving_objects(detections: Detections) -> Detections:
    """Return the detections without people, animals and bags, which are probably elsewhere in the next panorama.

    The list `moving` of vocabulary.yaml contains general names, such as `animal`. Detections with special names, such
    as `dog`, are left out, too.
    """
    rows = [row for row, label in enumerate(detections.labels) if not is_moving(label)]
    return detections if len(rows) == len(detections) else detections.take(np.array(rows, np.intp))


def written_labels(detections: Detections) -> dict[str, np.ndarray]:
    """Return the distinct labels of detections in the spelling of the detector, as an entry of a description.

    The value is (W,) str in alphabetical order.
    """
    return {WRITTEN_LABELS: np.unique(np.array(detections.labels, np.str_))}


def is_object(name: str) -> bool | None:
    """Return whether an `object_label` names a class of objects. False, for example, for a surface of the building;
    None if the label is not in the vocabulary."""
    vocabulary = _vocabulary()
    if name in vocabulary["not_objects"]:
        return False
    return True if name in vocabulary["synonyms"] or name in _broader() else None


def near_names(label: str) -> tuple[str, ...]:
    """Return the names in the vocabulary that resemble a label, best first, at most MAX_NEAR_NAMES."""
    names = _names()
    close = difflib.get_close_matches(object_label(label), names, MAX_NEAR_NAMES, MIN_SIMILARITY)
    return tuple(dict.fromkeys(names[word] for word in close))


def unknown_labels(description: Mapping[str, np.ndarray], known: Collection[str]) -> tuple[str, ...]:
    """Return the labels of a description, as written in the data, whose `object_label` is not in `known`."""
    return tuple(str(label) for label in description.get(WRITTEN_LABELS, ()) if object_label(str(label)) not in known)


def unknown_labels_note(labels: Collection[str]) -> str:
    """Return a note on labels of a query that no object of the map has. It names at most MAX_LABELS of these labels."""
    named = ", ".join(repr(label) for label in sorted(labels)[:MAX_LABELS])
    more = f" and {len(labels) - MAX_LABELS} more" if len(labels) > MAX_LABELS else ""
    return f"no object of the map has the {'label' if len(labels) == 1 else 'labels'} {named}{more}"


def _singular_forms(words: str) -> Iterator[str]:
    """Yield forms that may be the singular of a label. Most of these forms are not English words."""
    for plural, endings in (("s", ("",)), ("es", ("",)), ("ies", ("y",)), ("ves", ("f", "fe"))):
        if words.endswith(plural):
            yield from (words.removesuffix(plural) + ending for ending in endings)


def _singular(words: str) -> str:
    """Return the singular of a label that is not in the vocabulary, if its last word looks like an English plural;
    otherwise the label."""
    if not _PLURAL.fullmatch(words.rpartition(" ")[2]):
        return words
    if words.endswith(("sses", "shes", "ches", "xes", "zzes")):
        return words.removesuffix("es")
    if words.endswith("ies") and len(words.rpartition(" ")[2]) > 4:
        return words.removesuffix("ies") + "y"
    return words.removesuffix("s")


@cache
def _vocabulary() -> dict[str, Any]:
    """Return the content of vocabulary.yaml."""
    return read_yaml(NAMES)


@cache
def _names() -> dict[str, str]:
    """Return a mapping from each word of the vocabulary to its name. Words with spaces are also keys without their
    spaces (tvmonitor)."""
    vocabulary = _vocabulary()
    words = {word: word for word in vocabulary["not_objects"]}
    words |= {kind: kind for kinds in vocabulary["kinds"].values() for kind in kinds}
    words |= {word: name for name, synonyms in vocabulary["synonyms"].items() for word in (name, *synonyms)}
    return {word.replace(" ", ""): name for word, name in words.items()} | words


@cache
def _broader() -> dict[str, str]:
    """Return a mapping from each special kind to its general name, such as "dining table" to "table"."""
    return {kind: name for name, kinds in _vocabulary()["kinds"].items() for kind in kinds}
