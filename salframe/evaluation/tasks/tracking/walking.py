"""The worker of the task `tracking`: localizes the views of walks, and feeds the answers to trackers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from salframe.evaluation.runs.rows import PieceStatus, Row
from salframe.evaluation.runs.task import Worker
from salframe.evaluation.tasks.tracking.options import Belief, Observed
from salframe.evaluation.tasks.tracking.walks import NUM_VIEWS, Walk
from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.files.cache import Cache
from salframe.localization.answers import Localization
from salframe.localization.described_query import DescribedView, describe_view
from salframe.localization.localizer import Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.tracker import TrackedPose, TrackStatus
from salframe.localization.tracking import ViewWindow, open_tracker
from salframe.navigation.world import World
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import MIN_STOREY_GAP_M
from salframe.panoramas.geometry import invert_pose, pose_yaw, wrap_angle
from salframe.panoramas.opening import reference_frames
from salframe.panoramas.query_motion import OdometryErrors, measured_motion

NUM_KIDNAPPED = 8
"""Number of views that are taken after the camera was moved without odometry."""


class _WalkStep(NamedTuple):
    """A view with its true pose and place, the measured motion since the view before, and the answer."""

    pose: np.ndarray
    place: str
    motion: np.ndarray
    answer: Localization


class Tracking(Worker[Walk]):
    """Tracks the camera of walks, once for each belief (way to estimate the pose)."""

    def __init__(
        self,
        method: ComponentConfig,
        dataset: Dataset,
        other: Dataset | None,
        worlds: Mapping[str, World],
        kidnapped: Mapping[str, Walk],
        beliefs: Mapping[str, Belief],
        odometry: OdometryErrors,
        num_views: int,
        seed: int,
    ) -> None:
        """Create the worker.

        Args:
            method: The localizer.
            dataset: The data set.
            other: A data set of another building.
            worlds: The worlds by id.
            kidnapped: Id of a walk -> another walk, to whose start the camera is moved at the end, without odometry.
            beliefs: The beliefs by name.
            odometry: Errors of the measured motion.
            num_views: Number of the latest views that are localized together.
            seed: Seed of the errors.
        """
        self._method, self._dataset, self._other, self._worlds = method, dataset, other, worlds
        self._kidnapped, self._beliefs, self._odometry = kidnapped, beliefs, odometry
        self._num_views, self._seed, self._cache = num_views, seed, Cache()
        self._maps: list[LocalizationMap] = []

    def prepare(self, piece: Walk) -> None:
        if self._maps:
            return
        for dataset in (self._dataset, *([] if self._other is None else [self._other])):
            localizer: Localizer = registry().build(Localizer.role, self._method)
            frames, floors = reference_frames(dataset), dataset.floors()
            self._maps.append(LocalizationMap.build(localizer, frames, self._cache, dataset.content_key, floors=floors))

    def work(self, piece: Walk) -> Row:
        here, *elsewhere = self._maps
        views, moved = self._describe(piece, NUM_VIEWS), self._kidnapped[piece.id]
        motions = self._motions(piece, 0)
        later = [np.eye(4), *self._motions(moved, 1)[1:NUM_KIDNAPPED]]  # the move is not measured
        window = ViewWindow(here, self._num_views)
        steps = list(_steps(window, piece, views, motions))
        kidnapped = list(_steps(window, moved, self._describe(moved, NUM_KIDNAPPED), later))
        other = [step for map in elsewhere for step in _steps(ViewWindow(map, self._num_views), piece, views, motions)]
        beliefs = {}
        for name, belief in self._beliefs.items():
            lines = [*_follow(here, belief, [*steps, *kidnapped])]
            rest = [line for map in elsewhere for line in _follow(map, belief, other)]
            beliefs[name] = {"walk": lines[:NUM_VIEWS], "kidnapped": lines[NUM_VIEWS:], "elsewhere": rest}
        return {"start": piece.places[0], "beliefs": beliefs, "status": PieceStatus.OK, "error": None}

    def _describe(self, walk: Walk, count: int) -> list[DescribedView]:
        """Describe the first views of a walk."""
        localizer, content = self._maps[0].localizer, self._dataset.content_key
        views = walk.views(self._worlds[walk.world], content)
        return [describe_view(localizer, view, self._cache) for view, _ in zip(views, range(count), strict=False)]

    def _motions(self, walk: Walk, part: int) -> list[np.ndarray]:
        """Return the measured motion before each view of a walk; the identity before the first."""
        T_last_view = np.stack([invert_pose(walk.poses[-1]) @ pose for pose in walk.poses])
        measured = measured_motion(T_last_view, self._odometry, (self._seed, 6, part, walk.number))
        return [np.eye(4), *(invert_pose(a) @ b for a, b in pairwise(measured))]


def _steps(
    window: ViewWindow, walk: Walk, views: Sequence[DescribedView], motions: Sequence[np.ndarray]
) -> Iterator[_WalkStep]:
    """Yield the steps of the first views of a walk. `window` localizes the latest views together."""
    for number, (view, motion) in enumerate(zip(views, motions, strict=True)):
        window.move(motion)
        yield _WalkStep(walk.poses[number], walk.places[number], motion, window.localize(view))


def _follow(map: LocalizationMap, belief: Belief, steps: Sequence[_WalkStep]) -> Iterator[Row]:
    """Yield the belief after each step, compared with the truth."""
    tracker, has_started = open_tracker(map, belief.tracker), False
    for step in steps:
        tracker.move(step.motion)
        if belief.answers is not Observed.FIRST or not has_started:
            tracker.observe(step.answer)
        has_started = has_started or step.answer.T_world_query is not None
        if belief.answers is Observed.LATEST:
            yield _compare_answer(step)
        else:
            yield _compare(tracker.belief(), step)


def _compare_answer(step: _WalkStep) -> Row:
    """Return the fields of BeliefLine for an answer without a tracker. The support is the probability of the first
    place. Without probabilities, it is the score of the first place, or 0 if the score is negative."""
    answer = step.answer
    if not answer.places:
        return {"tracking": False, "support": 0.0, "right": False}
    first = answer.places[0]
    return {
        "tracking": answer.accepted is not False,
        "support": max(first.score, 0.0) if first.probability is None else first.probability,
        "right": first.place == step.place,
        **_pose_errors(answer.T_world_query, None, step.pose),
    }


def _compare(believed: TrackedPose, step: _WalkStep) -> Row:
    """Return the fields of BeliefLine for the belief of a tracker."""
    return {
        "tracking": believed.status is TrackStatus.TRACKING,
        "support": believed.support,
        "right": believed.place == step.place,
        **_pose_errors(believed.T_world_pano, believed.covariance, step.pose),
    }


def _pose_errors(pose: np.ndarray | None, covariance: np.ndarray | None, T_world_pano: np.ndarray) -> Row:
    """Return the fields of BeliefLine that are errors of a pose. Empty without a pose. The error of the position is
    horizontal; if the pose is on another storey, it contains the error of the height."""
    if pose is None:
        return {}
    x, y, z = pose[:3, 3] - T_world_pano[:3, 3]
    turn = float(wrap_angle(pose_yaw(pose) - pose_yaw(T_world_pano)))
    height_m = z if abs(z) >= MIN_STOREY_GAP_M else 0.0
    position_m = float(np.linalg.norm([x, y, height_m]))
    errors: Row = {"position_m": position_m, "heading_deg": float(np.degrees(abs(turn)))}
    if covariance is not None:
        error = np.array([x, y, turn])
        errors["nees"] = float(error @ np.linalg.pinv(covariance) @ error)
    return errors
