"""The localizer `saliency-places`: a map of places, found by the evidence for each of them under a pose."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.framework.config import merge, read_yaml
from salframe.framework.files.columns import Columns
from salframe.framework.validation import Settings, validate
from salframe.graphs.graph import SaliencyGraph, without_positions
from salframe.graphs.packing import graph_from_arrays
from salframe.graphs.scene_index import SceneIndex
from salframe.graphs.table import GraphNodes, MappedGraphs
from salframe.localization.answers import Localization, LocalizationStatus, NodeMatches, ranked_places
from salframe.localization.evidence import Evidence
from salframe.localization.localizer import Description
from salframe.localization.posterior import Posterior, read_fitted
from salframe.localization.saved_frames import SavedFrames
from salframe.panoramas.floors import Regions
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama
from salframe_graphs.graph_localizer import GraphLocalizer, GraphLocalizerConfig
from salframe_graphs.panorama_matching import PanoramaMatching, PanoramaMatchingConfig
from salframe_graphs.places.evidence import EvidenceWeights, label_evidence, shipped_weights
from salframe_graphs.places.likelihood import Poses
from salframe_graphs.places.map_places import MapPlaces
from salframe_graphs.places.outline import free_outline, pack_outline, unpack_outline
from salframe_graphs.places.rates import SHIPPED, Likelihood, Rates, shipped_rates
from salframe_graphs.places.search import SearchResult, search, settle

OUTLINE, PACKED = "outline_m", "outline_mm"
_SCENES = "scenes"
"""Name of the scene index, in the folder of a map's index."""
MIN_DEVIATION_M = 0.02
"""Two objects may agree by chance: no pose has a smaller standard deviation along an axis."""
MIN_EXPLAINED = 2
"""A pose needs this many query objects that are more likely the place's than clutter."""
MAX_RANKED = 2000
"""On a map of more places an answer ranks this many, those that the scene index puts first."""


@cache
def shipped_posterior() -> Posterior:
    """Return the posterior that comes with the method; it never says out-of-map, as most robots are on their map."""
    fitted = validate(Posterior, read_yaml(SHIPPED)["posterior"], f"{SHIPPED}: posterior:")
    return fitted.model_copy(update={"max_out_of_map_probability": 1.0})  # type: ignore[no-any-return]


def _over_shipped(part: str, shipped: Callable[[], Settings], value: Any) -> Any:
    """Return the value of a setting whose numbers come with the method: as `read_fitted`, the rest as shipped."""
    fitted = read_fitted(part, value)
    return merge(shipped().model_dump(), fitted) if isinstance(fitted, Mapping) else fitted


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """H hypotheses of where a query is: name (H,), numbers of MapPlaces.names, and the evidence for each.

    The first C have poses, whose places are numbers of the map's; `search` has them by the places that were searched.
    """

    name: np.ndarray
    evidence: Evidence
    poses: Poses
    search: SearchResult


class SaliencyPlacesLocalizer(GraphLocalizer):
    """Places as the merged objects of their panoramas, found and posed at once.

    The evidence is a likelihood ratio of the objects, the outline of free space, the panorama most like the query, and
    rare labels, weighed as fitted (`weights`). Queries without range, and those whose ranges may be off by a factor
    (a matcher that estimates scale), are matched with panoramas one by one, as `saliency-graph` does. Without a
    positioner every query is answered by place only: the pose is that of the frame of the first place.
    """

    name = "saliency-places"
    version = "3"
    uses_floors = True

    class Config(GraphLocalizerConfig, PanoramaMatchingConfig):
        outline: bool = Field(
            True, description="remember how far a panorama sees at the height of furniture, and match by it too"
        )
        rates: Annotated[Rates, BeforeValidator(partial(_over_shipped, "rates", shipped_rates))] = Field(
            default_factory=shipped_rates,
            description="the detector's errors, or a file of `salframe fit`",
            json_schema_extra={"match_only": True},
        )
        weights: Annotated[EvidenceWeights, BeforeValidator(partial(_over_shipped, "weights", shipped_weights))] = (
            Field(
                default_factory=shipped_weights,
                description="weight of each column of evidence, or a file of `salframe fit`",
                json_schema_extra={"match_only": True},
            )
        )
        likelihood: Likelihood = match_only(Likelihood(), description="what holds for every detector")
        posterior: Annotated[
            Posterior | None, BeforeValidator(partial(_over_shipped, "posterior", shipped_posterior))
        ] = Field(
            default_factory=shipped_posterior,
            description="a file of `salframe fit`, or its parameters: scores become probabilities; as shipped no "
            "answer is out-of-map, which max_out_of_map_probability=0.5 changes; null: none",
            json_schema_extra={"match_only": True},
        )
        candidates: int = match_only(
            100,
            ge=1,
            description="places that are matched object by object: those whose panoramas the scene index puts first",
        )
        scene_index: slot("scene-index", "by-size", match_only=True)  # type: ignore[valid-type]
        merged: bool = match_only(
            True, description="gather the panoramas of a place into one graph; false: each by itself"
        )
        poses: int = match_only(3, ge=1, description="poses that are refined in each place")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._matching = PanoramaMatching(self.config)
        self._weights = self.config.weights.model_dump()

    def describe(self, panorama: Panorama) -> Description:
        description = super().describe(panorama)
        if not self.config.outline or panorama.range_m is None:
            return description
        return {**description, OUTLINE: free_outline(panorama.range_m)}

    def pack(self, description: Description) -> Description:
        packed = super().pack(description)
        return {**packed, PACKED: pack_outline(description[OUTLINE])} if OUTLINE in description else packed

    def unpack(self, packed: Description) -> Description:
        description = super().unpack(packed)
        return {**description, OUTLINE: unpack_outline(packed[PACKED])} if PACKED in packed else description

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        graphs = [graph_from_arrays(description) for description in descriptions]
        self._matching.index(graphs, frames)
        outlines_m = [description.get(OUTLINE) for description in descriptions]
        regions, config = Regions(self.floors) if self.floors else None, self.config
        self._map = MapPlaces.gathered(
            graphs, frames, outlines_m, regions, config.rates, config.likelihood, config.merged
        )
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
        self._map = MapPlaces.read(folder, packed.columns.get(PACKED), len(packed), frames.poses(), regions)
        self._scenes = self._new_scene_index()
        if self._scenes is not None:
            self._scenes.open(folder / _SCENES)

    def _new_scene_index(self) -> SceneIndex | None:
        """A scene index for a map of more places than candidates."""
        if len(self._map) <= self.config.candidates:
            return None
        made: SceneIndex = registry().build(SceneIndex.role, self.config.scene_index)
        return made

    def _place_graphs(self) -> Iterator[SaliencyGraph]:
        """The graphs of the scene frames of all places, place by place."""
        return (self._matching.graphs[number] for number in self._map.shown.frame)

    def match(self, description: Description) -> Localization:
        query = graph_from_arrays(description)
        if self._is_scaleless(description):
            return self._matching.localize(query)
        if not len(query):
            return Localization((), None, LocalizationStatus.NO_OBJECTS)
        hypotheses = self._hypotheses(query, description.get(OUTLINE))
        if hypotheses is None:
            return Localization((), None, LocalizationStatus.NO_MATCH)
        value = hypotheses.evidence.scores(self._weights)
        names, first, row = np.unique(hypotheses.name, return_index=True, return_inverse=True)
        score, posed = np.full(len(names), -np.inf), np.full(len(names), -1)
        np.logaddexp.at(score, row, value)
        ascending = np.argsort(value[: len(hypotheses.poses)], kind="stable")
        posed[row[ascending]] = ascending  # of each name the best hypothesis with a pose, which comes last
        order = np.lexsort((first, -score))
        names, score, posed = names[order], score[order], posed[order]
        frames = [self._matching.frames[number] for number in self._map.nearest_frames(names, hypotheses.poses, posed)]
        ids = [frame.id for frame in frames]
        places = ranked_places(ids, [self._map.names[name] for name in names.tolist()], score.tolist())
        if self._matching.positioner is None:
            return Localization(places, frames[0].T_world_pano, LocalizationStatus.OK)
        if posed[0] < 0:
            return Localization(places, None, LocalizationStatus.NO_POSE)
        best, share = hypotheses.search.poses.take(posed[:1]), hypotheses.search.share(int(posed[0]))
        if (share.sum(1) > 0.5).sum() < MIN_EXPLAINED:
            return Localization(places, None, LocalizationStatus.NO_POSE)
        pose, covariance = settle(hypotheses.search.scorer, best, share, MIN_DEVIATION_M)
        camera_z_m = frames[0].T_world_pano[2, 3]
        T_world_query = pose_2d(pose.shift_m[0, 0], pose.shift_m[0, 1], pose.yaw_rad[0], camera_z_m)
        return Localization(places, T_world_query, LocalizationStatus.OK, covariance)

    def fits_posterior(self, description: Description) -> bool:
        return not self._is_scaleless(description)  # the posterior was fitted to the scores of other queries

    def evidence(self, description: Description) -> Evidence | None:
        query = graph_from_arrays(description)
        if self._is_scaleless(description) or not len(query):
            return None
        hypotheses = self._hypotheses(query, description.get(OUTLINE))
        return None if hypotheses is None else hypotheses.evidence

    def correspond(self, query: Description, reference: Description) -> NodeMatches:
        return self._matching.correspond(query, reference)

    def _is_scaleless(self, description: Description) -> bool:
        """Whether positions in metres are not known of a query."""
        return self._matching.estimates_scale or without_positions(description["centroid_m"])

    def _hypotheses(self, query: SaliencyGraph, outline_m: np.ndarray | None) -> _Hypotheses | None:
        """Return the candidates, each under its best pose, and the other places by their labels alone; None where no
        place has any of the query's labels."""
        places = self._map
        nodes = GraphNodes.of(query, places.index.vocabulary)
        if not (nodes.label >= 0).any():
            return None
        matched, ranked = self._shortlist(query)
        if not len(matched):
            return None
        config = self.config
        result = search(nodes, places.index.take(matched), config.rates, config.likelihood, config.poses)
        here = matched[result.poses.place]
        poses = Poses(here, result.poses.shift_m, result.poses.yaw_rad)
        stands = places.names_at(poses)
        has_pose = np.zeros(len(places.names), bool)
        has_pose[stands] = True
        others = ranked[~has_pose[places.shown.name[ranked]]]
        rows = np.concatenate([here, others])
        none = np.zeros(len(others))
        unplaced = result.scorer.unplaced()
        # A place that was not searched has the likelihood of the worst one that was.
        position = np.minimum(np.searchsorted(matched, others), len(matched) - 1)
        of_others = np.where(matched[position] == others, unplaced[position], unplaced.min())
        outline = np.zeros(len(here)) if outline_m is None else places.outlines.ratio(outline_m, poses)
        panorama = np.zeros(len(places.names))
        for name, score in self._matching.place_scores(query).items():
            if name in places.number:
                panorama[places.number[name]] = score
        detected_labels, labels_shared = label_evidence(nodes.label, places.index, rows)
        evidence = {
            "likelihood": np.concatenate([np.logaddexp(result.score, unplaced[result.poses.place]), of_others]),
            "outline": np.concatenate([outline, none]),
            "panorama": panorama[places.shown.name[rows]],
            "detected_labels": detected_labels,
            "labels_shared": labels_shared,
        }
        numbers = np.concatenate([stands, places.shown.name[others]])
        names = [places.names[number] for number in numbers.tolist()]
        return _Hypotheses(numbers, Evidence(names, evidence), poses, result)

    def _shortlist(self, query: SaliencyGraph) -> tuple[np.ndarray, np.ndarray]:
        """Return the places that are matched object by object (C,), and those that are ranked (R,), both ascending:
        those whose scene frames the index puts first, and all of up to MAX_RANKED."""
        every, count = np.arange(len(self._map)), self.config.candidates
        if self._scenes is None:
            return every, every
        wanted = count if len(every) <= MAX_RANKED else max(count, MAX_RANKED)
        shown = self._map.shown
        scenes = self._scenes.candidates(query, wanted * shown.padded.shape[1]).scene
        places = np.array([*dict.fromkeys(shown.place[scenes].tolist())], int)
        return np.sort(places[:count]), every if len(every) <= MAX_RANKED else np.sort(places[:wanted])
