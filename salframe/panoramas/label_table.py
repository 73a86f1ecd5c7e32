"""Labels of annotated objects: normalization of their spelling, and translation by a table of the user."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from salframe.framework.config import read_yaml
from salframe.framework.errors import ConfigError, DataError, shorten

_AROUND_NUMBERS = " #.,:;()[]"
"""Characters around a number at the end of a label, such as in chair#3, Chair.001 and chair (4)."""


def spelling(label: str) -> str:
    """Return a label in lower case, with composed characters, single spaces between words, and no number at the end."""
    visible = "".join(char for char in label if unicodedata.category(char) != "Cf")
    composed = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", visible).casefold())
    # Underscores, dashes and control characters separate words.
    spaced = "".join(" " if unicodedata.category(char) in ("Pc", "Pd", "Cc") else char for char in composed)
    return _without_number(" ".join(spaced.split())) or composed


@dataclass(frozen=True)
class LabelTable:
    """Translation of labels.

    Attributes:
        names: Maps each label, in the form that `spelling` returns, to the name that replaces it.
    """

    names: Mapping[str, str]

    @classmethod
    def read(cls, path: Path) -> LabelTable:
        """Read a YAML mapping from each name to the list of labels that stand for it.

        Raises:
            DataError: The file cannot be read or is malformed, or a label stands for two names.
        """
        try:
            content = read_yaml(path)
        except ConfigError as error:
            raise DataError(str(error)) from None
        names: dict[str, str] = {}
        for name, labels in content.items():
            if not (isinstance(name, str) and isinstance(labels, list) and all(isinstance(x, str) for x in labels)):
                raise DataError(
                    f"{path}: received {shorten(f'{name}: {labels}')}, expected a name and a list of labels, such as "
                    "chair: [Stuhl, Sessel]"
                )
            for label in map(spelling, labels):
                if names.setdefault(label, name) != name:
                    raise DataError(
                        f"{path}: the label {label!r} is listed under {names[label]!r} and {name!r}, expected it "
                        "under one name"
                    )
        return cls(names)

    def name(self, label: str) -> str:
        """Return the name that replaces a label. A label that is not in the table is returned unchanged."""
        return self.names.get(spelling(label), label)


def _without_number(words: str) -> str:
    """Return a label without the numbers at its end, which count objects; a label of numbers only is unchanged."""
    end = len(words.rstrip(" )]"))
    if not words[:end][-1:].isdecimal():
        return words
    while end and (words[end - 1].isdecimal() or words[end - 1] in _AROUND_NUMBERS):
        end -= 1
    return words[:end] or words
