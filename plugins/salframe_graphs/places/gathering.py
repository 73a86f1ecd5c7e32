"""The evidence for hypotheses of the place of a query."""

from __future__ import annotations

import numpy as np

from salframe.graphs.graph import with_range
from salframe.graphs.packing import graph_from_arrays
from salframe.localization.evidence import Evidence
from salframe.localization.localizer import Description
from salframe_graphs.panorama_scores import PanoramaScores
from salframe_graphs.places.evidence import label_evidence
from salframe_graphs.places.heights import at_map_height, height_of
from salframe_graphs.places.map_places import MapPlaces
from salframe_graphs.places.outline import OUTLINE
from salframe_graphs.places.poses import Poses
from salframe_graphs.places.query_objects import QueryObjects


def gather_evidence(
    places: MapPlaces,
    matching: PanoramaScores,
    nodes: QueryObjects,
    description: Description,
    rows: np.ndarray,
    names: np.ndarray,
    poses: Poses,
    likelihood: np.ndarray,
) -> Evidence:
    """Return the evidence for H hypotheses of the place of a query. The first C have a pose.

    Args:
        places: The places of the map.
        matching: Matches the query with single panoramas of the map.
        nodes: The nodes of the query, with the vocabulary of the map.
        description: The description of the query.
        rows: (H,) number of the place of each hypothesis.
        names: (H,) position in `places.names` of the name of each hypothesis.
        poses: The C poses, with place numbers of the map.
        likelihood: (H,) log likelihood ratio of objects and pose.
    """
    outline = np.zeros(len(rows))
    if OUTLINE in description:
        outline[: len(poses)] = places.outlines.ratio(description[OUTLINE], poses)
    panorama = np.zeros(len(places.names))
    graph = with_range(graph_from_arrays(description))
    if len(graph):
        raised = at_map_height(graph, height_of(description), places.index.camera_height_m)
        for name, score in matching.place_scores(raised).items():
            if name in places.number:
                panorama[places.number[name]] = score
    unused = np.zeros(len(rows))
    detected_labels, labels_shared = label_evidence(nodes.label, places.index, rows)
    evidence = {
        "likelihood": likelihood if nodes.num_ranged else unused,
        "bearing_likelihood": unused if nodes.num_ranged else likelihood,
        "outline": outline,
        "panorama": panorama[places.shown.name[rows]],
        "detected_labels": detected_labels,
        "labels_shared": labels_shared,
    }
    return Evidence([places.names[name] for name in names.tolist()], evidence)
