"""The calibration of a map in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from salframe.localization.calibration import MapCalibration


def describe_calibration(calibration: MapCalibration | None, has_other: bool = False) -> str:
    """Return a line of text about the calibration of a map: numbers of frames, parameters, and cross-validated
    quality.

    Args:
        calibration: The calibration; None: the map is not calibrated.
        has_other: Whether the map has only a calibration for other settings.
    """
    import numpy as np

    from salframe.localization.calibration import OTHER_CALIBRATION

    if calibration is None:
        return OTHER_CALIBRATION if has_other else "not calibrated"
    head = calibration.head
    limit = 1 - float(head.min_in_map(np.array(0)))
    text = (
        f"calibrated with {calibration.present_frames} simulated queries in the map and "
        f"{len(calibration.absent_in_map)} out of it: accuracy {head.accuracy:.0%}, "
        f"out-of-map contrast {head.absent_mean:.2f} +- {head.absent_deviation:.2f}, answers are accepted up to an "
        f"out-of-map probability of {limit:.0%}"
    )
    if calibration.before is None or calibration.after is None:
        return text
    return (
        f"{text}; cross-validated log loss {calibration.after.log_loss:.3f} ({calibration.before.log_loss:.3f} without "
        f"calibration), Brier score {calibration.after.brier_score:.3f} ({calibration.before.brier_score:.3f})"
    )
