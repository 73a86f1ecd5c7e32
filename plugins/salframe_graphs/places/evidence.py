"""Columns of evidence for a place, and their weights, which are fitted on tuning data."""

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
    """Weights of the columns of evidence in the score of a place. The softmax of the scores gives probabilities."""

    likelihood: float = Field(
        description="weight of the log likelihood ratio (nats) of the query's objects, at the best pose in the "
        "candidate place"
    )
    bearing_likelihood: float = Field(
        description="weight of the same log likelihood ratio (nats) of a query without range"
    )
    outline: float = Field(
        description="weight of the log likelihood ratio (nats) of the outline of the free space, at the best pose "
        "in the candidate place"
    )
    panorama: float = Field(
        description="weight of the best score among the matches of the query with the single panoramas of the "
        "candidate place"
    )
    detected_labels: float = Field(
        description="weight of the share of the query's labels that the candidate place has; rare labels count more"
    )
    labels_shared: float = Field(
        description="weight of the Jaccard index of the labels of query and candidate place; rare labels count more"
    )


def label_evidence(label: np.ndarray, index: PlaceIndex, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compare the labels of a query with those of places.

    Args:
        label: (n,) labels of the query's objects as numbers of the index's vocabulary, -1 for other labels; n > 0.
        index: The places of the map.
        places: (K,) numbers of the places to compare with.

    Returns:
        The share (K,) of the query's labels that each place has, and the Jaccard index (K,) of both multisets of
        labels, both weighted by rarity.
    """
    count = index.count[places]
    map_label = index.label[ranges(index.segments.start[places], count)]
    distinct, number, counts = label_counts(label, len(index.vocabulary), map_label, count)
    shared = np.minimum(counts, number) @ index.rarity[distinct]
    query_rarity = number @ index.rarity[distinct]
    return shared / query_rarity, shared / (index.weight[places] + query_rarity - shared)


@cache
def shipped_weights() -> EvidenceWeights:
    """Return the weights that are distributed with the method."""
    return validate(EvidenceWeights, read_yaml(SHIPPED)["weights"], f"{SHIPPED}: weights:")
