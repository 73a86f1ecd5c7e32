"""Draw the tables of docs/how-to/segments.md from docs/photographs.json, which `python -m
training.segments.evaluate_photographs --json` prints. Run it after that.

A line `<!-- photographs: NAME -->` is followed by a table, up to the line `<!-- drawn -->`; all else is written by
hand.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parent / "how-to" / "segments.md"
PRINTED = Path(__file__).with_name("photographs.json")
BLOCK = re.compile(r"(<!-- photographs: (\w+) -->\n).*?(<!-- drawn -->\n)", re.DOTALL)
ADE20K = "lite-model_deeplabv3-mobilenetv2-ade20k_1_default_1.tflite"
DETECTORS = {
    "`segments`, `ade20k`": ADE20K,
    "the same in ONNX": "deeplabv3_mnv2_ade20k_151.onnx",
    "`segments`, MLCommons' 32 classes": "deeplabv3_mnv2_ade20k_uint8.tflite",
    "`panoseg`": "panoseg",
}
SHARES = ("named_precision", "covered_recall", "precision", "recall")

Rows = Iterator[Sequence[str]]


def percent(share: float) -> str:
    return f"{share * 100:.1f}"


def pixels(printed: dict[str, Any]) -> Rows:
    one_class = "wall, floor, ceiling as one"
    yield "pixels", "correct %", "mean IoU %", f"{one_class}: correct %", f"{one_class}: mean IoU %"
    for name, key in DETECTORS.items():
        parts = (printed[key].get(part) for part in ("pixels", "pixels_one_structure"))
        shares = (part and (part["accuracy"], part["mean_iou"]) for part in parts)
        yield name, *(text for part in shares for text in (map(percent, part) if part else ("-", "-")))


def objects(printed: dict[str, Any]) -> Rows:
    yield "objects", "score", "number", "correctly labelled %", "true regions covered %", "precision %", "recall %"
    for name, key in DETECTORS.items():
        for score, row in printed[key]["objects"].items():
            yield name, f"{score} and more", str(row["detected"]), *(_share(row[share]) for share in SHARES)


def scores(printed: dict[str, Any]) -> Rows:
    yield "mean score", "objects", "correctly labelled %"
    for row in printed[ADE20K]["curve"]:
        yield f"{row['score']:.2f}", str(row["objects"]), _share([row["named"], row["low"], row["high"]])


def views(printed: dict[str, Any]) -> Rows:
    yield "views per panorama", "correct %", "mean IoU %"
    for name, row in printed["views"].items():
        yield name, percent(row["accuracy"]), percent(row["mean_iou"])


def _share(interval: Sequence[float] | None) -> str:
    if interval is None:
        return "-"
    share, low, high = interval
    return f"{percent(share)} ({low * 100:.0f} to {high * 100:.0f})"


DRAWN = {draw.__name__: draw for draw in (pixels, objects, scores, views)}


def page(text: str) -> str:
    """Return the page with its tables redrawn."""
    printed = json.loads(PRINTED.read_text(encoding="utf-8"))

    def draw(match: re.Match[str]) -> str:
        header, *rows = DRAWN[match[2]](printed)
        lines = [f"| {' | '.join(row)} |" for row in (header, ("---",) * len(header), *rows)]
        return f"{match[1]}\n" + "\n".join(lines) + f"\n\n{match[3]}"

    return BLOCK.sub(draw, text)


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
