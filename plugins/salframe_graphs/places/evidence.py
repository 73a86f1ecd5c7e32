"""The evidence of a localizer: several components, the columns (numbers per hypothesis) of each, and their weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from math import lcm
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.config import read_yaml
from salframe.framework.errors import InvalidAnswer
from salframe.framework.files.columns import Columns
from salframe.localization.evidence import Evidence
from salframe.localization.evidence_model import EvidenceColumn, EvidenceModel
from salframe.localization.localizer import Description
from salframe.localization.posterior import read_fitted
from salframe.panoramas.panorama import Panorama
from salframe_graphs.panorama_scores import PanoramaScores
from salframe_graphs.places.evidence_components import ObjectHypotheses
from salframe_graphs.places.map_places import MapPlaces
from salframe_graphs.places.poses import Poses
from salframe_graphs.places.query_objects import QueryObjects
from salframe_graphs.places.rates import SHIPPED


@cache
def shipped_weights() -> Mapping[str, float]:
    """Return the fitted weight of each column of the evidence, from the file that is distributed with the method."""
    weights: Mapping[str, float] = read_yaml(SHIPPED)["weights"]
    return weights


def columns_of(evidence: Sequence[ComponentConfig]) -> dict[str, EvidenceColumn]:
    """Return the columns of the configured components, by name. A column is a number for each candidate place.

    Raises ValueError if two columns have the same name.
    """
    columns: dict[str, EvidenceColumn] = {}
    models: list[Any] = [config.component for config in evidence]
    for model in models:
        for column in model.columns:
            if column.name in columns:
                raise ValueError(
                    f"two components in the setting `evidence` compute a number (column) named {column.name!r}, "
                    "expected different names: remove one of the two components"
                )
            columns[column.name] = column
    return columns


def weights_of(evidence: Sequence[ComponentConfig], value: Any) -> Any:
    """Return the weight of each column of evidence, in the order of the columns. A column is a number for each place.

    Args:
        evidence: The configured components.
        value: The weights that the user set: a mapping from column names to weights, or a file of `salframe fit`. A
            file must have all weights. A column that the mapping lacks gets its shipped weight. Without a shipped
            weight, it gets the default weight that its component declares.

    Raises:
        ValueError: Two components have a column of the same name, `value` has a weight for an unknown column, or a
            column has no weight.
        ConfigError: The file cannot be read.
    """
    columns = columns_of(evidence)
    fitted = read_fitted("weights", value)
    if not isinstance(fitted, Mapping):
        return fitted
    if unknown := [name for name in fitted if name not in columns]:
        raise ValueError(
            f"received a weight with the unknown name {unknown[0]!r}, expected names of the columns that the setting "
            f"`evidence` selects: {', '.join(columns)}"
        )
    weights = dict(fitted)
    if not isinstance(value, str | Path) and "kind" not in value:
        defaults = {name: shipped_weights().get(name, column.weight) for name, column in columns.items()}
        weights = {name: weight for name, weight in defaults.items() if weight is not None} | weights
    if missing := [name for name in columns if name not in weights]:
        raise ValueError(
            f"received no weight for the evidence {', '.join(missing)}, expected one for each number that "
            f"the components in the setting `evidence` compute: set weights.{missing[0]}, or fit all weights with "
            "`salframe fit`"
        )
    return {name: weights[name] for name in columns}


class PlaceEvidence:
    """The components of evidence, and the map that they are indexed for.

    Attributes:
        uses: Parts of a panorama that the components read if they are present.
        column_step: Number of pixel columns of one rotation step: the least common multiple of the components'
            `column_step`; None if a component has none.
        places: The places of the map, after `index` or `open_index`.
    """

    places: MapPlaces

    def __init__(self, evidence: Sequence[ComponentConfig]) -> None:
        self._models: list[EvidenceModel] = [registry().build(EvidenceModel.role, config) for config in evidence]
        self.uses = frozenset[str]().union(*(model.uses for model in self._models))
        steps = [model.column_step for model in self._models]
        self.column_step = None if None in steps else lcm(*(step for step in steps if step is not None))

    def describe(self, panorama: Panorama, description: Description) -> Description:
        """Return the description with the arrays of each component."""
        return self._added(description, lambda model: model.describe(panorama, description))

    def join(self, joined: Description, descriptions: Sequence[Description], T_last_view: np.ndarray) -> Description:
        """Return the description of a query of V views, extended by the arrays of each evidence component.

        Args:
            joined: The description of all views together, without the arrays of the components.
            descriptions: The V descriptions of the single views. Each component computes its arrays from them.
            T_last_view: (V, 4, 4) transforms from the frame of each view to the frame of the last view.
        """
        return self._added(joined, lambda model: model.join(descriptions, T_last_view))

    def pack(self, packed: Description, description: Description) -> Description:
        """Return `packed` with the additional arrays that each evidence component packs from `description`."""
        for model in self._models:
            packed = _merged(packed, model.pack(description), model.name)
        return packed

    def unpack(self, description: Description, packed: Description) -> Description:
        """Return the unpacked description with the arrays of each evidence component."""
        return self._added(description, lambda model: model.unpack(packed))

    def index(self, descriptions: Sequence[Description], places: MapPlaces, matching: PanoramaScores) -> None:
        """Index a map for all evidence components."""
        self.places, self._matching = places, matching
        for model in self._models:
            arrays = [model.arrays_of(description) for description in descriptions]
            model.index(arrays, places.scene_frames, places.T_world_pano)

    def open_index(self, packed: Columns, places: MapPlaces, matching: PanoramaScores) -> None:
        """Index an opened map for all evidence components."""
        self.places, self._matching = places, matching
        for model in self._models:
            model.open_index(packed, places.scene_frames, places.T_world_pano)

    def gather(
        self,
        nodes: QueryObjects,
        description: Description,
        rows: np.ndarray,
        names: np.ndarray,
        poses: Poses,
        likelihood: np.ndarray,
        *,
        of_poses: bool = False,
    ) -> Evidence:
        """Return the evidence for H hypotheses of the place of a query. The first C have a pose.

        Args:
            nodes: The nodes of the query, with labels numbered by the vocabulary of the map.
            description: The description of the query.
            rows: (H,) index of the place of each hypothesis.
            names: (H,) index in `places.names` of the place name of each hypothesis.
            poses: The C poses. Their place indices refer to the places of the map.
            likelihood: (H,) log likelihood ratio of objects and pose.
            of_poses: Whether to return only the columns that depend on the pose.

        Raises:
            InvalidAnswer: A component did not return exactly the columns that it declares, as finite float64 (H,).
        """
        hypotheses = ObjectHypotheses(
            rows, poses.shift_m, poses.yaw_rad, poses.scale, likelihood, nodes, self.places, self._matching
        )
        columns: dict[str, np.ndarray] = {}
        for model in self._models:
            if model.uses_pose or not of_poses:
                columns |= _checked(model, model.score(description, hypotheses), len(rows))
        return Evidence([self.places.names[name] for name in names.tolist()], columns)

    def for_posterior(self, evidence: Evidence, row: int) -> dict[str, float]:
        """Return the columns that the posterior uses, with their values for the hypothesis `row`.

        A column with the value 0 is left out: the query or the map lacks its data, or the hypothesis has no pose.
        """
        names = [column.name for model in self._models for column in model.columns if column.in_posterior]
        return {name: value for name in names if (value := float(evidence.values[name][row]))}

    def _added(self, description: Description, arrays_of: Callable[[EvidenceModel], Description]) -> Description:
        """Return a copy of a description, extended by the arrays of each component, which `arrays_of` returns.

        Raises:
            InvalidAnswer: A component returned an array that it does not declare, or that the description already has.
        """
        for model in self._models:
            arrays = arrays_of(model)
            if undeclared := arrays.keys() - set(model.arrays):
                raise InvalidAnswer(
                    f"the evidence component {model.name!r} returned the array {min(undeclared)!r}, expected only the "
                    f"arrays in its attribute `arrays`: {', '.join(model.arrays) or 'none'}"
                )
            description = _merged(description, arrays, model.name)
        return description


def _merged(description: Description, arrays: Description, name: str) -> Description:
    """Return a description extended by `arrays`. Raises InvalidAnswer if it already has an array of the same name."""
    if taken := arrays.keys() & description.keys():
        raise InvalidAnswer(
            f"the evidence component {name!r} returned the array {min(taken)!r}, but another component already "
            "returned an array of this name: choose another name"
        )
    return {**description, **arrays}


def _checked(model: EvidenceModel, columns: Mapping[str, np.ndarray], count: int) -> Mapping[str, np.ndarray]:
    """Return the columns of a component. Raises InvalidAnswer if they differ from the declared columns."""
    names = [column.name for column in model.columns]
    if columns.keys() != set(names):
        raise InvalidAnswer(
            f"the evidence component {model.name!r} returned the columns {', '.join(columns) or 'none'}, "
            f"expected those in its attribute `columns`: {', '.join(names)}"
        )
    for name, values in columns.items():
        if values.shape != (count,) or values.dtype != np.float64 or not np.isfinite(values).all():
            raise InvalidAnswer(
                f"the evidence component {model.name!r} returned the column {name!r} as {values.dtype} of shape "
                f"{values.shape}, expected finite numbers as float64 of shape ({count},), one for each candidate place"
            )
    return columns
