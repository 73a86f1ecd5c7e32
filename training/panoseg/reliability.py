"""Reliability of the scores of `panoseg`: `python -m training.panoseg.reliability --fit 100,101 --seeds 200,201`.

The command runs the detector on rendered offices, and compares the score of each object with the share of correct
objects. It fits the calibration of the model card in the offices of `--fit`, and prints the reliability with and
without this calibration in the offices of `--seeds`. The page docs/how-to/panoseg.md reports the results.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from salframe_panoseg.detector import PanoSegDetector

from salframe.evaluation.tasks.detection.judging import is_right
from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.errors import SalframeError
from salframe.graphs.detections import Detections
from salframe.graphs.vocabulary import common_label
from salframe.localization.preparing import prepare
from training.segments.calibration import apply, brier, curve, fit, undo

MIN_PROBABILITY = 0.25
"""Minimum mean class probability of the objects that are counted."""
BINS = 10
"""Number of bins of the calibration error, of equal width."""


def calibration_error(scores: np.ndarray, right: np.ndarray) -> float:
    """Return the expected calibration error of scores (n,), in BINS bins."""
    of_bin = np.minimum((scores * BINS).astype(int), BINS - 1)
    gaps = [abs(scores[of_bin == bin].sum() - right[of_bin == bin].sum()) for bin in range(BINS)]
    return float(sum(gaps) / len(scores))


def with_common_labels(detections: Detections) -> Detections:
    """Return the detections with the common name of each label."""
    return replace(detections, labels=tuple(common_label(label) for label in detections.labels))


def run(detector: PanoSegDetector, data: str, seeds: str) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the uncalibrated score and the correctness of each object, for each query of the offices."""
    annotations = registry().build("detector", configure("detector", "annotations", {"noise": "none"}))
    slope, offset = detector.calibration.slope, detector.calibration.offset
    plain, right = [], []
    for seed in seeds.split(","):
        _, dataset, _ = prepare(data, "proposed", None, [f"data.seed={seed}"], None, None, print)
        for query in dataset.folds()[0].queries:
            panorama = query.load()
            detections = with_common_labels(detector.detect(panorama))
            probability = undo(detections.scores, slope, offset)
            counted = probability >= MIN_PROBABILITY
            plain.append(probability[counted])
            right.append(is_right(detections, with_common_labels(annotations.detect(panorama)))[counted])
    return plain, right


def main(
    fit_seeds: Annotated[str, typer.Option("--fit", help="Seeds of the offices to fit in, separated by commas")],
    seeds: Annotated[str, typer.Option(help="Seeds of the offices to evaluate in, separated by commas")],
    data: Annotated[str, typer.Option(help="Dataset: a preset of rendered buildings")] = "house-42",
    model: Annotated[Path | None, typer.Option(help="Folder of your own network (default: the shipped one)")] = None,
) -> None:
    """Fit the calibration of `panoseg` and print its reliability."""
    try:
        detector = PanoSegDetector(configure("detector", "panoseg", {"model": model, "min_score": 0.0}))
        plain, right = run(detector, data, fit_seeds)
        slope, offset = fit(np.concatenate(plain), np.concatenate(right))
        print(f"calibration: slope {slope:.2f}, offset {offset:.2f} ({sum(map(len, plain))} objects)")
        plain, right = run(detector, data, seeds)
    except SalframeError as error:
        raise SystemExit(f"error: {error}") from None
    for name, scores in (("without", plain), ("with", [apply(of_query, slope, offset) for of_query in plain])):
        gap = calibration_error(np.concatenate(scores), np.concatenate(right))
        print(f"{name} calibration: calibration error {gap * 100:.1f} %, Brier score {brier(scores, right):.3f}")
        for row in curve(scores, right):
            interval = f"{row['low'] * 100:.0f} to {row['high'] * 100:.0f} %"
            print(
                f"  mean score {row['score'] * 100:.0f} %: {row['named'] * 100:.0f} % correct ({interval}), "
                f"{row['objects']} objects"
            )


if __name__ == "__main__":
    typer.run(main)
