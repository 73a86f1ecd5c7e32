"""Functions that join the descriptions of several views of a query into one description."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.graphs.graph import SaliencyGraph, concatenate_graphs
from salframe.localization.localizer import Description
from salframe_graphs.places.heights import height_of, join_heights
from salframe_graphs.sectors import Sectors
from salframe_graphs.views import join_bearings, join_sectors, sectors_from_arrays, sectors_to_arrays


def add_bearings(
    joined: SaliencyGraph | None, graphs: Sequence[SaliencyGraph], T_last_view: np.ndarray
) -> SaliencyGraph:
    """Return the joined objects of views with range, and after them the objects of views without range.

    Args:
        joined: The joined graph of the views with range; None if no view has range.
        graphs: The graphs of all V views.
        T_last_view: (V, 4, 4) transforms from the frame of each view to the frame of the last view.
    """
    if joined is not None and all(np.isfinite(graph.centroid_m).all() for graph in graphs):
        return joined
    bearings = join_bearings(graphs, T_last_view)
    return bearings if joined is None else concatenate_graphs([joined, bearings])


def join_surroundings(descriptions: Sequence[Description], T_last_view: np.ndarray) -> Description:
    """Return arrays of a description: the horizontal sectors that the views show together, and the height of the last
    camera.

    Args:
        descriptions: The descriptions of V views.
        T_last_view: (V, 4, 4) transforms from the frame of each view to the frame of the last view.
    """
    parts = [sectors_from_arrays(description) or Sectors.of_view(None, None) for description in descriptions]
    height = join_heights([height_of(description) for description in descriptions], T_last_view)
    return {**sectors_to_arrays(join_sectors(parts, T_last_view)), **height}
