"""Measure detectors on photographs: `python -m training.segments.evaluate_photographs FOLDER --model FILE ...`.

FOLDER holds rgb/, depth/ and labels13/ of NYU Depth v2. Each view is converted to a partial panorama with its depth.
The command prints pixel metrics, object metrics at three score thresholds, and the calibration with its curve, for
`segments` with each network and for `panoseg`; and optionally the pixel metrics of one network with other views.
docs/photographs.json is the output of `--json`, and the source of the metrics in docs/how-to/segments.md.
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
from salframe.framework.config import merge, parse_override
from salframe.framework.errors import SalframeError
from salframe.framework.overrides import nest
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.panoramas.geometry import rays_to_pixels
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.photograph import lay_on_sphere, see_panorama
from training.segments.calibration import brier, curve, fit, interval, left_out_scores, undo
from training.segments.measures import (
    ROWS,
    ObjectCounts,
    Objects,
    accuracy,
    confusion,
    count,
    lay_objects,
    mean_iou,
    one_structure,
    regions_of,
)
from training.segments.photographs import LabelledPhotograph, read_views
from training.segments.thirteen import CLASSES, class_of

SCORES = (0.3, 0.5, 0.7)
DIGITS = 5
"""Number of decimals in the JSON output."""
TURNS_DEG = (0.0, 30.0)
"""Rotations of the panorama for pixel metrics, which are summed over both rotations. With six views, the photograph is
in the middle of a view at 0 degrees, and between two views at 30 degrees."""
VIEWS = ((3, 120, 512), (4, 100, 512), (6, 90, 512), (6, 75, 512), (8, 75, 512), (6, 90, 1024))
"""Configurations of `--views`: views per panorama, field of view in degrees, and height of the panorama."""


@dataclass(frozen=True, eq=False)
class ViewResult:
    """Result of a detector on a view: pixel confusion matrix, objects, and labelled regions."""

    pixels: np.ndarray
    objects: Objects
    regions: tuple[np.ndarray, np.ndarray]


def main(
    folder: Annotated[Path, typer.Argument(help="Folder with rgb/, depth/ and labels13/.")],
    model: Annotated[list[Path] | None, typer.Option(help="Network for `segments` (repeatable).")] = None,
    height: Annotated[int, typer.Option(help="Height of the partial panoramas in pixels.")] = 512,
    by_views: Annotated[Path | None, typer.Option("--views", help="Network to evaluate with other views.")] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", help="Override a setting of `segments`, as key=value.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all metrics as JSON.")] = False,
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
    rounded = json.loads(json.dumps(figures), parse_float=lambda text: round(float(text), DIGITS))
    print(json.dumps(rounded, indent=1))


def measure_views(model: Path, views: Sequence[LabelledPhotograph], settings: dict[str, Any]) -> dict[str, Any]:
    """Return the pixel metrics of `segments` with a network for each configuration of VIEWS."""
    metrics = {}
    for number, fov_deg, height in VIEWS:
        config = configure(
            "detector", "segments", {**settings, "model": str(model), "views": number, "fov_deg": fov_deg}
        )
        detector = registry().build("detector", config)
        pixels = np.sum([evaluate_view(detector, view, view.panorama(height)).pixels for view in views], 0)
        metrics[f"{number} of {fov_deg} deg, {height} rows"] = {
            "accuracy": accuracy(pixels),
            "mean_iou": mean_iou(pixels),
        }
    return metrics


def measure(detector: Detector, views: Sequence[LabelledPhotograph], height: int) -> dict[str, Any]:
    """Run a detector on photographs, and return its metrics by name."""
    results = [evaluate_view(detector, view, view.panorama(height)) for view in views]
    pixels = np.sum([result.pixels for result in results], 0)
    named = [result.objects.named for result in results]
    figures: dict[str, Any] = {}
    if isinstance(detector, SegmentsDetector):
        figures["pixels"] = {"accuracy": accuracy(pixels), "mean_iou": mean_iou(pixels)}
        slope, offset = detector.calibration.slope, detector.calibration.offset
        plain = [undo(result.objects.score, slope, offset) for result in results]
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
    figures["curve"] = curve([result.objects.score for result in results], named)
    figures["objects"] = {
        str(score): shares([count(result.objects, result.regions, score) for result in results]) for score in SCORES
    }
    return figures


def evaluate_view(detector: Detector, view: LabelledPhotograph, panorama: Panorama) -> ViewResult:
    """Run a detector on the panorama of a photograph, and compare the result with the labels."""
    detections = detector.detect(panorama)
    if isinstance(detector, SegmentsDetector):
        answers = [class_pixels(detector, panorama, turn_deg) for turn_deg in TURNS_DEG]
    else:
        answers = [class_image(detections)]
    pixels = np.sum([confusion(view.labels, see_panorama(view.camera, answer)) for answer in answers], 0)
    laid = lay_on_sphere(view.camera, view.labels, ROWS, smooth=False)
    return ViewResult(pixels, lay_objects(detections, laid), regions_of(laid))


def class_pixels(detector: SegmentsDetector, panorama: Panorama, turn_deg: float) -> np.ndarray:
    """Run the detector on the rotated panorama. Return the (ROWS, 2 ROWS) int class of each pixel, rotated back."""
    columns = 2 * round(turn_deg * ROWS / 360)
    shift = columns * len(panorama.valid) // ROWS
    turned = replace(
        panorama, **{name: np.roll(getattr(panorama, name), shift, 1) for name in ("rgb", "range_m", "valid")}
    )
    pixels = detector.classify(turned)
    classes = np.array([CLASSES.index(class_of(name)) if name else 0 for name in pixels.names])
    return np.roll(classes[pixels.class_id], -columns, 1)


def class_image(detections: Detections) -> np.ndarray:
    """Return the class at each pixel, (ROWS, 2 ROWS) int: that of the object with the highest score there, or wall if
    there is no object."""
    answer = np.full((ROWS, 2 * ROWS), CLASSES.index("wall"))
    for i in np.argsort(detections.scores, kind="stable"):
        column, row = rays_to_pixels((detections.points_m or ())[i], ROWS)
        answer[np.minimum(row.astype(int), ROWS - 1), column.astype(int) % (2 * ROWS)] = CLASSES.index(
            class_of(detections.labels[i])
        )
    return answer


def shares(counts: Sequence[ObjectCounts]) -> dict[str, Any]:
    """Return precision and recall, each with its 95 % CI by a bootstrap over views."""
    total = sum(counts[1:], counts[0])
    figures: dict[str, Any] = dict(vars(total))
    for metric, numerator, denominator in (
        ("named_precision", "named", "detected"),
        ("covered_recall", "covered", "regions"),
        ("precision", "true_positives", "detected"),
        ("recall", "true_positives", "regions"),
    ):
        part, whole = (np.array([getattr(view, name) for view in counts]) for name in (numerator, denominator))
        figures[metric] = [float(part.sum() / whole.sum()), *interval(part, whole)] if whole.sum() else None
    return figures


def show(figures: dict[str, Any]) -> None:
    """Print the metrics in a few lines per detector."""
    for name, metrics in figures.pop("views", {}).items():
        print(f"{name}: accuracy {metrics['accuracy']:.3f}, mean IoU {metrics['mean_iou']:.3f}")
    for name, metrics in figures.items():
        print(f"\n{name}")
        for key in ("pixels", "pixels_one_structure"):
            if key in metrics:
                print(f"  {key}: accuracy {metrics[key]['accuracy']:.3f}, mean IoU {metrics[key]['mean_iou']:.3f}")
        for score, row in metrics["objects"].items():
            print(
                f"  score >= {score}: {row['detected']} objects, {row['regions']} labelled regions;",
                ", ".join(
                    f"{key} {row[key][0]:.3f} ({row[key][1]:.2f} to {row[key][2]:.2f})"
                    for key in ("named_precision", "covered_recall", "precision", "recall")
                    if row[key]
                ),
            )
        if "calibration" in metrics:
            calibration = metrics["calibration"]
            print(
                f"  logistic fit: slope {calibration['fit'][0]:.2f}, offset {calibration['fit'][1]:.2f};",
                f"Brier score {calibration['brier_plain']:.3f} uncalibrated,",
                f"{calibration['brier_left_out']:.3f} calibrated on the other views",
            )
            _show_curve("uncalibrated", calibration["curve_plain"])
            _show_curve("calibrated on the other views", calibration["curve_left_out"])
        _show_curve("scores of the detector", metrics["curve"])


def _show_curve(name: str, rows: list[dict[str, float]]) -> None:
    print(
        f"  {name}:",
        "; ".join(
            f"mean score {row['score']:.2f}: share correct {row['named']:.2f} "
            f"({row['low']:.2f} to {row['high']:.2f}), {row['objects']} objects"
            for row in rows
        ),
    )


if __name__ == "__main__":
    typer.run(main)
