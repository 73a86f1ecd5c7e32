"""Names for regions that have no name, from the labels of the objects in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from salframe.graphs.vocabulary import object_label

UNKNOWN_TYPE = "room"
"""Type of a region without a typical object."""
TYPICAL_OBJECTS: Mapping[str, tuple[str, ...]] = {
    "bathroom": ("toilet", "bathtub", "shower", "urinal", "hand dryer", "bathroom vanity"),
    "kitchen": ("oven", "refrigerator", "dishwasher", "kitchen counter", "kitchen sink", "microwave"),
    "bedroom": ("bed", "nightstand", "wardrobe"),
    "laundry": ("washing machine", "clothes dryer", "ironing board"),
    "meeting room": ("conference table", "projection screen", "projector"),
    "office": ("desk", "office chair", "monitor", "file cabinet", "printer"),
    "dining room": ("dining table",),
    "living room": ("sofa", "television", "coffee table", "fireplace"),
    "storage room": ("storage shelf", "box", "locker"),
}
"""Labels of objects that are typical of each type of room. A label belongs to one type only."""


def name_regions(
    frame_region: np.ndarray, frame_labels: Sequence[Sequence[str]], num_regions: int, count: Counter[str]
) -> dict[int, str]:
    """Return a name for each region: a type and a number, such as "kitchen 2".

    The type is the one with the largest number of typical objects in the panoramas of the region.

    Args:
        frame_region: (N,) label of the region of each frame, from 1; 0 for none.
        frame_labels: Labels of the objects in the panorama of each frame.
        num_regions: Number of regions.
        count: Number of regions of each type that already have a name. It is updated in place.

    Returns:
        The name of each label from 1 to `num_regions`.
    """
    type_of = {object_label(label): kind for kind, labels in TYPICAL_OBJECTS.items() for label in labels}
    votes: dict[int, Counter[str]] = {region: Counter() for region in range(1, num_regions + 1)}
    for region, labels in zip(frame_region.tolist(), frame_labels, strict=True):
        if region:
            names = map(object_label, labels)
            votes[region].update(type_of[name] for name in names if name in type_of)
    named = {}
    for region, votes_of_region in votes.items():
        kind = votes_of_region.most_common(1)[0][0] if votes_of_region else UNKNOWN_TYPE
        count[kind] += 1
        named[region] = f"{kind} {count[kind]}"
    return named
