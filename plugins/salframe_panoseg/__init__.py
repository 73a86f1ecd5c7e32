"""The detector `panoseg`: salframe's own network for RGB-D panoramas, its training on rendered buildings, and its export."""

import salframe
from salframe_panoseg.detector import PanoSegDetector


@salframe.hookimpl
def salframe_components() -> list[type]:
    """The `panoseg` detector."""
    return [PanoSegDetector]
