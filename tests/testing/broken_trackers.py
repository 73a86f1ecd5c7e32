"""A tracker that conforms to the rules of its role, and some that break one rule each."""

from __future__ import annotations

import numpy as np

from salframe.localization.tracker import TrackedPose, Tracker, TrackStatus


class Following(Tracker):
    """Follows odometry from an answer that two answers agree with, and is lost after ten failed answers."""

    name = "following"
    version = "1"

    def __init__(self, config=None):
        super().__init__(config)
        self._pose, self._place, self._last, self._failed = None, None, None, 0

    def move(self, odometry):
        odometry = np.eye(4) if odometry is None else odometry
        self._pose = None if self._pose is None else self._pose @ odometry
        self._last = None if self._last is None else self._last @ odometry

    def observe(self, answer):
        pose = answer.T_world_query
        self._failed = self._failed + 1 if pose is None else 0
        if pose is not None and (self._last is None or np.linalg.norm(self._last - pose) < 0.3):
            self._pose, self._place = pose, answer.places[0].place
        self._last = pose

    def belief(self):
        if self._pose is None:
            return TrackedPose(TrackStatus.LOST)
        status = TrackStatus.LOST if self._failed >= 10 else TrackStatus.TRACKING
        return TrackedPose(status, self._place, self._pose)


class Standing(Following):
    """Broken."""

    def move(self, odometry):
        pose = self._pose
        super().move(odometry)
        self._pose = pose


class Gullible(Following):
    """Broken."""

    def observe(self, answer):
        self._last = None
        super().observe(answer)


class Stubborn(Following):
    """Broken."""

    def observe(self, answer):
        if self._pose is None:
            super().observe(answer)


class Confident(Following):
    """Broken."""

    def observe(self, answer):
        super().observe(answer)
        self._failed = 0


class Drifting(Following):
    """Broken."""

    def belief(self):
        belief = super().belief()
        if self._pose is not None:
            self.move(np.diag([1.0, 1, 1, 1]) + np.eye(4, k=3))
        return belief


class Requiring(Following):
    """Broken."""

    def move(self, odometry):
        super().move(odometry @ np.eye(4))
