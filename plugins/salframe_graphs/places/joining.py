"""Joins the descriptions of several views of a query into one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.graphs.graph import concatenate_graphs
from salframe.graphs.packing import graph_from_arrays, graph_to_arrays
from salframe.graphs.vocabulary import WRITTEN_LABELS
from salframe.localization.localizer import Description
from salframe_graphs.places.heights import height_of, join_heights
from salframe_graphs.places.outline import OUTLINE
from salframe_graphs.sectors import Sectors
from salframe_graphs.views import join_bearings, join_outlines, join_sectors, sectors_from_arrays, sectors_to_arrays


def add_bearings(
    joined: Description | None, descriptions: Sequence[Description], T_last_view: np.ndarray
) -> Description:
    """Return the joined objects of views with range, and after them the objects of views without range.

    Args:
        joined: The joined description of the views with range; None where there are none.
        descriptions: The descriptions of all V views.
        T_last_view: (V, 4, 4) motions that map coordinates of the views to those of the last view.
    """
    bearings = join_bearings([graph_from_arrays(description) for description in descriptions], T_last_view)
    if joined is not None and not len(bearings):
        return joined
    parts = [bearings] if joined is None else [graph_from_arrays(joined), bearings]
    written = np.unique(np.concatenate([description[WRITTEN_LABELS] for description in descriptions]))
    return {**graph_to_arrays(concatenate_graphs(parts)), WRITTEN_LABELS: written}


def join_surroundings(descriptions: Sequence[Description], T_last_view: np.ndarray) -> Description:
    """Return the sectors that views showed, the outline of free space around them, and the height of the last camera.

    Args:
        descriptions: The descriptions of V views.
        T_last_view: (V, 4, 4) motions that map coordinates of the views to those of the last view.
    """
    parts = [sectors_from_arrays(description) or Sectors.of_view(None, None) for description in descriptions]
    outlines_m = [description.get(OUTLINE) for description in descriptions]
    outline = {} if all(o is None for o in outlines_m) else {OUTLINE: join_outlines(outlines_m, T_last_view)}
    height = join_heights([height_of(description) for description in descriptions], T_last_view)
    return {**sectors_to_arrays(join_sectors(parts, T_last_view)), **outline, **height}
