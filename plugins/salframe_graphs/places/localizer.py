"""The localizer `saliency-places`: a map of places, answered by what speaks for each of them under a pose."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from salframe.framework.array_files import ArrayKind
from salframe.framework.columns import Columns, read_columns, write_columns
from salframe.framework.config import ComponentConfig, Settings, match_only, merge, read_yaml, validate
from salframe.framework.registry import registry
from salframe.framework.slots import slot
from salframe.graphs.graph import SaliencyGraph, without_positions
from salframe.graphs.packing import graph_from_arrays
from salframe.graphs.scene_index import SceneIndex
from salframe.localization.answers import Localization, LocalizationStatus, ranked_places
from salframe.localization.evidence import Evidence
from salframe.localization.localizer import Description
from salframe.localization.posterior import Posterior, read_fitted
from salframe.localization.saved_frames import SavedFrames
from salframe.panoramas.floors import Regions
from salframe.panoramas.frames import MapFrame
from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama
from salframe_graphs import compilation
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_graphs.places import search
from salframe_graphs.places.evidence import EVIDENCE, Weights, shipped_weights
from salframe_graphs.places.likelihood import Poses
from salframe_graphs.places.merging import gather_places
from salframe_graphs.places.outline import BINS, MapOutlines, free_outline, pack_outline, unpack_outline
from salframe_graphs.places.place_index import (
    PLACE_COLUMNS,
    QueryObjects,
    index_places,
    lay_out_query,
    place_rows,
    read_places,
)
from salframe_graphs.places.rates import SHIPPED, Likelihood, Rates, shipped_rates
from salframe_graphs.places.shown import ShownPlaces

OUTLINE, PACKED = "outline_m", "outline_mm"
_PLACES, _SCENES = "places", "scenes"
"""What is kept of places, and the index of their scene frames, in the folder of a map's index."""
_SHOWN_COLUMNS = {"name": ArrayKind("U", ()), "frames": ArrayKind("u", (None,))}
LEAST_COVARIANCE_M = 0.02
"""Two objects may agree by luck: no pose is known better an axis."""
LEAST_EXPLAINED = 2
"""A pose takes so many objects that are more likely the place's than clutter."""
RANKED = 2000
"""Of a map of more places an answer ranks so many, those that the scene index puts first."""


@cache
def shipped_posterior() -> Posterior:
    """The posterior that comes with the method; it never says not-here, as most robots are on their map."""
    fitted = validate(Posterior, read_yaml(SHIPPED)["posterior"], f"{SHIPPED}: posterior:")
    return fitted.model_copy(update={"max_not_here": 1.0})  # type: ignore[no-any-return]


def _over_shipped(part: str, shipped: Callable[[], Settings], value: Any) -> Any:
    """What a setting stands for whose numbers come with the method: as `read_fitted`, what is not said as shipped."""
    found = read_fitted(part, value)
    return merge(shipped().model_dump(), found) if isinstance(found, Mapping) else found


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """H hypotheses of where a query is: name (H,), of ShownPlaces; evidence (H, F), as in EVIDENCE. The first C have
    poses; share, as of Found: what of the query's objects each of these explains."""

    query: QueryObjects
    name: np.ndarray
    evidence: np.ndarray
    poses: Poses
    share: Callable[[int], np.ndarray]


class SaliencyPlacesLocalizer(SaliencyGraphLocalizer):
    """Places as the merged objects of their panoramas, found and posed at once: by a likelihood ratio of the objects,
    the outline of free space, the panorama most like the query, and rare labels, weighed as fitted (`weights`).

    Queries without range, and those whose ranges may be off by a factor (`matcher.largest_scale_error`), are matched
    panorama by panorama as `saliency-graph` does, with all its settings. Of other queries the matcher, `top_k`,
    `agreement` and `nearest_scene` give the panorama's part of the evidence, and `min_score` says nothing.
    Without a positioner every query is answered by place only: the pose is that of the frame of the first place.
    """

    name = "saliency-places"
    version = "3"
    uses_floors = True

    class Config(SaliencyGraphLocalizer.Config):
        outline: bool = Field(
            True, description="remember how far a panorama sees at the height of furniture, and match by it too"
        )
        rates: Annotated[Rates, BeforeValidator(partial(_over_shipped, "rates", shipped_rates))] = Field(
            default_factory=shipped_rates,
            description="the detector's errors, or a file of `salframe fit`",
            json_schema_extra={"match_only": True},
        )
        weights: Annotated[Weights, BeforeValidator(partial(_over_shipped, "weights", shipped_weights))] = Field(
            default_factory=shipped_weights,
            description="what each part of the evidence counts, or a file of `salframe fit`",
            json_schema_extra={"match_only": True},
        )
        likelihood: Likelihood = match_only(Likelihood(), description="what holds whatever the detector")
        posterior: Annotated[
            Posterior | None, BeforeValidator(partial(_over_shipped, "posterior", shipped_posterior))
        ] = Field(
            default_factory=shipped_posterior,
            description="a file of `salframe fit`, or its parameters: scores become probabilities; as shipped no "
            "answer is not-here, which max_not_here=0.5 changes; null: none",
            json_schema_extra={"match_only": True},
        )
        candidates: int = match_only(
            100,
            ge=1,
            description="places that are matched object by object: those whose panoramas the scene index puts first",
        )
        scene_index: slot("scene-index", "inverted-lists", match_only=True)  # type: ignore[valid-type]
        merged: bool = match_only(
            True, description="gather the panoramas of a place into one graph; false: each by itself"
        )
        poses: int = match_only(3, ge=1, description="poses that are refined in each place")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._rates: Rates = self.config.rates
        self._weights = np.array([getattr(self.config.weights, name) for name in EVIDENCE])

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

    def index(self, descriptions: Sequence[Description], frames: Sequence[MapFrame]) -> None:
        super().index(descriptions, frames)
        self._regions = Regions(self.floors) if self.floors else None
        places = gather_places(
            self._graphs, frames, self._rates, self._places_of if self._regions else None, self.config.merged
        )
        T_world_pano = np.array([frame.T_world_pano[:3] for frame in frames])
        cameras_m = [T_world_pano[list(place.frames), :, 3] for place in places]
        self._place_index = index_places(places, cameras_m, self._rates, self.config.likelihood)
        unknown = np.full(BINS, np.nan, np.float32)
        outline_m = np.array([description.get(OUTLINE, unknown) for description in descriptions])
        self._take_places(ShownPlaces.of(places), T_world_pano, outline_m)
        if self._scenes is not None:
            self._scenes.take(self._shown_graphs())

    def write_index(self, folder: Path) -> None:
        super().write_index(folder)
        shown = self._places
        frames = np.split(shown.frame.astype(np.uint32), shown.start[1:-1])
        rows = (
            {"name": np.array(shown.names[name]), "frames": seen, **objects}
            for name, seen, objects in zip(shown.name, frames, place_rows(self._place_index), strict=True)
        )
        write_columns(folder / _PLACES, rows)
        if self._scenes is not None:
            self._new_scene_index().build(self._shown_graphs(), folder / _SCENES)

    def open_index(self, folder: Path, packed: Columns, frames: SavedFrames) -> None:
        super().open_index(folder, packed, frames)
        self._regions = Regions(self.floors) if self.floors else None
        columns = read_columns(folder / _PLACES, {**_SHOWN_COLUMNS, **PLACE_COLUMNS}).columns
        names, seen = columns["name"], columns["frames"]
        places = ShownPlaces(names.words or (), names.values.astype(int), seen.values.astype(int), seen.start)
        outline_m = np.full((len(packed), BINS), np.nan, np.float32)
        if known := packed.columns.get(PACKED):
            outline_m[np.diff(known.start) > 0] = unpack_outline(known.values.reshape(-1, BINS))
        T_world_pano = frames.poses()
        self._take_places(places, T_world_pano, outline_m)
        self._place_index = read_places(columns, T_world_pano[places.padded, :2, 3])
        if self._scenes is not None:
            self._scenes.open(folder / _SCENES)

    def _take_places(self, places: ShownPlaces, T_world_pano: np.ndarray, outline_m: np.ndarray) -> None:
        """Take in which places there are, of frames (S) that stand at T_world_pano (S, 3, 4) and see the outlines
        outline_m (S, BINS)."""
        self._places, self._frames_m = places, T_world_pano[:, :, 3].copy()
        self._scenes = self._new_scene_index() if len(places) > self.config.candidates else None
        regions = self._regions.places if self._regions else ()
        self._name_of = np.array([*(places.number.get(place, -1) for place in regions), -1])  # -1 of none
        poses = T_world_pano[places.padded]
        yaw_rad = np.arctan2(poses[..., 1, 0], poses[..., 0, 0])
        seen_from = np.concatenate([poses[..., :2, 3], yaw_rad[..., None]], -1)
        range_m = outline_m[places.padded].astype(np.float64)
        range_m[np.arange(range_m.shape[1]) >= np.diff(places.start)[:, None]] = np.nan  # once is enough
        self._outlines = MapOutlines.of(range_m, seen_from)

    def _new_scene_index(self) -> SceneIndex:
        made: SceneIndex = registry().build(SceneIndex.role, self.config.scene_index)
        return made

    def _shown_graphs(self) -> Iterator[SaliencyGraph]:
        """The graphs of the frames of all places, place by place."""
        return (self._graphs[number] for number in self._places.frame)

    def match(self, description: Description) -> Localization:
        if self._is_scaleless(description):
            return super().match(description)
        query = graph_from_arrays(description)
        if not len(query):
            return Localization((), None, LocalizationStatus.NO_OBJECTS)
        found = self._hypotheses(query, description.get(OUTLINE))
        if found is None:
            return Localization((), None, LocalizationStatus.NO_MATCH)
        value = found.evidence @ self._weights
        names, first, row = np.unique(found.name, return_index=True, return_inverse=True)
        score, posed = np.full(len(names), -np.inf), np.full(len(names), -1)
        np.logaddexp.at(score, row, value)
        ascending = np.argsort(value[: len(found.poses)], kind="stable")
        posed[row[ascending]] = ascending  # of each name the best with a pose, which comes last
        order = np.lexsort((first, -score))
        names, score, posed = names[order], score[order], posed[order]
        frames = self._frames_of(names, found.poses, posed)
        ids, bears = [frame.id for frame in frames], [self._places.names[name] for name in names.tolist()]
        places = ranked_places(ids, bears, score.tolist())
        if self._positioner is None:
            return Localization(places, frames[0].T_world_pano, LocalizationStatus.OK)
        share = found.share(posed[0]) if posed[0] >= 0 else np.zeros((0, 0))
        if (share.sum(1) > 0.5).sum() < LEAST_EXPLAINED:
            return Localization(places, None, LocalizationStatus.NO_POSE)
        best = found.poses.take(posed[:1])
        pose, covariance = self._searching.settle(
            found.query, self._place_index, self._rates, best, share, LEAST_COVARIANCE_M
        )
        camera_z_m = frames[0].T_world_pano[2, 3]
        T_world_query = pose_2d(pose.shift_m[0, 0], pose.shift_m[0, 1], pose.yaw_rad[0], camera_z_m)
        return Localization(places, T_world_query, LocalizationStatus.OK, covariance)

    def fits_posterior(self, description: Description) -> bool:
        return not self._is_scaleless(description)  # whose scores are not those that the posterior was fitted to

    def evidence(self, description: Description) -> Evidence | None:
        query = graph_from_arrays(description)
        if self._is_scaleless(description) or not len(query):
            return None
        found = self._hypotheses(query, description.get(OUTLINE))
        if found is None:
            return None
        return Evidence([self._places.names[name] for name in found.name], found.evidence)

    def _is_scaleless(self, description: Description) -> bool:
        """Whether positions in metres are not known of a query."""
        return (
            without_positions(description["centroid_m"]) or getattr(self.config.matcher, "largest_scale_error", 0.0) > 0
        )

    def _hypotheses(self, query: SaliencyGraph, outline_m: np.ndarray | None) -> _Hypotheses | None:
        """What a query of objects may be, None where no place knows any of its labels: the candidates, each under its
        best pose, and other places by their labels."""
        whole = self._place_index
        if not any(label in whole.vocabulary for label in query.labels):
            return None
        asked = lay_out_query(query, whole)
        kept, ranked = self._shortlist(query)
        if not len(kept):
            return None
        found = self._searching.search(asked, whole, kept, self._rates, self.config.likelihood, self.config.poses)
        here, name = kept[found.poses.place], self._places.name
        poses = replace(found.poses, place=here)
        stands = self._names_at(here, poses)
        stood = np.zeros(len(self._places.names), bool)
        stood[stands] = True
        alone = ranked[~stood[name[ranked]]]
        rows = np.concatenate([here, alone])
        evidence = np.zeros((len(rows), len(EVIDENCE)))
        likelihood, outline, panorama = evidence[:, 0], evidence[:, 1], evidence[:, 2]
        likelihood[: len(here)] = np.logaddexp(found.score, found.unplaced[found.poses.place])
        # Of a place that was no candidate, the likelihood is that of the worst.
        row = np.minimum(np.searchsorted(kept, alone), len(kept) - 1)
        likelihood[len(here) :] = np.where(kept[row] == alone, found.unplaced[row], found.unplaced.min())
        if outline_m is not None:
            posed = self._outlines, outline_m, here, poses.shift_m, poses.yaw_rad
            outline[: len(here)] = self._searching.outline_ratio(*posed)
        panorama[:] = self._panorama_scores(query)[name[rows]]
        evidence[:, 3:] = self._searching.label_evidence(asked.label, whole, rows)
        return _Hypotheses(asked, np.concatenate([stands, name[alone]]), evidence, poses, found.share)

    @property
    def _searching(self) -> Any:
        """How places are searched: `search`, or the same compiled."""
        large = self._scenes is not None or getattr(self._index, "scenes", None) is not None
        fast = compilation.compiled("salframe_graphs.places.compiled") if large else None
        return fast or search

    def _shortlist(self, query: SaliencyGraph) -> tuple[np.ndarray, np.ndarray]:
        """The places that are matched object by object (C,), and those that are ranked (R,), both in order: those whose
        scene frames the index puts first, and all of up to RANKED."""
        every, most = np.arange(len(self._places)), self.config.candidates
        if self._scenes is None:
            return every, every
        asked = most if len(every) <= RANKED else max(most, RANKED)
        found = self._scenes.candidates(query, asked * self._places.padded.shape[1])
        places = np.array([*dict.fromkeys(self._places.place[found.scene].tolist())], int)
        return np.sort(places[:most]), every if len(every) <= RANKED else np.sort(places[:asked])

    def _panorama_scores(self, query: SaliencyGraph) -> np.ndarray:
        """(P,) the score of the panorama that is most like a query, by the numbers of places' names, 0 of those that
        have none."""
        best_of = np.zeros(len(self._places.names))
        ranked = self._matcher.rank(query, self._index, self.config.top_k)
        if not len(ranked.scene):
            return best_of
        frames = [self._map_frames[scene] for scene in ranked.scene.tolist()]
        T_world_query = np.array([frame.T_world_pano for frame in frames]) @ ranked.T_scene_query
        score = ranked.score
        if self.config.agreement:
            score = self._searching.agreed(score, T_world_query, self.config.agreement, self.config.agreement_radius_m)
        best = int(np.argmax(score))
        if self.config.nearest_scene:
            near = self._scene_near(frames[best], T_world_query[best])
            if near is not None:
                frames[best] = self._map_frames[near]  # a doorway is no place
        for frame, value in sorted(zip(frames, score.tolist(), strict=True), key=lambda claim: claim[1]):
            if frame.place in self._places.number:
                best_of[self._places.number[frame.place]] = value  # the best comes last
        return best_of

    def _places_of(self, xy_m: np.ndarray, frame: MapFrame) -> list[str | None]:
        """The places that positions (N, 2) which a frame sees lie in."""
        if self._regions is None:
            return [None] * len(xy_m)
        numbers = self._regions.at(xy_m, np.full(len(xy_m), frame.T_world_pano[2, 3]))
        return [self._regions.places[number] if number >= 0 else None for number in numbers.tolist()]

    def _names_at(self, places: np.ndarray, poses: Poses) -> np.ndarray:
        """(C,) the name of the place that each pose stands in: the region's where it is known and on the map, else that
        of the one matched, places (C,)."""
        matched = self._places.name[places]
        if self._regions is None:
            return matched
        height_m = self._frames_m[self._places.frame[self._places.start[places]], 2]
        stands = self._name_of[self._regions.at(poses.shift_m, height_m)]
        return np.where(stands >= 0, stands, matched)

    def _frames_of(self, names: np.ndarray, poses: Poses, row: np.ndarray) -> list[MapFrame]:
        """Of each of some names (N,) the scene frame that is nearest to one of some poses, row (N,), the first where
        that is -1."""
        near_m = np.append(poses.shift_m, [[np.nan, np.nan]], 0)[row]
        nearest = self._places.nearest(names, self._frames_m[:, :2], near_m)
        return [self._map_frames[number] for number in nearest.tolist()]
