"""What speaks for a place, and how it is weighed: each part measured by itself, their weights fitted on tuning data."""

from __future__ import annotations

from functools import cache

import numpy as np
from pydantic import Field

from salframe.framework.config import Settings, read_yaml, validate
from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.rates import SHIPPED


class Weights(Settings):
    """What each part of the evidence adds to a place's score, for each unit of it. A place's share of the probability
    is the softmax of the scores."""

    likelihood: float = Field(description="of the log likelihood ratio of place and pose (nats)")
    outline: float = Field(
        description="of the log likelihood ratio of the outline of free space under that pose (nats)"
    )
    panorama: float = Field(description="of the score of the place's panorama that is most like the query, one by one")
    labels_found: float = Field(description="of the share of the query's labels, by rarity, that the place has")
    labels_shared: float = Field(description="of the Jaccard index of both multisets of labels, by rarity")


EVIDENCE = tuple(Weights.model_fields)
"""The parts of the evidence in the order of its columns."""


def label_evidence(label: np.ndarray, index: PlaceIndex, places: np.ndarray) -> np.ndarray:
    """(K, 2) of places (K,): the share of the query's rare labels that each has, and the Jaccard index of both
    multisets.

    label (n,): those of the query, n > 0, as in QueryObjects.
    """
    number = np.bincount(label)
    asked = np.flatnonzero(number)
    count = number[asked]
    column = np.full(len(index.rarity), -1)
    column[asked] = np.arange(len(asked))
    there = index.label[places]
    there = np.where(there >= 0, column[there], -1)
    cell = np.nonzero(there >= 0)[0] * len(asked) + there[there >= 0]
    counts = np.bincount(cell, minlength=len(places) * len(asked)).reshape(len(places), len(asked))
    shared = np.minimum(counts, count) @ index.rarity[asked]
    own = count @ index.rarity[asked]
    return np.column_stack([shared / own, shared / (index.weight[places] + own - shared)])


@cache
def shipped_weights() -> Weights:
    """The weights that come with the method."""
    return validate(Weights, read_yaml(SHIPPED)["weights"], f"{SHIPPED}: weights:")
