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
        gt=0, lt=1, description="probability that a detected object has the same label as in the map"
    )
    position_error_m: float = Field(
        gt=0, description="standard deviation (m) of the position of a detected object along each axis, at range 0"
    )
    range_error_share: float = Field(
        ge=0,
        description="standard deviation of the range of a detected object, relative to the range, in addition to "
        "the constant position error",
    )
    height_error_m: float = Field(
        gt=0, description="standard deviation (m) of the height of an object's centroid above the camera"
    )
    length_error_log: float = Field(
        gt=0, description="standard deviation of the natural logarithm of the length of an object's box"
    )
    box_height_error_log: float = Field(
        gt=0, description="standard deviation of the natural logarithm of the height of an object's box"
    )
    detection_logit: float = Field(
        description="log-odds of the detection of an object of average saliency that is seen once in the map, "
        "from a distance of 2 m"
    )
    detection_per_saliency: float = Field(
        description="change of the log-odds of the detection of an object per unit of ln(saliency / average saliency)"
    )
    detection_per_distance: float = Field(
        description="change of the log-odds of the detection of an object per unit of ln(distance from the camera)"
    )
    clutter: float = Field(
        gt=0,
        description="rate of clutter: number of query objects without a counterpart in the place, divided by the "
        "number of objects of the place",
    )


class Likelihood(Settings):
    """Constants of the likelihood that are independent of the detector."""

    detection_per_sighting: float = Field(
        0.5,
        description="change of the log-odds of the detection of an object per unit of ln(number of panoramas of "
        "the map that show it)",
    )
    area_m2: float = Field(
        60.0,
        gt=0,
        description="floor area (m2) over which the positions of clutter (query objects without an object in the "
        "map) are uniform",
    )
    height_span_m: float = Field(
        2.5,
        gt=0,
        description="interval of heights (m) over which the heights of clutter (query objects without an object "
        "in the map) are uniform",
    )
    size_span_log: float = Field(
        2.5,
        gt=0,
        description="length of the interval of ln(size) over which the sizes of clutter (query objects without an "
        "object in the map) are uniform",
    )
    unplaced_share: float = Field(
        0.33, gt=0, le=1, description="factor on the odds of each object in the likelihood of a place without a pose"
    )


@cache
def shipped_rates() -> Rates:
    """Return the rates that are distributed with the method."""
    return validate(Rates, read_yaml(SHIPPED)["rates"], f"{SHIPPED}: rates:")
