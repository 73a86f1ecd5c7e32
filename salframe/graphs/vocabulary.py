"""Names of objects that detectors share, whatever data they were trained on."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from salframe.framework.config import read_yaml

NAMES = Path(__file__).with_name("vocabulary.yaml")
"""Each name with its aliases."""


def common_label(label: str) -> str:
    """The name in the shared vocabulary of what a detector or a data set calls `label`; a label that the vocabulary
    does not know stays as it is."""
    return _aliases().get(label.strip().lower(), label)


@cache
def _aliases() -> dict[str, str]:
    """Name or alias -> name."""
    names = read_yaml(NAMES)
    return {alias: name for name, aliases in names.items() for alias in (name, *aliases)}
