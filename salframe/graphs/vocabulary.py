"""A common vocabulary of object names for detectors that were trained on different datasets."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from salframe.framework.config import read_yaml

NAMES = Path(__file__).with_name("vocabulary.yaml")
"""YAML file that lists the aliases of each name."""


def common_label(label: str) -> str:
    """Return the name in the common vocabulary for a label of a detector or dataset; a label that is not in the
    vocabulary is returned unchanged."""
    return _aliases().get(label.strip().lower(), label)


@cache
def _aliases() -> dict[str, str]:
    """Return the name for each name and alias."""
    names = read_yaml(NAMES)
    return {alias: name for name, aliases in names.items() for alias in (name, *aliases)}
