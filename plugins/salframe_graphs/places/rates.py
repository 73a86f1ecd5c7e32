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
        gt=0, lt=1, description="probability (0 to 1) that an object has the same label in the query and in the map"
    )
    position_error_m: float = Field(
        gt=0,
        description="standard deviation (m) of the horizontal position error of a query object, along x and along y, "
        "at a range of 0",
    )
    range_error_share: float = Field(
        ge=0,
        description="additional standard deviation of the position error of a query object along its ray, divided by "
        "the range of the object",
    )
    height_error_m: float = Field(
        gt=0,
        description="standard deviation (m) of the error of the height of a query object (its centroid), relative to "
        "the camera",
    )
    length_error_log: float = Field(
        gt=0, description="standard deviation of ln(box length in the query / box length in the map) of an object"
    )
    box_height_error_log: float = Field(
        gt=0, description="standard deviation of ln(box height in the query / box height in the map)"
    )
    detection_logit: float = Field(
        description="log-odds of detection at a distance of 2 m, for an object of average saliency that one panorama "
        "of the map shows"
    )
    detection_per_saliency: float = Field(
        description="change of the log-odds of detection if ln(saliency of the object) increases by 1"
    )
    detection_per_distance: float = Field(
        description="change of the log-odds of detection if ln(distance from the camera) increases by 1"
    )
    clutter: float = Field(
        gt=0, description="number of objects that are clutter, divided by the number of objects of the place"
    )


class BearingErrors(Settings):
    """Constants of the likelihood of query objects that have no range."""

    bearing_error_rad: float = Field(
        0.016,
        gt=0,
        description="standard deviation (rad) of the bearing error of an object, horizontally and vertically",
    )
    horizontal_error_m: float = Field(
        0.04,
        ge=0,
        description="additional standard deviation (m) of the horizontal position error of an object, perpendicular "
        "to its bearing",
    )
    vertical_error_m: float = Field(
        0.05,
        ge=0,
        description="additional standard deviation (m) of the error of the height of an object (its centroid)",
    )
    side_error_share: float = Field(
        0.09,
        ge=0,
        description="standard deviation of the offset between the centre of an object and the centre of its visible "
        "part, both horizontally and vertically. It is divided by the mean side of the object's box",
    )
    size_error_log: float = Field(
        0.7, gt=0, description="standard deviation of ln(solid angle) of an object of known size and distance"
    )
    size_bias_log: float = Field(
        -0.3,
        description="mean of ln(visible solid angle of an object / solid angle of its box). It is negative because "
        "parts of objects are hidden",
    )
    size_span_log: float = Field(
        5.0, gt=0, description="length of the interval over which ln(solid angle) of clutter is uniformly distributed"
    )
    clutter_solid_angle_sr: float = Field(
        7.5, gt=0, description="solid angle (sr) over which the bearings of clutter are uniformly distributed"
    )
    detection_logit: float = Field(
        -0.76,
        description="constant a in the formula a + b x for the log-odds of detection at a distance of 2 m, in a query "
        "without range. x: log-odds of detection of the same object at 2 m in a query with range, computed from "
        "`rates`; b: `likelihood.bearings.detection_per_logit`",
    )
    detection_per_logit: float = Field(
        1.62, description="factor b in the formula a + b x of `likelihood.bearings.detection_logit`"
    )
    detection_per_distance: float = Field(
        -1.09, description="change of the log-odds of detection if ln(distance from the camera) increases by 1"
    )


class Likelihood(Settings):
    """Constants of the likelihood that do not depend on the detector."""

    detection_per_sighting: float = Field(
        0.5,
        description="change of the log-odds of detection if ln(number of panoramas of the map that show the object) "
        "increases by 1",
    )
    area_m2: float = Field(
        60.0, gt=0, description="floor area (m2) over which the positions of clutter are uniformly distributed"
    )
    height_span_m: float = Field(
        2.5, gt=0, description="length (m) of the interval over which the heights of clutter are uniformly distributed"
    )
    size_span_log: float = Field(
        2.5,
        gt=0,
        description="length of the interval over which ln(box length) of clutter is uniformly distributed, and also "
        "ln(box height)",
    )
    unplaced_share: float = Field(
        0.33,
        gt=0,
        le=1,
        description="factor (0 to 1) in a second likelihood ratio, which needs no pose because it ignores positions. "
        "The factor multiplies the odds that an object of the query is an object of the place. If a pose was found in "
        "the place, the sum of both likelihood ratios is used, otherwise only the second one",
    )
    scale_error: float = Field(
        0.1,
        gt=0,
        description="standard deviation of the ratio true range / measured range. All objects of a query have the "
        "same ratio",
    )
    camera_height_error_m: float = Field(
        0.15,
        gt=0,
        description="standard deviation (m) of the camera height of a query without range, around the camera height "
        "of the map. The height is estimated together with the pose",
    )
    bearings: BearingErrors = Field(BearingErrors(), description="constants for query objects without range")


@cache
def shipped_rates() -> Rates:
    """Return the rates that are distributed with the method."""
    return validate(Rates, read_yaml(SHIPPED)["rates"], f"{SHIPPED}: rates:")
