"""The tracker of sessions: votes of localizations that odometry moves to the present."""

from __future__ import annotations

import numpy as np

from salframe.localization.answers import Localization
from salframe.navigation.agent import Belief, Located
from salframe.serving.sessions import SessionBelief


class VotingTracker:
    """Tracks a robot by the votes of its accepted answers, as the agent of `navigate` does."""

    def __init__(self) -> None:
        self._belief = Belief(yaw_rad=0.0)
        self._place: str | None = None
        self._is_outside = False

    def move(self, odometry: np.ndarray) -> None:
        self._belief.add_motion(odometry)

    def observe(self, answer: Localization) -> None:
        self._is_outside = answer.status.denies_the_map
        if answer.accepted is False or answer.T_world_query is None:
            return
        best = answer.places[0]
        self._place = best.place
        votes = best.score if best.probability is None else best.probability
        self._belief.add_localization(Located(answer.T_world_query, votes))

    def belief(self) -> SessionBelief:
        pose = self._belief.pose
        if pose is None:
            return SessionBelief("out-of-map" if self._is_outside else "lost")
        return SessionBelief("tracking", self._place, pose)
