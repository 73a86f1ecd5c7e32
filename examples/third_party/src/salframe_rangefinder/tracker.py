"""Tracking by odometry from confirmed answers."""

import numpy as np

import salframe

MAX_DISTANCE_M, MAX_FAILED = 0.3, 10


class ConfirmedAnswers(salframe.Tracker):
    """Starts at the latest answer that agrees with the answer before it, and follows the odometry from there."""

    name = "confirmed-answers"
    version = "1"

    def __init__(self, config=None):
        super().__init__(config)
        self._place, self._pose, self._last, self._failed = None, None, None, 0

    def move(self, odometry):
        if odometry is None:  # the motion is unknown: the next answer has nothing to agree with
            self._last = None
            return
        self._pose = None if self._pose is None else self._pose @ odometry
        self._last = None if self._last is None else self._last @ odometry

    def observe(self, answer):
        pose = answer.T_world_query
        self._failed = self._failed + 1 if pose is None else 0
        if pose is not None and self._agrees(pose):
            self._pose, self._place = pose, answer.places[0].place
        self._last = pose

    def belief(self):
        if self._pose is None:
            return salframe.TrackedPose(salframe.TrackStatus.LOST)
        place = self._place if self.find_place is None else self.find_place(self._pose[:3, 3])
        status = salframe.TrackStatus.LOST if self._failed >= MAX_FAILED else salframe.TrackStatus.TRACKING
        return salframe.TrackedPose(status, place, self._pose)

    def _agrees(self, pose):
        if self._last is None:
            return self._pose is None
        return np.linalg.norm(self._last[:3, 3] - pose[:3, 3]) <= MAX_DISTANCE_M
