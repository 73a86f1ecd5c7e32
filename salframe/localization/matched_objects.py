"""The objects of a map that the objects of a query were matched with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from salframe.localization.answers import Localization, NodeMatches
from salframe.localization.level_frames import split_level
from salframe.localization.localizer import Description
from salframe.localization.map import LocalizationMap
from salframe.panoramas.geometry import transform_points


class MapObject(NamedTuple):
    """An object of a map: its label, and its centre (3,) in the world in metres."""

    label: str
    xyz_m: np.ndarray


def find_matched_objects(map: LocalizationMap, description: Description, answer: Localization) -> dict[int, MapObject]:
    """Return the objects of the map that the objects of a query were matched with.

    The objects of the map are those of the best reference frame of the answer.

    Args:
        map: The map.
        description: The description of the query; of its last view if it has several views.
        answer: The answer to the query.

    Returns:
        Mapping from the index of an object of the query to the matched object of the map; empty if the answer has no
        places, or the localizer does not match objects.
    """
    if not answer.places:
        return {}
    frame, reference = map.reference(answer.places[0].frame)
    matches = map.localizer.correspond(split_level(description)[0], reference)
    if not isinstance(matches, NodeMatches) or "labels" not in reference:
        return {}
    world_m = transform_points(frame.T_world_pano, matches.reference_m)
    labels = reference["labels"]
    return {int(q): MapObject(str(labels[r]), world_m[r]) for q, r in matches.pairs}
