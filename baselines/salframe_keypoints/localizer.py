"""The localizer `keypoints`: matches the views of a query with a shortlist of reference frames by any FeatureMatcher,
and estimates a pose from the ranges of the matched points."""

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
from salframe.localization.localizer import Description, LevelledConfig, Localizer, range_slot
from salframe.localization.ranking import rank_places
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import sample_nearest
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.perspective import ViewRig, turned_similarity
from salframe_keypoints.feature_matcher import FeatureMatcher, ViewFeatures
from salframe_keypoints.poses import robust_pose
from salframe_keypoints.shortlist import GlobalDescriptors, LocalDescriptors, NetworkDescriptors, split_views

EDGE_PX = 8
"""Margin in pixels along the border of the valid part of a panorama. Keypoints in this margin are ignored, because they
describe the border."""


class Keypoints(Localizer):
    """Matches keypoints between perspective views of the query and of the reference frames.

    The pose is computed from the matched points of a reference frame that have a range.
    """

    name = "keypoints"
    version = "2"
    column_step: ClassVar[int | None] = None  # views of a rotated panorama are sampled at other pixels

    class Config(LevelledConfig):
        features: slot(  # type: ignore[valid-type]
            "feature-matcher", "xfeat", description="feature matcher, which extracts and matches the features of views"
        )
        range: range_slot()  # type: ignore[valid-type]
        views: int = Field(
            6,
            ge=3,
            description="number of horizontal perspective views that are cut from the panorama, evenly spaced in "
            "azimuth",
        )
        view_width_px: int = Field(480, ge=64, le=4096, description="width of each perspective view (pixels)")
        view_height_px: int = Field(352, ge=64, le=4096, description="height of each perspective view (pixels)")
        hfov_deg: float = Field(
            90.0, gt=0, lt=150, description="horizontal field of view (degrees) of each perspective view"
        )
        shortlist_network: slot(  # type: ignore[valid-type]
            "image-network",
            optional=True,
            description="image network that computes one descriptor of each whole view. These descriptors select the "
            "reference frames to match; null: the descriptor of a view is pooled from the descriptors of its keypoints "
            "(VLAD)",
        )
        words: int = match_only(
            64, ge=1, description="number of visual words of VLAD; no effect if shortlist_network is set"
        )
        shortlist: int | None = match_only(
            5,
            ge=1,
            description="number of reference frames whose keypoints are matched with those of the query: the frames "
            "with the most similar descriptors of whole views (see `shortlist_network`); null: all frames",
        )
        inlier_deg: float = match_only(
            1.0,
            gt=0,
            description="maximum error (degrees) of an inlier of a pose: the angle between the observed bearing of a "
            "matched point and the bearing that the pose predicts",
        )
        hypotheses: int = match_only(
            500,
            ge=1,
            description="number of iterations of RANSAC: candidate poses, each computed from a random sample of three "
            "matched points",
        )
        min_inliers: int = match_only(
            20, ge=4, description="minimum number of inliers of a pose. If there are fewer, the pose is rejected"
        )

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Create the matcher. Raises ConfigError if it does not support views of this size."""
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
    """Parts of a panorama that are used if they are present: without range there is a place, but no pose."""

    @property
    def needs(self) -> frozenset[str]:
        return frozenset({"rgb"})

    def describe(self, panorama: Panorama) -> Description:
        """Return the concatenated points of all V views with their features and ranges.

        Returns:
            `points_px` (K, 2), the points in their views; `range_m` (K,) float32, NaN where unknown; `features`, the
            concatenated rows of all views; `point_count` and `feature_count` (V,) int64, the numbers of points and rows
            of each view; and `global` (V, C), global descriptors, if an image network selects the shortlist.
        """
        import cv2

        if panorama.rgb is None:
            raise InputMissing(f"{panorama.display_name} has no colour image, which the method {self.name!r} needs")
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
        """Learn the vocabulary from the map, pool the descriptors of each view, and compute the 3D points."""
        self._frames = list(frames)
        self._map_views = [split_views(description) for description in descriptions]
        self._map_points_m = [self._lift(description) for description in descriptions]
        self._pool, self._map_pooled = self._global.learn(descriptions)

    def match(self, description: Description) -> Localization:
        """Match the frames of the shortlist. The score of a frame is its number of inliers plus its global similarity,
        which is below 1."""
        views, pooled = split_views(description), self._pool(description)
        if not pooled.any():
            return Localization((), None, LocalizationStatus.NO_FEATURES)
        similarity = turned_similarity(pooled, self._map_pooled)
        scores = similarity.max(1).astype(np.float64)
        best_pose, max_support = None, self.config.min_inliers - 1
        for frame in np.argsort(-scores, kind="stable")[: self.config.shortlist]:
            pose, support = self._verify(views, int(frame), int(similarity[frame].argmax()))
            scores[frame] += support
            if pose is not None and support > max_support:
                best_pose, max_support = self._frames[frame].T_world_pano @ pose, support
        return Localization(
            rank_places(self._frames, scores, best_pose),
            best_pose,
            LocalizationStatus.NO_POSE if best_pose is None else LocalizationStatus.OK,
        )

    def verify(self, description: Description, frames: Sequence[int]) -> list[tuple[np.ndarray | None, int]]:
        """Match a query with each of the given reference frames, as `match` does with the frames of its shortlist.

        Args:
            description: The description of the query.
            frames: Indices of F frames in the map.

        Returns:
            For each frame, the pose (4, 4) of the query in this frame (None if it is unknown), and the number of
            inliers.
        """
        views, pooled = split_views(description), self._pool(description)
        turns = turned_similarity(pooled, self._map_pooled[list(frames)]).argmax(1)
        return [self._verify(views, frame, turn) for frame, turn in zip(frames, turns.tolist(), strict=True)]

    def correspond(self, query: Description, reference: Description) -> PointMatches:
        """Return the matches of two panoramas. `match` matches a query in the same way with each candidate frame.

        The relative heading is estimated with a vocabulary that is learned from these two panoramas.
        """
        query_views, reference_views = split_views(query), split_views(reference)
        _, (query_pooled, reference_pooled) = self._global.learn([query, reference])
        turn = int(turned_similarity(query_pooled, reference_pooled[None]).argmax())
        query_bearings, reference_bearings = [], []
        for bearings, j, matched in self._match_views(query_views, reference_views, turn):
            query_bearings.append(bearings)
            reference_bearings.append(self._rig.bearings(j, reference_views[j].points_px[matched]))
        return PointMatches(np.concatenate(query_bearings), np.concatenate(reference_bearings))

    def _match_views(
        self, views: Sequence[ViewFeatures], reference_views: Sequence[ViewFeatures], turn: int
    ) -> Iterator[tuple[np.ndarray, int, np.ndarray]]:
        """Match each view i with the view j = i + turn of the reference.

        Yields:
            Bearings (M, 3) in the query, the index j, and indices (M,) of the matched points of view j.
        """
        for i, view in enumerate(views):
            j = (i + turn) % len(views)
            pixels, matched = self._matcher.match(view, reference_views[j])
            yield self._rig.bearings(i, pixels), j, matched

    def _verify(self, views: Sequence[ViewFeatures], frame: int, turn: int) -> tuple[np.ndarray | None, int]:
        """Return the pose of the query in a reference frame, and the number of inliers.

        The relative heading is assumed to be `turn` views. A frame without range gives no pose, and all its matches
        count as inliers.
        """
        view_bearings, points = [], []
        for bearings, j, matched in self._match_views(views, self._map_views[frame], turn):
            view_bearings.append(bearings)
            points.append(self._map_points_m[frame][j][matched])
        query_bearings, points_m = np.concatenate(view_bearings), np.concatenate(points)
        if not any(np.isfinite(view).any() for view in self._map_points_m[frame]):
            return None, len(query_bearings)
        lifted = np.isfinite(points_m).all(1)
        inlier_rad, rng = np.deg2rad(self.config.inlier_deg), np.random.default_rng(0)
        pose, inliers = robust_pose(query_bearings[lifted], points_m[lifted], inlier_rad, self.config.hypotheses, rng)
        return pose, int(inliers.sum())

    def _lift(self, description: Description) -> list[np.ndarray]:
        """Return the 3D points (K, 3) of each view in the panorama frame, in metres, NaN where the range is unknown."""
        ends = np.cumsum(description["point_count"])[:-1]
        pixels, ranges = np.split(description["points_px"], ends), np.split(description["range_m"], ends)
        return [
            self._rig.bearings(i, px) * range_m[:, None]
            for i, (px, range_m) in enumerate(zip(pixels, ranges, strict=True))
        ]
