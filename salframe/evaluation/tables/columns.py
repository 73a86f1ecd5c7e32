"""The columns of results: one list a task, and how a row's numbers become text."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

NONE = "-"
"""In the place of a number that there is not."""
UNITS = ("B", "kB", "MB", "GB")


@dataclass(frozen=True)
class Column:
    """A column: its heading, the text of a row's cell, and the number by which the largest (`largest`) or the least is
    best, None where no row is. `cost`: what a method costs rather than reaches."""

    heading: str
    cell: Callable[[Any], str]
    value: Callable[[Any], float | None] | None = None
    largest: bool = True
    cost: bool = False


def percent(share: float | None) -> str:
    """A share as percent to one decimal."""
    return NONE if share is None else f"{share * 100:.1f}"


def fixed(value: float | None, digits: int) -> str:
    """A number with so many decimals."""
    return NONE if value is None else f"{value:.{digits}f}"


def interval(share: float | None, low: float | None, high: float | None) -> str:
    """A share and its interval as percent."""
    if share is None or low is None or high is None:
        return NONE
    return f"{share * 100:.1f} ({low * 100:.0f}-{high * 100:.0f})"


def format_bytes(size: float | None) -> str:
    """A number of bytes in decimal units."""
    if size is None:
        return NONE
    power = min(int(math.log(max(size, 1), 1000)), 3)
    value = size / 1000**power
    return f"{value:.1f} {UNITS[power]}" if power and value < 10 else f"{value:.0f} {UNITS[power]}"


def two_digits(value: float | None) -> str:
    """Two significant digits, all of those before the point."""
    return NONE if value is None else f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _given(row: Any) -> str:
    return ", ".join(row.given).replace("rgb", "colour") or NONE


def _pose(row: Any) -> str:
    if row.median_translation_m is not None and row.median_rotation_deg is not None:
        turn_deg = row.median_rotation_deg
        return f"{row.median_translation_m:.2f} m {turn_deg:.{1 if turn_deg < 10 else 0}f}°"
    return NONE if row.median_heading_deg is None else f"{row.median_heading_deg:.1f}°"


def _within(row: Any) -> str:
    recalls = (row.recall_025m_2deg, row.recall_05m_5deg, row.recall_1m_10deg)
    return "/".join(f"{recall * 100:.0f}" for recall in recalls if recall is not None) or NONE


def _precision_at(row: Any) -> str:
    shares = ("" if share is None else f"{share * 100:.0f}" for share in row.precision_at or ())
    return "/".join(share or NONE for share in shares) or NONE


def _spread(shares: Sequence[float]) -> str:
    return f"{min(shares) * 100:.0f}-{max(shares) * 100:.0f}" if shares else NONE


def _p(row: Any) -> str:
    return "" if row.p_adjusted is None else f"{row.p_adjusted:.2g}"


def _share(heading: str, name: str, largest: bool = True) -> Column:
    return Column(heading, lambda row: percent(getattr(row, name)), lambda row: getattr(row, name), largest)


def _rate(heading: str, name: str) -> Column:
    names = (name, f"{name}_low", f"{name}_high")
    return Column(heading, lambda row: interval(*(getattr(row, key) for key in names)), lambda row: getattr(row, name))


def _area(heading: str, name: str) -> Column:
    def cell(row: Any) -> str:
        area, low, high = (getattr(row, key) for key in (name, f"{name}_low", f"{name}_high"))
        return fixed(area, 3) if low is None or high is None else f"{area:.3f} ({low:.2f}-{high:.2f})"

    return Column(heading, cell, lambda row: getattr(row, name))


def _number(heading: str, name: str, digits: int) -> Column:
    return Column(heading, lambda row: fixed(getattr(row, name), digits))


def _count(heading: str, name: str) -> Column:
    return Column(heading, lambda row: str(getattr(row, name)))


def _overall(heading: str, name: str) -> Column:
    return Column(heading, lambda row: str(getattr(row.overall, name, NONE)))


def _overall_rate(heading: str, name: str) -> Column:
    def cell(row: Any) -> str:
        return interval(getattr(row.overall, name, None), getattr(row, f"{name}_low"), getattr(row, f"{name}_high"))

    return Column(heading, cell, lambda row: getattr(row.overall, name, None))


GIVEN = Column("given", _given)
SEEDS = Column("of each\nseed %", lambda row: _spread(row.by_part))
P = Column("p\n(Holm)", _p)

COLUMNS: dict[str, dict[str, Column]] = {
    "localization": {
        "given": GIVEN,
        "accuracy": _rate("accuracy %\n(95 %)", "accuracy"),
        "seeds": SEEDS,
        "scenes": _share("scenes\nonly %", "scene_accuracy"),
        "macro_precision": _share("macro\nprecision %", "macro_precision"),
        "macro_recall": _share("macro\nrecall %", "macro_recall"),
        "room_type": _rate("room type %\n(95 %)", "room_type_accuracy"),
        "recall_at_2": _share("R@2\n%", "recall_at_2"),
        "recall_at_5": _share("R@5\n%", "recall_at_5"),
        "pose": Column("median\npose error", _pose),
        "heading": _number("median\nheading error deg", "median_heading_deg", 1),
        "within": Column("pose within\n.25/.5/1 m %", _within),
        "present_accuracy": _rate("in the map:\nright % (95 %)", "present_accuracy"),
        "present_scenes": _share("scenes\nonly %", "present_scene_accuracy"),
        "denied_absent": _rate("not in it:\ndenied % (95 %)", "denied_absent"),
        "precision_at": Column("precision % at\nrecall 50/75/90 %", _precision_at),
        "average_precision": _area("average\nprecision", "average_precision"),
        "roc_area": _area("ROC\narea", "roc_area"),
        "accepted_absent": _share("not in it: accepted %\nat 90 % of right kept", "accepted_absent", largest=False),
        "calibration_error": Column(
            "calibration\nerror", lambda row: fixed(row.calibration_error, 3), lambda row: row.calibration_error, False
        ),
        "bytes": Column("bytes\n/scene", lambda row: format_bytes(row.bytes_per_scene), cost=True),
        "describe": Column("describe\nms", lambda row: two_digits(row.describe_ms), cost=True),
        "query": Column("query\nms", lambda row: two_digits(row.query_ms), cost=True),
        "memory": Column("memory\nMB", lambda row: fixed(row.peak_memory_mb, 0), cost=True),
        "p": P,
    },
    "matching": {
        "given": GIVEN,
        "mma_1": _rate("MMA@1 %\n(95 %)", "mma_1"),
        "mma_3": _rate("MMA@3 %\n(95 %)", "mma_3"),
        "mma_5": _rate("MMA@5 %\n(95 %)", "mma_5"),
        "precision": _rate("precision %\n(95 %)", "precision"),
        "recall": _rate("recall %\n(95 %)", "recall"),
        "matches": _number("matches\na pair", "matches_per_pair", 1),
        "true": _number("true\na pair", "true_per_pair", 1),
        "unmatched": _count("pairs without\na match", "pairs_without_match"),
        "pairs": _count("pairs", "pairs"),
    },
    "detection": {
        "given": GIVEN,
        "precision": _overall_rate("precision %\n(95 %)", "precision"),
        "recall": _overall_rate("recall %\n(95 %)", "recall"),
        "annotated": _overall("annotated", "annotated"),
        "found": _overall("found", "found"),
        "right": _overall("right", "right"),
        "ms": Column("ms", lambda row: fixed(row.ms, 0), cost=True),
    },
    "sensor": {
        "given": GIVEN,
        "found": _rate("found %\n(95 %)", "found"),
        "right": _rate("found by the\nright name %", "right"),
        "false": _number("false objects\na panorama", "false_per_panorama", 1),
        "bearing": Column("bearing\ndeg", lambda row: fixed(math.degrees(row.bearing_rad), 2)),
        "range": Column("range\n%", lambda row: percent(row.range_share)),
        "size": Column("size\n%", lambda row: fixed(row.size_log * 100, 0)),
        "height": Column("height\ncm", lambda row: fixed(row.height_m * 100, 1)),
        "objects": _count("objects", "objects"),
        "panoramas": _count("panoramas", "panoramas"),
    },
    "navigation": {
        "given": GIVEN,
        "success": _rate("SR %\n(95 %)", "success_rate"),
        "seeds": SEEDS,
        "oracle": _share("oracle\nSR %", "oracle_success_rate"),
        "spl": _rate("SPL %\n(95 %)", "spl"),
        "success_1m": _share("SR within\n1 m %", "success_rate_1m"),
        "success_3m": _share("SR within\n3 m %", "success_rate_3m"),
        "path": _number("path\nm", "path_m", 1),
        "panoramas": _number("panoramas", "panoramas", 1),
        "collisions": _number("collisions", "collisions", 1),
        "p": P,
    },
    "scale": {
        "given": GIVEN,
        "build": Column("build\ns", lambda row: two_digits(row.build_s), cost=True),
        "memory": Column("building\nMB", lambda row: fixed(row.build_memory_mb, 0), cost=True),
        "bytes": Column("bytes\n/scene", lambda row: format_bytes(row.bytes_per_scene), cost=True),
        "open": Column("open\ns", lambda row: two_digits(row.open_s), cost=True),
        "median": Column("query\nmedian ms", lambda row: two_digits(row.query_median_ms), cost=True),
        "p95": Column("query\np95 ms", lambda row: two_digits(row.query_p95_ms), cost=True),
        "recall": _rate("R@1 %\n(95 %)", "recall_at_1"),
        "recall_both": _rate("R@1 %\nof the first 50", "recall_at_1_both"),
        "exhaustive": _rate("these by matching\nall scenes: R@1 %", "recall_at_1_exhaustive"),
    },
    "running": {
        "given": GIVEN,
        "scenes": _count("scenes", "scenes"),
        "bytes": Column("bytes\n/scene", lambda row: format_bytes(row.bytes_per_scene), cost=True),
        "open": Column("open\nms", lambda row: two_digits(row.open_s * 1e3), cost=True),
        "opened": Column("opened\nMB", lambda row: fixed(row.opened_mb, 0), cost=True),
        "first": Column("first\nms", lambda row: two_digits(row.first_ms), cost=True),
        "asked": Column("asked\nMB", lambda row: fixed(row.asked_mb, 0), cost=True),
        "describe": Column("describe\nms", lambda row: two_digits(row.describe_ms), cost=True),
        "median": Column("query\nmedian ms", lambda row: two_digits(row.query_median_ms), cost=True),
        "p95": Column("query\np95 ms", lambda row: two_digits(row.query_p95_ms), cost=True),
    },
}
"""The columns of each task by name."""

_REACHED = ("given", "accuracy", "seeds", "scenes", "recall_at_5", "pose", "within")
USUAL: dict[str, Sequence[str]] = {
    "localization": (*_REACHED, "bytes", "describe", "query", "p"),
    "points": ("given", "mma_1", "mma_3", "mma_5", "matches", "unmatched", "pairs"),
    "nodes": ("given", "precision", "recall", "matches", "true", "pairs"),
    "detection": tuple(COLUMNS["detection"]),
    "sensor": tuple(COLUMNS["sensor"]),
    "navigation": tuple(COLUMNS["navigation"]),
    "scale": tuple(COLUMNS["scale"]),
    "running": tuple(COLUMNS["running"]),
}
"""The columns that are shown unless others are asked for; matching has those of points and those of nodes."""
WORTH = [
    "present_accuracy",
    "present_scenes",
    "denied_absent",
    "precision_at",
    "average_precision",
    "roc_area",
    "accepted_absent",
    "calibration_error",
]
"""Those of a second table, where queries are asked of a map without their place."""
