"""The localizer `saliency-graph`: detector, saliency model, graph, matcher and positioner in sequence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from salframe.framework.component import ComponentConfig
from salframe.framework.files.columns import Columns
from salframe.graphs.packing import graph_from_arrays
from salframe.graphs.table import MappedGraphs
from salframe.graphs.vocabulary import unknown_labels
from salframe.localization.answers import Localization, NodeMatches
from salframe.localization.localizer import Description, posterior_slot
from salframe.localization.saved_frames import SavedFrames
from salframe.panoramas.frames import ReferenceFrame
from salframe_graphs.graph_localizer import GraphLocalizer, GraphLocalizerConfig
from salframe_graphs.panorama_matching import PanoramaMatching, PanoramaMatchingConfig


class SaliencyGraphLocalizer(GraphLocalizer):
    """Compares the saliency graph of a query with the graph of each reference frame.

    The pose is computed from matched objects.
    """

    name = "saliency-graph"
    version = "6"

    class Config(GraphLocalizerConfig, PanoramaMatchingConfig):
        posterior: posterior_slot()  # type: ignore[valid-type]

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._matching = PanoramaMatching(self.config)

    @property
    def column_step(self) -> int | None:  # type: ignore[override]
        """Number of pixel columns of one rotation step: the `column_step` of the detector.

        None if rotating the panorama does not change the estimated heading by the same angle.
        """
        return super().column_step if self._matching.is_equivariant else None

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        self._matching.index([graph_from_arrays(description) for description in descriptions], frames)

    def write_index(self, folder: Path) -> None:
        self._matching.write_index(folder)

    def open_index(self, folder: Path, packed: Columns, frames: SavedFrames) -> None:
        self._matching.open_index(folder, MappedGraphs(packed), frames)

    def match(self, description: Description) -> Localization:
        return self._matching.localize(graph_from_arrays(description))

    def unknown_labels(self, description: Description) -> tuple[str, ...]:
        return unknown_labels(description, self._matching.labels)

    def correspond(self, query: Description, reference: Description) -> NodeMatches:
        return self._matching.correspond(query, reference)
