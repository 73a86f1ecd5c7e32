"""Error rates of a detector, and constants of the likelihood that are independent of the detector."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pydantic import Field

from salframe.framework.config import read_yaml
from salframe.framework.validation import Settings, validate

SHIPPED = Path(__file__).with_name("fitted.yaml")
"""Parameters that `salframe fit` estimated on tuning data (training/places)."""


class Rates(Settings):
    """Errors of a detector between two panoramas of a place: ten scalars for all labels together."""

    label_agreement: float = Field(
        gt=0, lt=1, description="probability that an object has the same label as in the map"
    )
    position_error_m: float = Field(
        gt=0, description="standard deviation of a centroid along each axis (m), at range 0"
    )
    range_error_share: float = Field(
        ge=0, description="additional standard deviation of a range, relative to the range"
    )
    height_error_m: float = Field(gt=0, description="standard deviation of a centroid's height above the camera (m)")
    length_error_log: float = Field(gt=0, description="standard deviation of ln(length of a box)")
    box_height_error_log: float = Field(gt=0, description="standard deviation of ln(height of a box)")
    detection_logit: float = Field(
        description="logit of the probability to detect an object of average saliency, seen once in the map, from 2 m"
    )
    detection_per_saliency: float = Field(
        description="change of detection_logit per unit of ln(saliency / average saliency)"
    )
    detection_per_distance: float = Field(description="change of detection_logit per unit of ln(distance)")
    clutter: float = Field(
        gt=0, description="rate of query objects that belong to no object of the place, relative to the map's objects"
    )


class Likelihood(Settings):
    """Constants of the likelihood that are independent of the detector."""

    detection_per_sighting: float = Field(
        0.5, description="change of detection_logit per unit of ln(number of sightings in the map)"
    )
    area_m2: float = Field(60.0, gt=0, description="floor area (m2) over which clutter is uniform")
    height_span_m: float = Field(2.5, gt=0, description="range of heights (m) over which clutter is uniform")
    size_span_log: float = Field(2.5, gt=0, description="range of ln(size) over which clutter is uniform")
    unplaced_share: float = Field(
        0.33, gt=0, le=1, description="factor on the odds of an object in the likelihood without a pose"
    )


@cache
def shipped_rates() -> Rates:
    """Return the rates that are distributed with the method."""
    return validate(Rates, read_yaml(SHIPPED)["rates"], f"{SHIPPED}: rates:")
