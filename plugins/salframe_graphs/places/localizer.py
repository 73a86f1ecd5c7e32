"""The localizer `saliency-places`: ranks the places of a map by evidence, and estimates place and pose together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import lcm
from pathlib import Path
from typing import Any

import numpy as np

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import identity
from salframe.framework.components.registry import registry
from salframe.framework.files.columns import Columns
from salframe.graphs.detections import Detections
from salframe.graphs.graph import SaliencyGraph
from salframe.graphs.packing import DEVIATION, graph_from_arrays
from salframe.graphs.scene_index import SceneIndex
from salframe.graphs.table import MappedGraphs
from salframe.graphs.vocabulary import unknown_labels
from salframe.localization.answers import Localization, LocalizationStatus, NodeMatches, RankedPlace, ranked_places
from salframe.localization.evidence import Evidence
from salframe.localization.localizer import Description
from salframe.localization.saved_frames import SavedFrames
from salframe.panoramas.floors import Regions
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import invert_pose, pose_2d
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.place_heights import MAX_STEP_M
from salframe.panoramas.view import OdometryNoise
from salframe_graphs.graph_localizer import GraphLocalizer
from salframe_graphs.panorama_scores import PanoramaScores
from salframe_graphs.places.distant_matching import rank_distant_views
from salframe_graphs.places.distant_views import ViewGroup, group_views, groups_from_arrays, groups_to_arrays
from salframe_graphs.places.evidence import PlaceEvidence
from salframe_graphs.places.heights import (
    PACKED_HEIGHT,
    at_map_height,
    height_of,
    measure_height,
    pack_height,
    unpack_height,
)
from salframe_graphs.places.joining import add_bearings, join_surroundings
from salframe_graphs.places.map_places import MapPlaces
from salframe_graphs.places.outline import OUTLINE
from salframe_graphs.places.poses import Poses
from salframe_graphs.places.query_objects import QueryObjects
from salframe_graphs.places.search import Ranking, SearchResult, refine_final_pose, search
from salframe_graphs.places.settings import PlacesConfig
from salframe_graphs.sectors import Sectors, shown_bins
from salframe_graphs.views import sectors_from_arrays, sectors_to_arrays

_SCENES = "scenes"
"""Name of the scene index, in the folder of a map's index."""
MIN_DEVIATION_M = 0.02
"""Lower bound of the standard deviation of a pose along an axis, because two objects may agree by chance."""
MIN_EXPLAINED = 2
"""Minimum number of query objects that match an object of the place with a probability above 0.5. With fewer, the
answer has no pose."""
MAX_RANKED = 2000
"""Maximum number of ranked places. On a map with more places, the scene index selects the places to rank."""


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """H hypotheses of the place of a query. The first C have a pose.

    Attributes:
        name: (H,) index in MapPlaces.names of the place name of each hypothesis.
        evidence: The evidence for each hypothesis.
        poses: The C poses. Their place indices refer to all places of the map.
        search: The result of the search, with the same C poses. Their place indices refer to the searched places only.
    """

    name: np.ndarray
    evidence: Evidence
    poses: Poses
    search: SearchResult


class SaliencyPlacesLocalizer(GraphLocalizer):
    """Merges the objects of all panoramas of a place, and estimates place and pose of a query together.

    The score of a place is a weighted sum of numbers, the evidence. By default, the evidence is: a log likelihood ratio
    of the objects, a log likelihood ratio of the outline of free space, the score of the best match with a single
    panorama, and the labels that query and place share. If a query has no range, the bearings and solid angles of its
    objects are compared instead of positions.

    The defaults of `rates`, `weights` and `posterior` were estimated on tuning data. `salframe fit` estimates `weights`
    and `posterior` on your data. Use its file with `--set weights=FILE.yaml` and `--set posterior=FILE.yaml`.
    """

    name = "saliency-places"
    version = "15"
    uses_floors = True

    class Config(PlacesConfig):
        """See PlacesConfig."""

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._matching = PanoramaScores(self.config)
        self._evidence = PlaceEvidence(self.config.evidence)

    @property
    def uses(self) -> frozenset[str]:  # type: ignore[override]
        """Parts of a panorama that the graph or the evidence reads if they are present."""
        return super().uses | self._evidence.uses

    def describe_identity(self) -> dict[str, Any]:
        stored = tuple(config for config in self.config.evidence if config.component.arrays)
        return identity(self.config.model_copy(update={"evidence": stored}), describing=True)

    def describe_objects(self, detections: Detections, panorama: Panorama) -> Description:
        description = {**super().describe_objects(detections, panorama)}
        if panorama.range_m is not None:
            description |= measure_height(panorama)
        description = {**self._evidence.describe(panorama, description)}
        shown = None if panorama.valid is None else shown_bins(panorama.valid)
        is_partial = shown is not None and not shown.all()
        if is_partial or OUTLINE in description:
            description |= sectors_to_arrays(Sectors.of_view(shown, description.get(OUTLINE)))
        return description

    def join(
        self, descriptions: Sequence[Description], T_last_view: np.ndarray, odometry: OdometryNoise
    ) -> Description:
        graphs = [graph_from_arrays(description) for description in descriptions]
        joined = self._join(descriptions, graphs, T_last_view, odometry)
        numbers = group_views(T_last_view, self.config.distant_views.near_m)
        if len(numbers) == 1 or self.floors:  # floor masks show the place at a pose
            return joined
        groups = []
        for group in numbers:
            T_last_group, views = T_last_view[group[-1]], slice(group.start, group.stop)
            description = descriptions[group[-1]]
            if len(group) > 1:
                T_group_view = invert_pose(T_last_group) @ T_last_view[views]
                description = self._join(descriptions[views], graphs[views], T_group_view, odometry)
            groups.append(ViewGroup(description, T_last_group))
        return {**joined, **groups_to_arrays(groups)}

    def _join(
        self,
        descriptions: Sequence[Description],
        graphs: Sequence[SaliencyGraph],
        T_last_view: np.ndarray,
        odometry: OdometryNoise,
    ) -> Description:
        ranged = [n for n, graph in enumerate(graphs) if not graph.bearings_only]
        joined = self.join_graphs([graphs[n] for n in ranged], T_last_view[ranged], odometry) if ranged else None
        whole = add_bearings(joined, graphs, T_last_view)
        description = {**self.joined_arrays(whole, descriptions), **join_surroundings(descriptions, T_last_view)}
        return self._evidence.join(description, descriptions, T_last_view)

    def pack(self, description: Description) -> Description:
        return self._evidence.pack({**super().pack(description), **pack_height(description)}, description)

    def unpack(self, packed: Description) -> Description:
        return self._evidence.unpack({**super().unpack(packed), **unpack_height(packed)}, packed)

    @property
    def column_step(self) -> int | None:  # type: ignore[override]
        """Number of pixel columns of one rotation step: least common multiple of the `column_step` of detector and
        evidence.

        None if rotating the panorama does not change the estimated heading by the same angle.
        """
        detector, evidence = super().column_step, self._evidence.column_step
        return None if detector is None or evidence is None or not self.config.pose else lcm(detector, evidence)

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        graphs = [graph_from_arrays(description) for description in descriptions]
        self._matching.index(graphs, frames)
        heights_m = np.array([height_of(description) for description in descriptions])
        regions, config = Regions(self.floors) if self.floors else None, self.config
        self._map = MapPlaces.gather(graphs, frames, heights_m, regions, config.rates, config.likelihood, config.merged)
        self._evidence.index(descriptions, self._map, self._matching)
        self._windows = self._map.windows(config.distant_views.window_m)
        self._scenes = self._new_scene_index()
        if self._scenes is not None:
            self._scenes.take(self._place_graphs())

    def write_index(self, folder: Path) -> None:
        self._matching.write_index(folder)
        self._map.write(folder)
        scenes = self._new_scene_index()
        if scenes is not None:
            scenes.build(self._place_graphs(), folder / _SCENES)

    def open_index(self, folder: Path, packed: Columns, frames: SavedFrames) -> None:
        self._matching.open_index(folder, MappedGraphs(packed), frames)
        regions = Regions(self.floors) if self.floors else None
        height_mm, deviation_mm = packed.columns.get(PACKED_HEIGHT), packed.columns.get(DEVIATION)
        self._map = MapPlaces.read(folder, height_mm, deviation_mm, len(packed), frames.poses(), regions)
        self._evidence.open_index(packed, self._map, self._matching)
        self._windows = self._map.windows(self.config.distant_views.window_m)
        self._scenes = self._new_scene_index()
        if self._scenes is not None:
            self._scenes.open(folder / _SCENES)

    def _new_scene_index(self) -> SceneIndex | None:
        """Return a scene index if the map has more places than candidates, else None."""
        if len(self._map) <= self.config.candidates:
            return None
        index: SceneIndex = registry().build(SceneIndex.role, self.config.scene_index)
        return index

    def _place_graphs(self) -> Iterator[SaliencyGraph]:
        """Return the graphs of the scene frames of all places, place by place."""
        return (self._matching.graphs[number] for number in self._map.scene_frames.frame)

    def match(self, description: Description) -> Localization:
        query = graph_from_arrays(description)
        if not len(query):
            return Localization((), None, LocalizationStatus.NO_OBJECTS)
        ranking = self._rank(query, description)
        if ranking is None:
            return Localization((), None, LocalizationStatus.NO_MATCH)
        names, pose_row = ranking.names, ranking.pose_row
        frames = [self._matching.frames[number] for number in self._map.nearest_frames(names, ranking.poses, pose_row)]
        ids = [frame.id for frame in frames]
        places = ranked_places(ids, [self._map.names[name] for name in names.tolist()], ranking.score.tolist())
        evidence = ranking.evidence
        if not self.config.pose:
            return Localization(places, frames[0].T_world_pano, LocalizationStatus.OK, evidence=evidence)
        if pose_row[0] < 0:
            return self._without_pose(places, names[0], evidence)
        best, share = ranking.search.poses.take(pose_row[:1]), ranking.search.share(int(pose_row[0]))
        if (share.sum(1) > 0.5).sum() < MIN_EXPLAINED:
            return self._without_pose(places, names[0], evidence)
        pose, covariance = refine_final_pose(ranking.search.scorer, best, share, MIN_DEVIATION_M)
        height_m = height_of(description) * pose.scale[0]  # the same ranges measured the height
        camera_z_m = (
            self._map.camera_z_m(int(ranking.poses.place[pose_row[0]]), height_m) + pose.camera_height_offset_m[0]
        )
        T_world_query = pose_2d(pose.shift_m[0, 0], pose.shift_m[0, 1], pose.yaw_rad[0], camera_z_m)
        return Localization(places, T_world_query, LocalizationStatus.OK, covariance, evidence=evidence)

    def _rank(self, query: SaliencyGraph, description: Description) -> Ranking | None:
        """Return the places of a query, best first; None if no place has any of the query's labels."""
        groups = groups_from_arrays(description)
        if groups:
            raised = at_map_height(query, height_of(description), self._map.index.camera_height_m)
            matched, _ = self._shortlist(raised)
            ranking = rank_distant_views(
                self._evidence, self._windows, self.config, query, description, groups, matched
            )
            if ranking is not None:
                return ranking
        hypotheses = self._hypotheses(query, description)
        if hypotheses is None:
            return None
        value = hypotheses.evidence.scores(self.config.weights)
        names, first, row = np.unique(hypotheses.name, return_index=True, return_inverse=True)
        score, pose_row = np.full(len(names), -np.inf), np.full(len(names), -1)
        np.logaddexp.at(score, row, value)
        ascending = np.argsort(value[: len(hypotheses.poses)], kind="stable")
        pose_row[row[ascending]] = ascending  # the last assignment wins: the best hypothesis with a pose
        order = np.lexsort((first, -score))
        rows = np.flatnonzero(row == order[0])
        evidence = self._evidence.for_posterior(hypotheses.evidence, int(rows[np.argmax(value[rows])]))
        return Ranking(names[order], score[order], pose_row[order], hypotheses.poses, hypotheses.search, evidence)

    def _without_pose(self, places: tuple[RankedPlace, ...], name: int, evidence: Mapping[str, float]) -> Localization:
        """Return an answer without a pose, and with a note if the frames of the first place lie on several storeys.

        Args:
            places: The ranked places.
            name: Index of the name of the first place.
            evidence: Evidence for the first place.
        """
        heights_m = self._map.heights_m(name)
        divided = np.diff(heights_m).max(initial=0) > MAX_STEP_M
        note = (
            f"no pose: the reference frames of the place {places[0].place!r} lie on several storeys (z = "
            f"{heights_m[0]:.2f} to {heights_m[-1]:.2f} m), expected one storey: use different place "
            "names on each storey"
        )
        notes = (note,) if divided else ()
        return Localization(places, None, LocalizationStatus.NO_POSE, notes=notes, evidence=evidence)

    def evidence(self, description: Description) -> Evidence | None:
        query = graph_from_arrays(description)
        if not len(query):
            return None
        hypotheses = self._hypotheses(query, description)
        return None if hypotheses is None else hypotheses.evidence

    def shown_directions(self, description: Description) -> np.ndarray | None:
        sectors = sectors_from_arrays(description)
        return None if sectors is None else sectors.reach_m > 0

    def unknown_labels(self, description: Description) -> tuple[str, ...]:
        return unknown_labels(description, self._matching.labels)

    def correspond(self, query: Description, reference: Description) -> NodeMatches:
        return self._matching.correspond(query, reference)

    def _hypotheses(self, query: SaliencyGraph, description: Description) -> _Hypotheses | None:
        """Return the hypotheses of a query: candidate places with their best poses, and other places without a pose.

        None if no place has any of the query's labels.
        """
        places = self._map
        nodes = QueryObjects.of(query, places.index.vocabulary)
        if not (nodes.label >= 0).any():
            return None
        raised = at_map_height(query, height_of(description), places.index.camera_height_m)
        matched, ranked = self._shortlist(raised)
        if not len(matched):
            return None
        config = self.config
        result = search(
            nodes,
            places.index.take(matched),
            config.rates,
            config.likelihood,
            config.poses,
            sectors_from_arrays(description),
            height_of(description),
        )
        pose_place = matched[result.poses.place]
        poses = result.poses.with_places(pose_place)
        pose_name = places.names_at(poses)
        has_pose = np.zeros(len(places.names), bool)
        has_pose[pose_name] = True
        others = ranked[~has_pose[places.scene_frames.name[ranked]]]
        rows = np.concatenate([pose_place, others])
        without_pose = result.scorer.score_without_pose()
        # A place that was not searched gets the minimum likelihood of the searched places.
        position = np.minimum(np.searchsorted(matched, others), len(matched) - 1)
        other_likelihood = np.where(matched[position] == others, without_pose[position], without_pose.min())
        value = np.concatenate([np.logaddexp(result.score, without_pose[result.poses.place]), other_likelihood])
        numbers = np.concatenate([pose_name, places.scene_frames.name[others]])
        evidence = self._evidence.gather(nodes, description, rows, numbers, poses, value)
        return _Hypotheses(numbers, evidence, poses, result)

    def _shortlist(self, query: SaliencyGraph) -> tuple[np.ndarray, np.ndarray]:
        """Return the places (C,) to match object by object, and the places (R,) to rank, both ascending.

        The scene index selects both. On a map of at most MAX_RANKED places, all places are ranked.
        """
        all_places, count = np.arange(len(self._map)), self.config.candidates
        if self._scenes is None:
            return all_places, all_places
        num_ranked = count if len(all_places) <= MAX_RANKED else max(count, MAX_RANKED)
        scene_frames = self._map.scene_frames
        scenes = self._scenes.candidates(query, num_ranked * scene_frames.padded.shape[1]).scene
        places = np.array([*dict.fromkeys(scene_frames.place[scenes].tolist())], int)
        return np.sort(places[:count]), all_places if len(all_places) <= MAX_RANKED else np.sort(places[:num_ranked])
