"""Base class of localizers that use a detector and a saliency model to compute a saliency graph of each panorama."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from salframe.framework.component import ComponentConfig, added
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.graphs.detections import Detections
from salframe.graphs.graph import REACH_M, GraphConfig, SaliencyGraph, build_graph
from salframe.graphs.packing import BEARING_ARRAYS, graph_from_arrays, graph_to_arrays, pack_graph, unpack_graph
from salframe.graphs.vocabulary import WRITTEN_LABELS, with_object_labels, written_labels
from salframe.localization.detecting import DetectingLocalizer
from salframe.localization.localizer import Description, LevelledConfig, range_slot
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.view import OdometryNoise
from salframe_graphs.triangulated import place_objects
from salframe_graphs.views import ViewObjects, join_objects


class GraphLocalizerConfig(LevelledConfig):
    """Settings of the steps that compute a saliency graph from a panorama."""

    range: range_slot()  # type: ignore[valid-type]
    detector: slot("detector", "auto")  # type: ignore[valid-type]
    saliency: slot(  # type: ignore[valid-type]
        "saliency", "volumetric", description="saliency model, which computes how much each object stands out"
    )
    graph: GraphConfig = GraphConfig.model_validate({})
    odometry: OdometryNoise = added(
        OdometryNoise(),
        match_only=True,
        description="expected errors of the motion that odometry measures between the views of a query",
    )
    view_objects: ViewObjects = added(
        ViewObjects(),
        match_only=True,
        description="expected position errors of objects in the views of a query; objects of several views that are "
        "close to each other within these errors are merged",
    )


class GraphLocalizer(DetectingLocalizer):
    """Base class of localizers whose description of a panorama is its saliency graph."""

    uses: ClassVar[frozenset[str]] = frozenset({"range"})

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._saliency = registry().build("saliency", self.config.saliency)

    def graph(self, detections: Detections) -> SaliencyGraph:
        """Return the 360-degree saliency graph of the detections of a panorama, with their object labels.

        Where the panorama has no range, objects have a bearing but no position.
        """
        detections = with_object_labels(detections)
        return build_graph(detections, self._saliency.score(detections), self.config.graph)

    def describe_objects(self, detections: Detections, panorama: Panorama) -> Description:
        return {**graph_to_arrays(self.graph(detections)), **written_labels(detections)}

    def join(
        self, descriptions: Sequence[Description], T_last_view: np.ndarray, odometry: OdometryNoise
    ) -> Description | None:
        graphs = [graph_from_arrays(description) for description in descriptions]
        if any(graph.bearings_only for graph in graphs):
            return None  # objects without positions cannot be moved
        return self.joined_arrays(self.join_graphs(graphs, T_last_view, odometry), descriptions)

    def join_graphs(
        self, graphs: Sequence[SaliencyGraph], T_last_view: np.ndarray, odometry: OdometryNoise
    ) -> SaliencyGraph:
        """Return the graph of the merged objects of views with range, in the frame of the last view."""
        objects = join_objects(graphs, T_last_view, odometry, self.config.view_objects)
        return build_graph(objects, self._saliency.score(objects), self.config.graph)

    def joined_arrays(self, joined: SaliencyGraph, descriptions: Sequence[Description]) -> Description:
        """Return the description of a joined graph, including the original labels of all views."""
        written = np.unique(np.concatenate([description[WRITTEN_LABELS] for description in descriptions]))
        return {**graph_to_arrays(joined), WRITTEN_LABELS: written}

    def complete(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> Sequence[Description]:
        """Triangulate the objects of frames without range from the bearings of several frames.

        Objects without a position are left out. If no object of a frame has a position, its description does not
        change.
        """
        graphs = [graph_from_arrays(description) for description in descriptions]
        rows = [number for number, graph in enumerate(graphs) if graph.bearings_only]
        completed = list(descriptions)
        placed = place_objects([graphs[row] for row in rows], [frames[row] for row in rows])
        for row, (objects, variance_m2) in zip(rows, placed, strict=True):
            if len(objects):
                graph = build_graph(objects, self._saliency.score(objects), self.config.graph, variance_m2)
                used = {name: value for name, value in descriptions[row].items() if name not in BEARING_ARRAYS}
                completed[row] = {**used, **graph_to_arrays(graph)}
        return completed

    def unfit_for_map(self, description: Description) -> str | None:
        if not graph_from_arrays(description).bearings_only:
            return None
        return (
            "the panorama has no range image, and its objects cannot be triangulated from a second panorama of the "
            "same place: add range images, or take at least 2 panoramas of each place, about 1 m apart, or use the "
            "method 'objects'"
        )

    def pack(self, description: Description) -> Description:
        return pack_graph(description)

    def unpack(self, packed: Description) -> Description:
        return unpack_graph(packed)

    def count_objects(self, description: Description) -> int:
        return len(description["labels"])

    def note(self, description: Description) -> str | None:
        count = graph_from_arrays(description).out_of_reach
        return (
            f"{count} object(s) are left out, because they are more than {REACH_M} m from the camera" if count else None
        )
