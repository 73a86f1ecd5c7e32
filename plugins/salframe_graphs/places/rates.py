"""What is known of a detector's errors, and the few numbers of the likelihood that are no detector's."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pydantic import Field

from salframe.framework.config import read_yaml
from salframe.framework.validation import Settings, validate

SHIPPED = Path(__file__).with_name("fitted.yaml")
"""What `salframe fit` wrote, on tuning data (training/places)."""


class Rates(Settings):
    """How a detector errs from one panorama of a place to another: ten scalars, no table by label or class."""

    label_agreement: float = Field(gt=0, lt=1, description="probability that an object bears the label of the map's")
    position_error_m: float = Field(gt=0, description="standard deviation of a centroid along each axis, at no range")
    range_error_share: float = Field(ge=0, description="standard deviation of a range, a share of it, beside that")
    height_error_m: float = Field(gt=0, description="standard deviation of a centroid's height over the camera")
    length_error_log: float = Field(gt=0, description="standard deviation of the logarithm of a box's length")
    box_height_error_log: float = Field(gt=0, description="standard deviation of the logarithm of a box's height")
    detection_logit: float = Field(
        description="logit of finding again an object of average saliency 2 m away that was seen once"
    )
    detection_per_saliency: float = Field(description="what a saliency e times the average adds to that logit")
    detection_per_distance: float = Field(description="what a distance e times as long adds to it")
    clutter: float = Field(
        gt=0, description="rate of objects that are none of the place's, to those of the map as a whole"
    )


class Likelihood(Settings):
    """What the likelihood takes for granted whatever the detector."""

    detection_per_sighting: float = Field(
        0.5, description="what e times as many sightings in the map add to detection_logit"
    )
    area_m2: float = Field(60.0, gt=0, description="floor over which clutter is spread evenly")
    height_span_m: float = Field(2.5, gt=0, description="heights over which clutter is spread evenly")
    size_span_log: float = Field(2.5, gt=0, description="logarithms of size over which clutter is spread evenly")
    unplaced_share: float = Field(
        0.33, gt=0, le=1, description="what an object without a pose counts of one that fits but for its position"
    )


@cache
def shipped_rates() -> Rates:
    """The rates that come with the method."""
    return validate(Rates, read_yaml(SHIPPED)["rates"], f"{SHIPPED}: rates:")
