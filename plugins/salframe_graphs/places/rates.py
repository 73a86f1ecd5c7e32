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
    """Errors of a detector between two panoramas of one place: ten numbers, which hold for all labels."""

    label_agreement: float = Field(
        gt=0, lt=1, description="probability (0 to 1) that a detected object has the same label as in the map"
    )
    position_error_m: float = Field(
        gt=0,
        description="standard deviation (m) of the position of a detected object along each axis, without the error "
        "that grows with its range (`range_error_share`)",
    )
    range_error_share: float = Field(
        ge=0,
        description="standard deviation of the range of a detected object divided by its range, an independent error "
        "in addition to `position_error_m`",
    )
    height_error_m: float = Field(
        gt=0,
        description="standard deviation (m) of the height of the centroid of a detected object, relative to the camera",
    )
    length_error_log: float = Field(
        gt=0, description="standard deviation of ln(length of the detected box / length of the box in the map)"
    )
    box_height_error_log: float = Field(
        gt=0, description="standard deviation of ln(height of the detected box / height of the box in the map)"
    )
    detection_logit: float = Field(
        description="log-odds ln(p / (1 - p)) of the probability p that an object is detected again from a distance "
        "of 2 m, if its saliency is average and one panorama of the map shows it"
    )
    detection_per_saliency: float = Field(
        description="change of the log-odds of detection (see `detection_logit`) per unit of ln(saliency of the "
        "object / average saliency)"
    )
    detection_per_distance: float = Field(
        description="change of the log-odds of detection of an object per unit of ln(distance from the camera)"
    )
    clutter: float = Field(
        gt=0,
        description="number of query objects that are not in the map (clutter), divided by the number of objects of "
        "the place",
    )


class BearingErrors(Settings):
    """Constants of the likelihood of query objects that have no range."""

    bearing_error_rad: float = Field(
        0.016, gt=0, description="standard deviation (rad) of the direction of an object, horizontally and vertically"
    )
    horizontal_error_m: float = Field(
        0.04,
        ge=0,
        description="standard deviation (m) of the horizontal position of an object perpendicular to its direction, "
        "in addition to the errors of its direction and of the map",
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
        description="standard deviation of the centre of the visible part of an object, divided by the mean side of "
        "its box; the visible part depends on the position of the camera",
    )
    size_error_log: float = Field(
        0.7, gt=0, description="standard deviation of ln(solid angle) of an object, if its size and distance are known"
    )
    size_bias_log: float = Field(
        -0.3,
        description="mean of ln(solid angle of the object / solid angle of its box from a random side); negative "
        "because parts of objects are hidden",
    )
    size_span_log: float = Field(
        5.0,
        gt=0,
        description="length of the interval of ln(solid angle) in which the values of clutter (query objects that are "
        "not in the map) are uniformly distributed",
    )
    clutter_solid_angle_sr: float = Field(
        7.5,
        gt=0,
        description="solid angle (sr) in which the directions of clutter (query objects that are not in the map) "
        "are uniformly distributed",
    )
    detection_logit: float = Field(
        -0.76,
        description="constant a in the log-odds a + b x of detection from a distance of 2 m, where x are the log-odds "
        "that `rates` give for this distance",
    )
    detection_per_logit: float = Field(
        1.62, description="factor b in the log-odds a + b x of detection (see `detection_logit`)"
    )
    detection_per_distance: float = Field(
        -1.09, description="change of the log-odds of detection of an object per unit of ln(distance from the camera)"
    )


class Likelihood(Settings):
    """Constants of the likelihood that do not depend on the detector."""

    detection_per_sighting: float = Field(
        0.5,
        description="change of the log-odds of detection of an object per unit of ln(number of panoramas of the map "
        "that show it)",
    )
    area_m2: float = Field(
        60.0,
        gt=0,
        description="floor area (m2) in which the positions of clutter (query objects that are not in the map) are "
        "uniformly distributed",
    )
    height_span_m: float = Field(
        2.5,
        gt=0,
        description="length (m) of the interval in which the heights of clutter (query objects that are not in the "
        "map) are uniformly distributed",
    )
    size_span_log: float = Field(
        2.5,
        gt=0,
        description="length of the interval of ln(box length) and of ln(box height) in which the values of clutter "
        "(query objects that are not in the map) are uniformly distributed",
    )
    unplaced_share: float = Field(
        0.33,
        gt=0,
        le=1,
        description="factor (0 to 1) in the score of a place without a pose, which ignores positions: it multiplies "
        "the odds that an object of the query is an object of the place",
    )
    scale_error: float = Field(
        0.1,
        gt=0,
        description="standard deviation of true range / measured range; all objects of a query have the same ratio",
    )
    camera_height_error_m: float = Field(
        0.15,
        gt=0,
        description="standard deviation (m) of the difference between the true and the expected camera height of a "
        "query; the method estimates this height if the query has no range",
    )
    bearings: BearingErrors = Field(BearingErrors(), description="constants for query objects without range")


@cache
def shipped_rates() -> Rates:
    """Return the rates that are distributed with the method."""
    return validate(Rates, read_yaml(SHIPPED)["rates"], f"{SHIPPED}: rates:")
