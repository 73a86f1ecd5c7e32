"""Conversion of the labels of published networks to object names of the graph."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

from salframe.framework.config import read_yaml
from salframe.graphs.vocabulary import object_label
from salframe_segments.card import SHIPPED

TABLES = ("ade20k", "coco")
"""Data sets whose labels are known. Each has a table in cards/names. If several tables have a label, the first is
used."""
_ENDING = re.compile(r"(-(merged|other|stuff))+$")
"""Endings of COCO's labels for "stuff" (walls, floors and the like), such as wall-other-merged."""


@dataclass(frozen=True)
class NetworkLabels:
    """Meaning of the labels of a data set.

    Attributes:
        structure: Labels that are not objects.
        names: Mapping from each label of an object to the name of the object in the graph.
        fixed: Names of objects that are part of the building.
    """

    structure: frozenset[str]
    names: Mapping[str, str]
    fixed: frozenset[str]

    def has(self, label: str) -> bool:
        """Return whether the table has a label."""
        return label in self.structure or label in self.names


def graph_name(label: str) -> str | None:
    """Return the name that the graph uses for a label of a network; None if the label is structure, such as a wall.

    Labels of ADE20K and COCO are known, also with synonyms after commas ("windowpane, window") and with the endings of
    COCO's stuff ("floor-wood", "cabinet-merged"). Any other label is an object, under its `object_label`.
    """
    forms = list(_forms(label))
    for form in forms:
        for table in _tables():
            if table.has(form):
                return None if form in table.structure else table.names[form]
    return object_label(forms[0])


def fixed_names() -> frozenset[str]:
    """Return the names of objects that are part of the building."""
    return frozenset[str]().union(*(table.fixed for table in _tables()))


def _forms(label: str) -> Iterator[str]:
    """Yield the spellings of a label that a table may contain, the most specific first."""
    for part in label.lower().replace("_", " ").split(","):
        if word := " ".join(part.split()):
            yield from dict.fromkeys((word, _ENDING.sub("", word), word.partition("-")[0]))


@cache
def _tables() -> tuple[NetworkLabels, ...]:
    contents = [read_yaml(SHIPPED / "names" / f"{name}.yaml") for name in TABLES]
    return tuple(
        NetworkLabels(
            frozenset(content["structure"]),
            {**content["objects"], **content["fixed"]},
            frozenset(content["fixed"].values()),
        )
        for content in contents
    )
