"""The columns of evidence for a place, and their weights, which are fitted on tuning data."""

from __future__ import annotations

from functools import cache

import numpy as np
from pydantic import Field

from salframe.framework.config import read_yaml
from salframe.framework.validation import Settings, validate
from salframe.graphs.segments import ranges
from salframe_graphs.node_pairs import label_counts
from salframe_graphs.places.place_index import PlaceIndex
from salframe_graphs.places.rates import SHIPPED


class EvidenceWeights(Settings):
    """Weights of the columns of evidence in a place's score; the softmax of the scores gives the places' shares of
    probability."""

    likelihood: float = Field(description="of the log likelihood ratio of place and pose (nats)")
    outline: float = Field(
        description="of the log likelihood ratio of the outline of free space under that pose (nats)"
    )
    panorama: float = Field(description="of the score of the place's panorama that is most like the query, one by one")
    detected_labels: float = Field(description="of the share of the query's labels, by rarity, that the place has")
    labels_shared: float = Field(description="of the Jaccard index of both multisets of labels, by rarity")


def label_evidence(label: np.ndarray, index: PlaceIndex, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compare the labels of a query with those of places.

    Args:
        label: (n,) the query's, numbers of the index's vocabulary, -1 of a label that it lacks; n > 0.
        index: the places.
        places: (K,) those to compare with.

    Returns:
        (K,) the share of the query's labels that each place has, and (K,) the Jaccard index of both multisets of
        labels, both weighted by rarity.
    """
    each = index.count[places]
    label_there = index.label[ranges(index.segments.start[places], each)]
    used, number, counts = label_counts(label, len(index.vocabulary), label_there, each)
    shared = np.minimum(counts, number) @ index.rarity[used]
    whole = number @ index.rarity[used]
    return shared / whole, shared / (index.weight[places] + whole - shared)


@cache
def shipped_weights() -> EvidenceWeights:
    """The weights that come with the method."""
    return validate(EvidenceWeights, read_yaml(SHIPPED)["weights"], f"{SHIPPED}: weights:")
