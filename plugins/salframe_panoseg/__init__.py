"""The detector `panoseg`: salframe's own network for RGB-D panoramas, its training on rendered buildings, and its
export."""

import salframe


@salframe.hookimpl
def salframe_provides():
    from salframe_panoseg.detector import PanoSegDetector

    return [PanoSegDetector]
