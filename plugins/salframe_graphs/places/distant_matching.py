"""Ranking of places for the last of several views that were taken far apart, in a map without floor masks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import graph_from_arrays
from salframe.localization.localizer import Description
from salframe_graphs.places.distant_views import ViewGroup, combine_groups
from salframe_graphs.places.evidence import PlaceEvidence
from salframe_graphs.places.heights import height_of
from salframe_graphs.places.likelihood import PlaceLikelihood
from salframe_graphs.places.query_objects import QueryObjects
from salframe_graphs.places.search import Ranking, search
from salframe_graphs.places.windows import Windows
from salframe_graphs.views import sectors_from_arrays

POSES = 1
"""Maximum number of poses to refine in each window. Windows overlap, so neighbouring windows give the same poses."""


def rank_distant_views(
    evidence: PlaceEvidence,
    windows: Windows,
    config: Any,
    query: SaliencyGraph,
    description: Description,
    groups: Sequence[ViewGroup],
    matched: np.ndarray,
) -> Ranking | None:
    """Return the ranked places in which the last view may be, best first; None if there is no pose.

    First, all views together give the pose. They are matched with windows (the objects of a place and of its
    surroundings), because the views may lie in several places. Then, each group of views is scored under this pose
    with the objects of each place alone. `combine_groups` combines these scores into scores for the last view.

    Args:
        evidence: The evidence, indexed for the map.
        windows: The windows of the places of the map.
        config: Config of the localizer `saliency-places`.
        query: The joined graph of all views.
        description: The joined description of all views.
        groups: The groups of the views.
        matched: (C,) indices of the places to match, ascending.
    """
    places = evidence.places
    nodes = QueryObjects.of(query, places.index.vocabulary)
    if not (nodes.label >= 0).any() or not len(matched):
        return None
    index, sectors, height_m = windows.take(matched), sectors_from_arrays(description), height_of(description)
    result = search(nodes, index, config.rates, config.likelihood, POSES, sectors, height_m)
    if not len(result.poses):
        return None
    poses = result.poses.with_places(matched[result.poses.place])
    names = places.scene_frames.name[poses.place]
    of_poses = evidence.gather(nodes, description, poses.place, names, poses, result.score, of_poses=True)
    best = int(np.argmax(of_poses.scores(config.weights) if of_poses.values else result.score))
    scores = [
        _group_scores(evidence, config, group, matched, poses.shift_m[best], float(poses.yaw_rad[best]))
        for group in groups
    ]
    if all(score is None for score in scores):
        return None
    score = combine_groups(scores, [group.distance_m for group in groups], config.distant_views.same_place_m)
    names, first, row = np.unique(places.scene_frames.name[matched], return_index=True, return_inverse=True)
    of_name = np.full(len(names), -np.inf)
    np.logaddexp.at(of_name, row, score)
    order = np.lexsort((first, -of_name))
    return Ranking(names[order], of_name[order], np.full(len(names), best), poses, result)


def _group_scores(
    evidence: PlaceEvidence, config: Any, group: ViewGroup, matched: np.ndarray, shift_m: np.ndarray, yaw_rad: float
) -> np.ndarray | None:
    """Return the score (C,) of each place for a group of views; None if the map has none of the group's labels.

    The pose of the last view in the world is the position `shift_m` (2,) and the heading `yaw_rad`.
    """
    places = evidence.places
    nodes = QueryObjects.of(graph_from_arrays(group.description), places.index.vocabulary)
    if not (nodes.label >= 0).any():
        return None
    index, sectors, height_m = (
        places.index.take(matched),
        sectors_from_arrays(group.description),
        height_of(group.description),
    )
    scorer = PlaceLikelihood(nodes, index, config.rates, config.likelihood, sectors, height_m)
    poses = group.poses(shift_m, yaw_rad, len(matched))
    likelihood = np.logaddexp(scorer.score(poses)[0], scorer.score_without_pose())
    names, in_map = places.scene_frames.name[matched], poses.with_places(matched)
    gathered = evidence.gather(nodes, group.description, matched, names, in_map, likelihood)
    return gathered.scores(config.weights)
