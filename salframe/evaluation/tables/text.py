"""Numbers and lists of names as text."""

from __future__ import annotations

import math
from collections.abc import Collection

from salframe.evaluation.statistics import Estimate

NONE = "-"
"""Text of an unknown number."""
UNITS = ("B", "kB", "MB", "GB")


def percent(share: float | None) -> str:
    """Return a share as percent with one decimal."""
    return NONE if share is None else f"{share * 100:.1f}"


def fixed(value: float | None, digits: int) -> str:
    """Return a number with this number of decimals."""
    return NONE if value is None else f"{value:.{digits}f}"


def interval(share: Estimate | None) -> str:
    """Return a share and its interval as percent. Without bounds, return the share alone."""
    if share is None or share.low is None or share.high is None:
        return percent(None if share is None else share.value)
    return f"{share.value * 100:.1f} ({share.low * 100:.0f}-{share.high * 100:.0f})"


def format_bytes(size: float | None) -> str:
    """Return a number of bytes in decimal units."""
    if size is None:
        return NONE
    power = min(int(math.log(max(size, 1), 1000)), 3)
    value = size / 1000**power
    return f"{value:.1f} {UNITS[power]}" if power and value < 10 else f"{value:.0f} {UNITS[power]}"


def two_digits(value: float | None) -> str:
    """Return a number with two significant digits and all digits before the point."""
    return NONE if value is None else f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def list_methods(labels: Collection[str], of: Collection[str]) -> str:
    """Return labels of methods as text. If `labels` contains all labels in `of`, and these are more than three, the
    text is "all N methods"."""
    return f"all {len(labels)} methods" if len(labels) == len(of) > 3 else ", ".join(labels)
