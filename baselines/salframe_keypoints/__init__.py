"""Keypoint baselines: features of perspective views, matched against a shortlist, with a pose from depth-lifted
matches."""

import salframe
from salframe_keypoints.localizer import Keypoints


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """The `keypoints` localizer."""
    return [Keypoints]
