"""Error rates of a detector, and constants of the likelihood that are independent of the detector."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pydantic import Field

from salframe.framework.config import read_yaml
from salframe.framework.validation import Settings, validate

SHIPPED = Path(__file__).with_name("fitted.yaml")
"""File with the parameters that `salframe fit` estimated on tuning data (training/places)."""


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
        description="log-odds that an object is detected from a distance of 2 m, if its saliency is average and one "
        "panorama of the map shows it"
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


class BearingErrors(Settings):
    """Constants of the likelihood of query objects without range."""

    bearing_error_rad: float = Field(
        0.016, gt=0, description="standard deviation (rad) of each component of the bearing of an object"
    )
    horizontal_error_m: float = Field(
        0.04,
        ge=0,
        description="standard deviation (m) of the horizontal position of an object across the bearing, in addition "
        "to the error of the bearing and of the map",
    )
    vertical_error_m: float = Field(
        0.05,
        ge=0,
        description="standard deviation (m) of the height of the centroid of an object, in addition to the error of "
        "its direction",
    )
    side_error_share: float = Field(
        0.09,
        ge=0,
        description="standard deviation of the position of the visible centre of an object, divided by the mean side "
        "of its box; the visible part changes with the viewpoint",
    )
    size_error_log: float = Field(
        0.7, gt=0, description="standard deviation of ln(solid angle) of an object of known size and distance"
    )
    size_bias_log: float = Field(
        -0.3,
        description="mean of ln(solid angle) of an object, relative to that of its box from a random side; "
        "negative because parts are hidden",
    )
    size_span_log: float = Field(
        5.0,
        gt=0,
        description="length of the interval of ln(solid angle) over which the solid angles of clutter are uniform",
    )
    clutter_solid_angle_sr: float = Field(
        7.5, gt=0, description="solid angle (sr) over which the bearings of clutter are uniform"
    )
    detection_logit: float = Field(
        -0.76, description="log-odds of the detection of an object to which `rates` give the log-odds 0"
    )
    detection_per_logit: float = Field(
        1.62,
        description="change of the log-odds of the detection of an object per unit of its log-odds by the rates "
        "of the detector, at a distance of 2 m",
    )
    detection_per_distance: float = Field(
        -1.09,
        description="change of the log-odds of the detection of an object per unit of ln(distance from the camera)",
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
        0.33, gt=0, le=1, description="factor on the odds of each object if no pose in the place is assumed"
    )
    scale_error: float = Field(
        0.1,
        gt=0,
        description="standard deviation of true range / measured range, which is the same for all objects of a query",
    )
    camera_height_error_m: float = Field(
        0.15,
        gt=0,
        description="standard deviation (m) of the camera height of a query around its expected value; the method "
        "estimates this height if the query has no range",
    )
    bearings: BearingErrors = Field(BearingErrors(), description="constants for query objects without range")


@cache
def shipped_rates() -> Rates:
    """Return the rates that are distributed with the method."""
    return validate(Rates, read_yaml(SHIPPED)["rates"], f"{SHIPPED}: rates:")
