"""Settings of the localizer `saliency-places`, with the fitted numbers that are distributed with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from salframe.framework.component import added, match_only
from salframe.framework.components.slots import slot, slots
from salframe.framework.config import merge, read_yaml
from salframe.framework.validation import Settings, validate
from salframe.localization.posterior import Posterior, read_fitted
from salframe_graphs.graph_localizer import GraphLocalizerConfig
from salframe_graphs.panorama_scores import PanoramaScoresConfig
from salframe_graphs.places.distant_views import DistantViews
from salframe_graphs.places.evidence import columns_of, shipped_weights, weights_of
from salframe_graphs.places.rates import SHIPPED, Likelihood, Rates, shipped_rates


@cache
def shipped_posterior() -> Posterior:
    """Return the parameters that convert scores to probabilities, as distributed with the method.

    With these parameters, no query is rejected as out-of-map, because most robots do not leave their map.
    """
    fitted = validate(Posterior, read_yaml(SHIPPED)["posterior"], f"{SHIPPED}: posterior:")
    return fitted.model_copy(update={"max_out_of_map_probability": 1.0})  # type: ignore[no-any-return]


def _merge_shipped(part: str, shipped: Callable[[], Settings], value: Any) -> Any:
    """Return a setting of fitted numbers: the user's values, and shipped values for the numbers that the user did not
    set."""
    fitted = read_fitted(part, value)
    return merge(shipped().model_dump(), fitted) if isinstance(fitted, Mapping) else fitted


def _fill_weights(value: Any, info: ValidationInfo) -> Any:
    """Return the value of the setting `weights` with a weight for each column of the setting `evidence`."""
    return weights_of(info.data["evidence"], value) if "evidence" in info.data else {}


class PlacesConfig(GraphLocalizerConfig, PanoramaScoresConfig):
    """Settings of the localizer `saliency-places`."""

    evidence: slots(  # type: ignore[valid-type]
        "evidence",
        ("likelihood", "outline", "panorama", "labels"),
        "list of the kinds of evidence for a place. Each kind computes one or more numbers (columns). `weights` has "
        "the weight of each column",
    )
    rates: Annotated[Rates, BeforeValidator(partial(_merge_shipped, "rates", shipped_rates))] = Field(
        default_factory=shipped_rates,
        description="mapping with the error rates of the detector, or the path of a file written by `salframe fit`",
        json_schema_extra={"match_only": True},
    )
    weights: Annotated[dict[str, float], BeforeValidator(_fill_weights)] = Field(
        default_factory=lambda: {**shipped_weights()},
        description="mapping from each column of `evidence` to its weight in the score of a place, or the path of a "
        "file written by `salframe fit`",
        json_schema_extra={"match_only": True},
    )
    likelihood: Likelihood = match_only(
        Likelihood(), description="constants of the likelihood of a query that do not depend on the detector"
    )
    posterior: Annotated[Posterior | None, BeforeValidator(partial(_merge_shipped, "posterior", shipped_posterior))] = (
        Field(
            default_factory=shipped_posterior,
            description="parameters that convert scores to probabilities, or the path of a file written by `salframe "
            "fit`; the default never answers out-of-map (to enable: max_out_of_map_probability=0.5); null: answers "
            "have no probabilities",
            json_schema_extra={"match_only": True},
        )
    )
    candidates: int = match_only(
        100,
        ge=1,
        description="maximum number of places whose objects are compared one by one with the objects of the query. "
        "If the map has more places, the setting `scene_index` selects the places to compare",
    )
    scene_index: slot(  # type: ignore[valid-type]
        "scene-index",
        "by-size",
        match_only=True,
        description="index that selects the places to compare, in a map with more than `candidates` places. It ranks "
        "the reference frames; the places of the first frames are selected",
    )
    merged: bool = match_only(
        True,
        description="true: the objects of all panoramas of a place are merged into one graph; false: each panorama "
        "has its own graph",
    )
    pose: bool = match_only(
        True,
        description="true: the answer has the estimated pose; false: the answer has the pose of the reference frame "
        "nearest to the estimated pose",
    )
    poses: int = match_only(3, ge=1, description="maximum number of candidate poses that are refined in each place")
    distant_views: DistantViews = added(
        DistantViews(),
        match_only=True,
        description="settings for views of a query that were taken far apart, in a map without floor masks",
    )

    @model_validator(mode="before")
    @classmethod
    def _add_weights(cls, value: Any) -> Any:
        """Add an empty mapping `weights` if there is none, so that `_fill_weights` adds the defaults for `evidence`."""
        return {"weights": {}, **value} if isinstance(value, Mapping) else value

    def keys_of(self, setting: str) -> Mapping[str, str]:
        if setting != "weights":
            return {}
        return {name: f"weight of the {column.description}" for name, column in columns_of(self.evidence).items()}
