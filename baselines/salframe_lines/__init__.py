"""Line baseline: line segments on the sphere and in 3D, their distance functions, and a pose."""

import salframe
from salframe_lines.localizer import Lines


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """Return the localizer `lines`."""
    return [Lines]
