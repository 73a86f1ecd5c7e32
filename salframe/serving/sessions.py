"""Sessions: each tracks the pose of one moving robot from its views and its odometry."""

from __future__ import annotations

import asyncio
import secrets
import threading
import time
from http import HTTPStatus
from typing import Any

import numpy as np

from salframe.localization.answer_json import answer_json, covariance_json, pose_json
from salframe.localization.answers import Localization
from salframe.localization.tracker import Tracker
from salframe.localization.tracking import NUM_VIEWS, ViewWindow, open_tracker
from salframe.panoramas.geometry import translation
from salframe.serving.limits import ServiceLimits
from salframe.serving.localizing import ServedView
from salframe.serving.problems import Problem
from salframe.serving.served_map import ServedMap


class Session:
    """The session of one robot. Its observations are processed one after the other.

    Attributes:
        id: Secret identifier of the session.
        tracker: The tracker of the pose of the base of the robot.
        t_s: Time of the last observation in seconds; None before the first observation.
        num_observations: Number of observations.
        belief: The belief (estimated pose and status) after the last observation, as JSON.
        used_s: Time of the last use, by `time.monotonic`.
        lock: Lock that is held while an observation is processed.
        listeners: Queues of the open streams. They receive each new belief, and None at the end of the session.
    """

    def __init__(self, id: str, served: ServedMap) -> None:
        self.id = id
        self.t_s: float | None = None
        self.num_observations = 0
        self.used_s = time.monotonic()
        self.lock = asyncio.Lock()
        self.listeners: set[asyncio.Queue[dict[str, Any] | None]] = set()
        self._mutex = threading.Lock()
        self._position_m = np.zeros(3)
        self._served: ServedMap | None = None
        self.tracker: Tracker
        self._window: ViewWindow
        self._use_map(served)
        self.belief = self._describe_belief(None)

    def check_time(self, t_s: float) -> None:
        """Raise Problem 409 if a time is not later than the time of the last observation."""
        if self.t_s is not None and t_s <= self.t_s:
            raise Problem(
                HTTPStatus.CONFLICT,
                f"the observation has t_s {t_s!r}, expected a later time than that of the previous "
                f"observation, {self.t_s!r}",
            )

    def observe(
        self, served: ServedMap, described: ServedView, t_s: float, odometry: np.ndarray | None
    ) -> Localization:
        """Update the tracker by a motion and a view.

        The latest views are localized together, as in `salframe track`.

        Args:
            served: The map. If it is another version than for the last view, the earlier views are discarded.
            described: The view.
            t_s: Time of the view in seconds.
            odometry: (4, 4) motion of the base since the last observation; None: unknown.

        Returns:
            The answer to the latest views. Its pose is the pose of the base of the robot.

        Raises:
            Problem: The time is not later than the time of the last observation.
            DataError: The files of the map were changed during the call. The session stays unchanged.
        """
        with self._mutex:  # the thread of a request that exceeded its time limit may still run
            self.check_time(t_s)
            if self._served is not served:
                self._use_map(served)
            answer = self._localize(served, described, odometry)
            self.tracker.move(odometry)
            self.tracker.observe(answer)
            self._position_m = described.query.position_m
            self.t_s, self.num_observations = t_s, self.num_observations + 1
            self.belief = self._describe_belief(answer)
        return answer

    def _localize(self, served: ServedMap, described: ServedView, odometry: np.ndarray | None) -> Localization:
        """Return the answer to the latest views. After an error, the earlier views are discarded."""
        position_m, between = described.query.position_m, None
        if odometry is not None:  # compute the motion of the camera; its axes are parallel to the base
            between = translation(-self._position_m) @ odometry @ translation(position_m)
        try:
            self._window.move(between)
            return self._window.localize(described.view).moved(position_m)
        except BaseException:
            self._window = ViewWindow(served.localization, NUM_VIEWS)
            raise

    def _use_map(self, served: ServedMap) -> None:
        fresh = open_tracker(served.localization)
        if self._served is None:
            self.tracker = fresh
        else:
            self.tracker.find_place = fresh.find_place
        self._served, self._window = served, ViewWindow(served.localization, NUM_VIEWS)

    def _describe_belief(self, answer: Localization | None) -> dict[str, Any]:
        """Return the belief after an answer as JSON."""
        belief = self.tracker.belief()
        pose = belief.T_world_pano
        return {
            "status": belief.status,
            "place": belief.place,
            "pose": None if pose is None else pose_json(pose),
            "T_world_base": None if pose is None else pose.tolist(),
            "covariance": covariance_json(belief.covariance),
            "t_s": self.t_s,
            "observations": self.num_observations,
            "places": [] if answer is None else answer_json(answer)["places"],
        }

    def notify(self) -> None:
        """Send the belief (estimated pose and status) to the listeners."""
        self._notify(self.belief)

    def close(self) -> None:
        """End the streams of the session."""
        self._notify(None)

    def _notify(self, belief: dict[str, Any] | None) -> None:
        """Put a belief into the queue of each listener. A queue holds only the latest belief."""
        for listener in self.listeners:
            if listener.full():
                listener.get_nowait()
            listener.put_nowait(belief)


class SessionStore:
    """The sessions of the service. Their number is limited. A session that is not used for some time ends."""

    def __init__(self, limits: ServiceLimits) -> None:
        self._limits = limits
        self._sessions: dict[str, Session] = {}

    def __len__(self) -> int:
        return len(self._sessions)

    def create(self, served: ServedMap) -> Session:
        """Return a new session in a map. Raises Problem 503 if there are too many sessions."""
        self.expire()
        if len(self._sessions) >= self._limits.max_sessions:
            oldest_s = min(session.used_s for session in self._sessions.values())
            raise Problem(
                HTTPStatus.SERVICE_UNAVAILABLE,
                f"the server has {len(self._sessions)} sessions, the maximum number: end unused sessions, or try "
                "again later",
                retry_after_s=max(1, int(oldest_s + self._limits.idle_s - time.monotonic()) + 1),
            )
        session = Session(secrets.token_urlsafe(16), served)
        self._sessions[session.id] = session
        return session

    def get(self, id: str) -> Session:
        """Return a session, and record its use. Raises Problem 404 if there is no session with this id."""
        self.expire()
        session = self._sessions.get(id)
        if session is None:
            raise Problem(
                HTTPStatus.NOT_FOUND,
                f"no session has this id (sessions end after {self._limits.idle_s:g} s without use): "
                "create a session with POST /sessions",
            )
        session.used_s = time.monotonic()
        return session

    def end(self, id: str) -> None:
        """End a session. Raises Problem 404 if there is no session with this id."""
        self.get(id).close()
        del self._sessions[id]

    def expire(self) -> None:
        """End the sessions that were not used for some time."""
        last_s = time.monotonic() - self._limits.idle_s
        for id, session in list(self._sessions.items()):
            if session.used_s < last_s and not session.lock.locked():
                session.close()
                del self._sessions[id]

    def close(self) -> None:
        """End all sessions."""
        for session in self._sessions.values():
            session.close()
        self._sessions.clear()
