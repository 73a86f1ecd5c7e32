"""Sessions: what the service knows of the pose of a moving robot, from its views and its odometry."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, Protocol

import numpy as np

from salframe.localization.answer_json import answer_json, covariance_json, pose_json
from salframe.localization.answers import Localization
from salframe.serving.limits import Limits
from salframe.serving.problems import Problem


class SessionTracker(Protocol):
    """What a session needs of a tracker."""

    def move(self, odometry: np.ndarray) -> None:
        """Apply a motion (4, 4): the pose of the robot after the motion in its frame before the motion."""

    def observe(self, answer: Localization) -> None:
        """Apply the answer to a view at the present pose."""

    def belief(self) -> SessionBelief:
        """Return what is known of the present pose."""


@dataclass(frozen=True, eq=False)
class SessionBelief:
    """What is known of the pose of a robot.

    Attributes:
        status: tracking, lost, or out-of-map.
        place: Name of the place, None where it is unknown.
        T_world_base: (4, 4) pose of the robot, None where it is unknown.
        covariance: Covariance of the pose as in Localization, None where it is unknown.
    """

    status: str
    place: str | None = None
    T_world_base: np.ndarray | None = None
    covariance: np.ndarray | None = None


@dataclass(eq=False)
class Session:
    """One robot. Its observations are applied one after the other.

    Attributes:
        id: Secret that names the session.
        tracker: The tracker.
        t_s: Time of the last observation, None before the first.
        num_observations: Number of observations.
        places: Candidate places of the last answer, as in the JSON of an answer.
        lock: Held while an observation is applied.
    """

    id: str
    tracker: SessionTracker
    t_s: float | None = None
    num_observations: int = 0
    places: list[dict[str, Any]] = field(default_factory=list)
    used_s: float = field(default_factory=time.monotonic)
    lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    listeners: set[asyncio.Queue[dict[str, Any] | None]] = field(default_factory=set)

    def check_time(self, t_s: float) -> None:
        """Raise Problem 409 unless a time is later than that of the last observation."""
        if self.t_s is not None and t_s <= self.t_s:
            raise Problem(
                HTTPStatus.CONFLICT,
                f"the observation has t_s {t_s!r}, expected a time after the previous observation, {self.t_s!r}",
            )

    def apply(self, t_s: float, odometry: np.ndarray | None, answer: Localization) -> dict[str, Any]:
        """Apply an observation, send the belief to the listeners, and return it as JSON."""
        self.check_time(t_s)
        if odometry is not None:
            self.tracker.move(odometry)
        self.tracker.observe(answer)
        self.t_s, self.num_observations = t_s, self.num_observations + 1
        self.places = answer_json(answer)["places"]
        belief = self.belief_json()
        self._notify(belief)
        return belief

    def belief_json(self) -> dict[str, Any]:
        """Return the belief as JSON."""
        belief = self.tracker.belief()
        pose = belief.T_world_base
        return {
            "status": belief.status,
            "place": belief.place,
            "pose": None if pose is None else pose_json(pose),
            "T_world_base": None if pose is None else pose.tolist(),
            "covariance": covariance_json(belief.covariance),
            "t_s": self.t_s,
            "observations": self.num_observations,
            "places": self.places,
        }

    def close(self) -> None:
        """End the streams of the session."""
        self._notify(None)

    def _notify(self, belief: dict[str, Any] | None) -> None:
        """Put a belief in the queues of the listeners, each of which holds the latest one only."""
        for listener in self.listeners:
            if listener.full():
                listener.get_nowait()
            listener.put_nowait(belief)


class SessionStore:
    """The sessions of the service, a limited number of them. A session without observations ends after some time."""

    def __init__(self, limits: Limits, new_tracker: Callable[[], SessionTracker]) -> None:
        self._limits, self._new_tracker = limits, new_tracker
        self._sessions: dict[str, Session] = {}

    def __len__(self) -> int:
        return len(self._sessions)

    def create(self) -> Session:
        """Return a new session. Raises Problem 503 where there are too many."""
        self.expire()
        if len(self._sessions) >= self._limits.max_sessions:
            oldest_s = min(session.used_s for session in self._sessions.values())
            raise Problem(
                HTTPStatus.SERVICE_UNAVAILABLE,
                f"the server has {len(self._sessions)} sessions, expected at most {self._limits.max_sessions}: end "
                "sessions that are not used",
                retry_after_s=max(1, int(oldest_s + self._limits.idle_s - time.monotonic()) + 1),
            )
        session = Session(secrets.token_urlsafe(16), self._new_tracker())
        self._sessions[session.id] = session
        return session

    def get(self, id: str) -> Session:
        """Return a session and note its use. Raises Problem 404 where there is none."""
        self.expire()
        session = self._sessions.get(id)
        if session is None:
            raise Problem(
                HTTPStatus.NOT_FOUND,
                f"there is no such session: it ended, or was not used for {self._limits.idle_s:g} s; create another "
                "with POST /sessions",
            )
        session.used_s = time.monotonic()
        return session

    def end(self, id: str) -> None:
        """End a session. Raises Problem 404 where there is none."""
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
