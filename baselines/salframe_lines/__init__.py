"""Line baseline: line segments on the sphere and in the room, their distance functions, and a pose."""

import salframe
from salframe_lines.localizer import Lines


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """The `lines` localizer."""
    return [Lines]
