"""The localizer `keypoints`: views matched by any FeatureMatcher, against a shortlist, with a pose from ranges."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig, match_only
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.framework.errors import InputMissing
from salframe.localization.answers import Localization, LocalizationStatus, PointMatches
from salframe.localization.localizer import Description, Localizer, range_slot
from salframe.localization.ranking import rank_places
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import sample_nearest
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.perspective import ViewRig, turned_similarity
from salframe_keypoints.feature_matcher import FeatureMatcher, View
from salframe_keypoints.poses import robust_pose
from salframe_keypoints.shortlist import GlobalDescriptors, LocalDescriptors, NetworkDescriptors, split_views

EDGE_PX = 8
"""Points this close to the end of a partial panorama describe that end rather than the scene; its pixels."""


class Keypoints(Localizer):
    """Keypoint matches between perspective views of panoramas, with a pose from matches whose map side has a range."""

    name = "keypoints"
    version = "2"
    turn_tolerance_m: ClassVar[float] = 0.05  # the views cut the panorama at other pixels once it is turned

    class Config(ComponentConfig):
        features: slot("feature-matcher", "xfeat")  # type: ignore[valid-type]
        range: range_slot()  # type: ignore[valid-type]
        views: int = Field(6, ge=3, description="perspective views around the panorama")
        view_width_px: int = Field(480, ge=64, le=4096)
        view_height_px: int = Field(352, ge=64, le=4096)
        hfov_deg: float = Field(90.0, gt=0, lt=150, description="horizontal field of view of each view")
        shortlist_network: slot(  # type: ignore[valid-type]
            "image-network",
            optional=True,
            description="image network whose features the shortlist is made by; null: the matcher's own local "
            "descriptors, pooled over a vocabulary of the map",
        )
        words: int = match_only(64, ge=1, description="size of that vocabulary")
        shortlist: int | None = match_only(
            5, ge=1, description="reference frames, best by the global descriptor, that are matched in full; null: all"
        )
        inlier_deg: float = match_only(
            1.0, gt=0, description="a match agrees with a pose where its bearing is off by less than this"
        )
        hypotheses: int = match_only(500, ge=1, description="three-point samples that poses are drawn from")
        min_inliers: int = match_only(20, ge=4, description="a pose with fewer agreeing matches is none")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Raises ConfigError where the matcher cannot take views of this size."""
        super().__init__(config)
        width_px, height_px = self.config.view_width_px, self.config.view_height_px
        self._rig = ViewRig(self.config.views, width_px, height_px, np.deg2rad(self.config.hfov_deg))
        self._matcher: FeatureMatcher = registry().build("feature-matcher", self.config.features)
        self._matcher.prepare(width_px, height_px)
        self._global: GlobalDescriptors = LocalDescriptors(self._matcher, self.config.words)
        if self.config.shortlist_network is not None:
            network = registry().build("image-network", self.config.shortlist_network)
            self._global = NetworkDescriptors(network, self.config.views, np.deg2rad(self.config.hfov_deg))

    uses: ClassVar[frozenset[str]] = frozenset({"range"})
    """A pose needs range, the place does not."""

    @property
    def needs(self) -> frozenset[str]:
        return frozenset({"rgb"})

    def describe(self, panorama: Panorama) -> Description:
        """The points of all views one after the other, how many each view has, their features, and the range at each
        point.

        points_px (K, 2); range_m (K,) float32, NaN where unknown; features, their rows of all views; point_count,
        feature_count (V,) int64; global (V, C) where the shortlist is made by an image network.
        """
        import cv2

        if panorama.rgb is None:
            raise InputMissing(f"{panorama.id} has no colour, which {self.name} describes")
        views = self._matcher.extract(self._rig.cut(panorama.rgb))
        if panorama.valid is not None:
            inside = cv2.erode(
                panorama.valid.astype(np.uint8), np.ones((2 * EDGE_PX + 1, 2 * EDGE_PX + 1), np.uint8)
            ).astype(bool)
            views = [
                self._matcher.restrict(view, sample_nearest(inside, self._rig.bearings(i, view.points_px)))
                for i, view in enumerate(views)
            ]
        bearings = np.concatenate([self._rig.bearings(i, view.points_px) for i, view in enumerate(views)])
        range_m = np.full(len(bearings), np.nan, np.float32)
        if panorama.range_m is not None:
            range_m = sample_nearest(panorama.range_m, bearings)
        return {
            "points_px": np.concatenate([view.points_px for view in views]),
            "features": np.concatenate([view.features for view in views]),
            "range_m": range_m,
            "point_count": np.array([len(view.points_px) for view in views]),
            "feature_count": np.array([len(view.features) for view in views]),
            **self._global.describe(panorama.rgb, panorama.valid),
        }

    def index(self, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]) -> None:
        """Learn the vocabulary on the map's features, pool each view over it, and lift the points that have a range."""
        self._map_frames = list(frames)
        self._map_views = [split_views(description) for description in descriptions]
        self._map_points_m = [self._lift(description) for description in descriptions]
        self._pool, self._map_pooled = self._global.learn(descriptions)

    def match(self, description: Description) -> Localization:
        """Match the shortlist in full; a frame scores its agreeing matches plus its global similarity, which is below
        1."""
        views, pooled = split_views(description), self._pool(description)
        if not pooled.any():
            return Localization((), None, LocalizationStatus.NO_FEATURES)
        similarity = turned_similarity(pooled, self._map_pooled)
        scores = similarity.max(1).astype(np.float64)
        best_pose, most = None, self.config.min_inliers - 1
        for frame in np.argsort(-scores, kind="stable")[: self.config.shortlist]:
            pose, support = self._verify(views, int(frame), int(similarity[frame].argmax()))
            scores[frame] += support
            if pose is not None and support > most:
                best_pose, most = self._map_frames[frame].T_world_pano @ pose, support
        return Localization(
            rank_places(self._map_frames, scores, best_pose),
            best_pose,
            LocalizationStatus.NO_POSE if best_pose is None else LocalizationStatus.OK,
        )

    def correspond(self, query: Description, reference: Description) -> PointMatches:
        """The matches of a shortlisted frame, though the turn between the panoramas comes from a vocabulary of these
        two."""
        views, others = split_views(query), split_views(reference)
        _, (pooled, pooled_others) = self._global.learn([query, reference])
        turn = int(turned_similarity(pooled, pooled_others[None]).argmax())
        bearings, bearings_others = [], []
        for seen, j, matched in self._match_views(views, others, turn):
            bearings.append(seen)
            bearings_others.append(self._rig.bearings(j, others[j].points_px[matched]))
        return PointMatches(np.concatenate(bearings), np.concatenate(bearings_others))

    def _match_views(
        self, views: Sequence[View], others: Sequence[View], turn: int
    ) -> Iterator[tuple[np.ndarray, int, np.ndarray]]:
        """Match each view i with the other panorama's view j = i + turn: bearings (M, 3) in the first, j, and (M,)
        positions of points in j."""
        for i, view in enumerate(views):
            j = (i + turn) % len(views)
            pixels, matched = self._matcher.match(view, others[j])
            yield self._rig.bearings(i, pixels), j, matched

    def _verify(self, views: Sequence[View], frame: int, turn: int) -> tuple[np.ndarray | None, int]:
        """T_map_query and how many matches agree with it, the frame being turned by `turn` views.

        Where the frame has no range there is no pose, and all matches count.
        """
        bearings, points = [], []
        for direction, j, matched in self._match_views(views, self._map_views[frame], turn):
            bearings.append(direction)
            points.append(self._map_points_m[frame][j][matched])
        seen, points_m = np.concatenate(bearings), np.concatenate(points)
        if not any(np.isfinite(view).any() for view in self._map_points_m[frame]):
            return None, len(seen)
        lifted = np.isfinite(points_m).all(1)
        inlier_rad, rng = np.deg2rad(self.config.inlier_deg), np.random.default_rng(0)
        pose, inliers = robust_pose(seen[lifted], points_m[lifted], inlier_rad, self.config.hypotheses, rng)
        return pose, int(inliers.sum())

    def _lift(self, description: Description) -> list[np.ndarray]:
        """(K, 3) points of each view in the panorama frame, NaN where the range is unknown."""
        ends = np.cumsum(description["point_count"])[:-1]
        pixels, ranges = np.split(description["points_px"], ends), np.split(description["range_m"], ends)
        return [
            self._rig.bearings(i, px) * range_m[:, None]
            for i, (px, range_m) in enumerate(zip(pixels, ranges, strict=True))
        ]
