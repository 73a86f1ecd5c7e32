"""Trackers of the pose of a moving camera."""

import salframe
from salframe_trackers.votes import VoteTracker


@salframe.hookimpl
def salframe_provides():
    return [VoteTracker]
