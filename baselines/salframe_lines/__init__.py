"""Line baseline: line segments on the sphere, after LDL and FGPL."""

import salframe


@salframe.hookimpl
def salframe_components() -> list[type]:
    """None yet."""
    return []
