"""Panoramas rendered at any pose from a textured mesh."""

import salframe


@salframe.hookimpl
def salframe_components() -> list[type]:
    """None yet."""
    return []
