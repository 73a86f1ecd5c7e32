"""Measure detectors on photographs: `python -m training.segments.evaluate_photographs FOLDER --model FILE ...`.

FOLDER holds rgb/, depth/ and labels13/ of NYU Depth v2, each view lifted to a partial panorama with its depth. Prints,
for `segments` with each network and for `panoseg`: pixels, objects at three scores, the calibration and its curve; and
the pixels of one network by other views. docs/photographs.json is what `--json` printed, of which
docs/how-to/segments.md has its figures.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from salframe_panoseg.detector import PanoSegDetector
from salframe_segments.detector import SegmentsDetector

from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.config import merge, nest, parse_override
from salframe.framework.errors import SalframeError
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.panoramas.geometry import rays_to_pixels
from salframe.panoramas.panorama import Panorama
from training.segments.calibration import brier, curve, fit, interval, left_out_scores, logit
from training.segments.measures import (
    ROWS,
    Counts,
    Objects,
    accuracy,
    confusion,
    count,
    lay_objects,
    mean_iou,
    one_structure,
    parts_of,
)
from training.segments.photographs import View, read_views
from training.segments.thirteen import CLASSES, class_of

SCORES = (0.3, 0.5, 0.7)
DIGITS = 5
"""Figures are printed as JSON to so many decimals."""
TURNS_DEG = (0.0, 30.0)
"""How the photograph lies to the views when pixels are counted, both together: in the middle of one of six, and between
two."""
VIEWS = ((3, 120, 512), (4, 100, 512), (6, 90, 512), (6, 75, 512), (8, 75, 512), (6, 90, 1024))
"""What `--views` tries: how many views a panorama, how many degrees each, and rows of the panorama."""


@dataclass(frozen=True, eq=False)
class Seen:
    """What a detector made of a view: the confusion of its pixels, its objects, and the parts of the labels."""

    pixels: np.ndarray
    objects: Objects
    parts: tuple[np.ndarray, np.ndarray]


def main(
    folder: Annotated[Path, typer.Argument(help="the views: rgb/, depth/, labels13/")],
    model: Annotated[list[Path] | None, typer.Option(help="a network for `segments`; repeatable")] = None,
    height: Annotated[int, typer.Option(help="rows of the partial panoramas")] = 512,
    by_views: Annotated[Path | None, typer.Option("--views", help="a network to try with other views too")] = None,
    overrides: Annotated[list[str] | None, typer.Option("--set", help="key=value, a setting of `segments`")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="all figures as JSON")] = False,
) -> None:
    """Measure `segments` with each network, and `panoseg`."""
    settings: dict[str, Any] = {"min_score": 0.0}
    for text in overrides or []:
        settings = merge(settings, nest(*parse_override(text)))
    try:
        views = list(read_views(folder))
        figures = {}
        for path in model or []:
            config = configure("detector", "segments", {"model": str(path), **settings})
            figures[path.name] = measure(registry().build("detector", config), views, height)
        figures["panoseg"] = measure(PanoSegDetector(), views, height)
        if by_views is not None:
            figures["views"] = measure_views(by_views, views, settings)
    except SalframeError as error:
        raise SystemExit(f"error: {error}") from None
    if not as_json:
        show(figures)
        return
    short = json.loads(json.dumps(figures), parse_float=lambda text: round(float(text), DIGITS))
    print(json.dumps(short, indent=1))


def measure_views(model: Path, views: Sequence[View], settings: dict[str, Any]) -> dict[str, Any]:
    """The pixels of `segments` with a network by VIEWS."""
    found = {}
    for number, fov_deg, height in VIEWS:
        config = configure(
            "detector", "segments", {**settings, "model": str(model), "views": number, "fov_deg": fov_deg}
        )
        detector = registry().build("detector", config)
        pixels = np.sum([look(detector, view, view.panorama(height)).pixels for view in views], 0)
        found[f"{number} of {fov_deg} deg, {height} rows"] = {
            "accuracy": accuracy(pixels),
            "mean_iou": mean_iou(pixels),
        }
    return found


def measure(detector: Detector, views: Sequence[View], height: int) -> dict[str, Any]:
    """All figures of a detector."""
    seen = [look(detector, view, view.panorama(height)) for view in views]
    pixels = np.sum([one.pixels for one in seen], 0)
    named = [one.objects.named for one in seen]
    figures: dict[str, Any] = {}
    if isinstance(detector, SegmentsDetector):
        figures["pixels"] = {"accuracy": accuracy(pixels), "mean_iou": mean_iou(pixels)}
        slope, offset = detector.calibration.slope, detector.calibration.offset
        plain = [1 / (1 + np.exp((offset - logit(one.objects.score)) / slope)) for one in seen]
        scores = left_out_scores(plain, named)
        figures["calibration"] = {
            "fit": fit(np.concatenate(plain), np.concatenate(named)),
            "brier_plain": brier(plain, named),
            "brier_left_out": brier(scores, named),
            "curve_plain": curve(plain, named),
            "curve_left_out": curve(scores, named),
        }
    figures["pixels_one_structure"] = {
        "accuracy": accuracy(one_structure(pixels)),
        "mean_iou": mean_iou(one_structure(pixels)),
    }
    figures["curve"] = curve([one.objects.score for one in seen], named)
    figures["objects"] = {
        str(score): shares([count(one.objects, one.parts, score) for one in seen]) for score in SCORES
    }
    return figures


def look(detector: Detector, view: View, panorama: Panorama) -> Seen:
    """What a detector makes of a view."""
    found = detector.detect(panorama)
    if isinstance(detector, SegmentsDetector):
        answers = [class_pixels(detector, panorama, turn_deg) for turn_deg in TURNS_DEG]
    else:
        answers = [class_image(found)]
    pixels = np.sum([confusion(view.labels, view.camera.see(answer)) for answer in answers], 0)
    laid = view.camera.lay_on_sphere(view.labels, ROWS, smooth=False)
    return Seen(pixels, lay_objects(found, laid), parts_of(laid))


def class_pixels(detector: SegmentsDetector, panorama: Panorama, turn_deg: float) -> np.ndarray:
    """(ROWS, 2 ROWS) int: the class of each pixel, as the detector's views show it with the panorama turned."""
    columns = 2 * round(turn_deg * ROWS / 360)
    wide = columns * len(panorama.valid) // ROWS
    turned = replace(
        panorama, **{name: np.roll(getattr(panorama, name), wide, 1) for name in ("rgb", "range_m", "valid")}
    )
    pixels = detector.classify(turned)
    classes = np.array([CLASSES.index(class_of(name)) if name else 0 for name in pixels.names])
    return np.roll(classes[pixels.class_id], -columns, 1)


def class_image(found: Detections) -> np.ndarray:
    """(ROWS, 2 ROWS) int: the class of the object whose points lie there, the best of several; elsewhere wall."""
    answer = np.full((ROWS, 2 * ROWS), CLASSES.index("wall"))
    for i in np.argsort(found.scores, kind="stable"):
        column, row = rays_to_pixels((found.points_m or ())[i], ROWS)
        answer[np.minimum(row.astype(int), ROWS - 1), column.astype(int) % (2 * ROWS)] = CLASSES.index(
            class_of(found.labels[i])
        )
    return answer


def shares(counts: Sequence[Counts]) -> dict[str, Any]:
    """Precision and recall, each with its 95 % interval by a bootstrap over views."""
    total = sum(counts[1:], counts[0])
    figures: dict[str, Any] = dict(vars(total))
    for what, right, number in (
        ("named_precision", "named", "detected"),
        ("covered_recall", "covered", "parts"),
        ("precision", "found", "detected"),
        ("recall", "found", "parts"),
    ):
        own, of = (np.array([getattr(one, name) for one in counts]) for name in (right, number))
        figures[what] = [float(own.sum() / of.sum()), *interval(own, of)] if of.sum() else None
    return figures


def show(figures: dict[str, Any]) -> None:
    """A few lines a detector."""
    for name, one in figures.pop("views", {}).items():
        print(f"{name}: accuracy {one['accuracy']:.3f}, mean IoU {one['mean_iou']:.3f}")
    for name, one in figures.items():
        print(f"\n{name}")
        for key in ("pixels", "pixels_one_structure"):
            if key in one:
                print(f"  {key}: accuracy {one[key]['accuracy']:.3f}, mean IoU {one[key]['mean_iou']:.3f}")
        for score, row in one["objects"].items():
            print(
                f"  score >= {score}: {row['detected']} objects, {row['parts']} parts;",
                ", ".join(
                    f"{key} {row[key][0]:.3f} ({row[key][1]:.2f} to {row[key][2]:.2f})"
                    for key in ("named_precision", "covered_recall", "precision", "recall")
                    if row[key]
                ),
            )
        if "calibration" in one:
            own = one["calibration"]
            print(
                f"  logistic fit: slope {own['fit'][0]:.2f}, offset {own['fit'][1]:.2f};",
                f"Brier {own['brier_plain']:.3f} plain, {own['brier_left_out']:.3f} left out",
            )
            _show_curve("plain", own["curve_plain"])
            _show_curve("left out", own["curve_left_out"])
        _show_curve("as it scores", one["curve"])


def _show_curve(what: str, rows: list[dict[str, float]]) -> None:
    print(
        f"  {what}:",
        "; ".join(
            f"{row['score']:.2f} -> {row['named']:.2f} ({row['low']:.2f} to {row['high']:.2f}, {row['objects']})"
            for row in rows
        ),
    )


if __name__ == "__main__":
    typer.run(main)
