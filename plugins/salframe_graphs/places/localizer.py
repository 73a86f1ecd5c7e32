"""The localizer `saliency-places`: a map of places, answered by the likelihood ratio of a place and a pose."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import Field

from salframe.framework.config import ComponentConfig, match_only
from salframe.framework.files import read_arrays, write_arrays
from salframe.framework.identity import UserFile
from salframe.graphs.packing import graph_from_arrays
from salframe.localization.answers import Localization, LocalizationStatus, RankedPlace
from salframe.localization.localizer import Description
from salframe.panoramas.floors import Regions
from salframe.panoramas.frames import MapFrame
from salframe.panoramas.geometry import pose_2d, pose_yaw
from salframe.panoramas.panorama import Panorama
from salframe_graphs.localizer import SaliencyGraphLocalizer
from salframe_graphs.places.hypotheses import best_poses
from salframe_graphs.places.likelihood import PlaceLikelihood, Poses
from salframe_graphs.places.merging import gather_places
from salframe_graphs.places.outline import BINS, MapOutlines, free_outline, pack_outline
from salframe_graphs.places.place_index import index_places, lay_out_query
from salframe_graphs.places.rates import Likelihood, Rates, read_rates, shipped_rates
from salframe_graphs.verification import best_per_candidate

OUTLINE, OUTLINES = "outline_m", "outlines.npz"
LEAST_COVARIANCE_M = 0.02
"""Two objects may agree by luck: no pose is known better an axis."""
LEAST_EXPLAINED = 2
"""A pose takes so many objects that are more likely the place's than clutter."""


class SaliencyPlacesLocalizer(SaliencyGraphLocalizer):
    """Places as the merged objects of their panoramas: found and posed at once, by a likelihood ratio.

    Queries without range, and those whose ranges may be off by a factor (`matcher.largest_scale_error`), are matched
    panorama by panorama as `saliency-graph` does; matcher, positioner and the settings of that localizer are theirs.
    """

    name = "saliency-places"
    version = "1"
    uses_floors = True

    class Config(SaliencyGraphLocalizer.Config):
        outline: bool = Field(
            True, description="remember how far a panorama sees at the height of furniture, and match by it too"
        )
        rates: UserFile | Rates | None = match_only(
            None, description="the detector's errors, or a YAML or JSON file of them; null: those that are shipped"
        )
        likelihood: Likelihood = match_only(Likelihood(), description="what holds whatever the detector")
        merged: bool = match_only(
            True, description="gather the panoramas of a place into one graph; false: each by itself"
        )
        poses: int = match_only(3, ge=1, description="poses that are refined in each place")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        rates = self.config.rates
        self._rates = rates or shipped_rates()
        if isinstance(rates, UserFile):
            self._rates = read_rates(rates)

    def describe(self, panorama: Panorama) -> Description:
        description = super().describe(panorama)
        if not self.config.outline or panorama.range_m is None:
            return description
        return {**description, OUTLINE: free_outline(panorama.range_m)}

    def scene_bytes(self, description: Description) -> int:
        outline = len(pack_outline(description[OUTLINE])) if OUTLINE in description else 0
        return super().scene_bytes(description) + outline

    def index(self, descriptions: Sequence[Description], frames: Sequence[MapFrame]) -> None:
        self._map_frames = list(frames)
        self._graphs = [graph_from_arrays(description) for description in descriptions]
        self._index = None  # of single panoramas, made for the first query without range
        self._regions = Regions(self.floors) if self.floors else None
        self._places = gather_places(
            self._graphs, self._map_frames, self._rates, self._places_of if self._regions else None, self.config.merged
        )
        stood = np.array([frame.T_world_pano[:3, 3] for frame in frames])
        cameras = [stood[list(place.frames)] for place in self._places]
        self._place_index = index_places(self._places, cameras, self._rates, self.config.likelihood)
        self._frames_of: dict[str, list[MapFrame]] = {}
        for place in self._places:
            self._frames_of.setdefault(place.name, []).extend(self._map_frames[number] for number in place.frames)
        self._outlines = self._outlines_of(descriptions)

    def match(self, description: Description) -> Localization:
        query = graph_from_arrays(description)
        if query.bearings_only or getattr(self.config.matcher, "largest_scale_error", 0.0) > 0:  # no metric positions
            if self._index is None:
                self._index = self._matcher.index(self._graphs)
            return super().match(description)
        if not len(query):
            return Localization((), None, LocalizationStatus.NO_OBJECTS)
        if not any(label in self._place_index.vocabulary for label in query.labels):
            return Localization((), None, LocalizationStatus.NO_MATCH)
        asked = lay_out_query(query, self._place_index)
        scorer = PlaceLikelihood(asked, self._place_index, self._rates, self.config.likelihood)
        poses, score, share = scorer.refine(best_poses(asked, self._place_index, scorer, self.config.poses))
        best = best_per_candidate(score, poses.place, 1)
        poses, score, share = poses.take(best), score[best].astype(np.float64), share[best]
        if OUTLINE in description:
            ratio = self._outlines.ratio(description[OUTLINE], poses.place, poses.shift_m, poses.yaw_rad)
            score += self.config.likelihood.outline_weight * ratio
        unplaced = scorer.unplaced()
        values = {place.name: -np.inf for place in self._places}
        for place, alone in zip(self._places, unplaced, strict=True):
            values[place.name] = max(values[place.name], float(alone))
        posed: dict[str, int] = {}
        for row, name in enumerate(self._answers(poses)):
            value = float(np.logaddexp(score[row], unplaced[poses.place[row]]))
            if value > values[name]:
                values[name], posed[name] = value, row
        places = tuple(
            RankedPlace(self._frame_of(name, poses, posed.get(name)).id, name, values[name])
            for name in sorted(values, key=lambda name: -values[name])
        )
        row = posed.get(places[0].place, -1)
        if row < 0 or (share[row].sum(1) > 0.5).sum() < LEAST_EXPLAINED:
            return Localization(places, None, LocalizationStatus.NO_POSE)
        pose, covariance = scorer.settle(poses.take(np.array([row])), share[[row]], LEAST_COVARIANCE_M)
        stood = self._frame_of(places[0].place, poses, row).T_world_pano
        T_world_query = pose_2d(pose.shift_m[0, 0], pose.shift_m[0, 1], pose.yaw_rad[0], stood[2, 3])
        turn = stood[:3, :3] * [[1, 1, 0], [1, 1, 0], [0, 0, 0]] + np.diag([0, 0, 1])
        return Localization(places, T_world_query, LocalizationStatus.OK, turn.T @ covariance @ turn)

    def write_descriptions(self, directory: Path, descriptions: Sequence[Description]) -> None:
        super().write_descriptions(directory, descriptions)
        known = {str(i): description[OUTLINE] for i, description in enumerate(descriptions) if OUTLINE in description}
        write_arrays(directory / OUTLINES, known)

    def read_descriptions(self, directory: Path, count: int) -> Sequence[Description]:
        known = read_arrays(directory / OUTLINES)
        graphs = super().read_descriptions(directory, count)
        return [{**graph, OUTLINE: known[str(i)]} if str(i) in known else graph for i, graph in enumerate(graphs)]

    def _places_of(self, xy_m: np.ndarray, frame: MapFrame) -> list[str | None]:
        """The places that positions (N, 2) which a frame sees lie in."""
        return (
            self._regions.at(xy_m, np.full(len(xy_m), frame.T_world_pano[2, 3]))
            if self._regions
            else [None] * len(xy_m)
        )

    def _answers(self, poses: Poses) -> list[str]:
        """The place that each pose stands in: the region's where it is known and on the map, else the place matched."""
        matched = [self._places[k] for k in poses.place]
        if self._regions is None:
            return [place.name for place in matched]
        height = np.array([self._map_frames[place.frames[0]].T_world_pano[2, 3] for place in matched])
        stands = self._regions.at(poses.shift_m, height)
        return [name if name in self._frames_of else place.name for name, place in zip(stands, matched, strict=True)]

    def _frame_of(self, name: str, poses: Poses, row: int | None) -> MapFrame:
        """The scene frame of a place that is nearest to a pose, the first without one."""
        frames = self._frames_of[name]
        if row is None:
            return frames[0]
        return min(frames, key=lambda frame: float(np.hypot(*(frame.T_world_pano[:2, 3] - poses.shift_m[row]))))

    def _outlines_of(self, descriptions: Sequence[Description]) -> MapOutlines:
        """The outlines of the places' frames."""
        shape = (len(self._places), max(len(place.frames) for place in self._places))
        range_m, seen_from = np.full((*shape, BINS), np.nan), np.zeros((*shape, 3))
        for k, place in enumerate(self._places):
            for column, number in enumerate(place.frames):
                pose = self._map_frames[number].T_world_pano
                range_m[k, column] = descriptions[number].get(OUTLINE, np.nan)
                seen_from[k, column] = (*pose[:2, 3], pose_yaw(pose))
        return MapOutlines.of(range_m, seen_from)
