"""The detector `panoseg`: salframe's segmentation network for RGB-D panoramas."""

import salframe


@salframe.hookimpl
def salframe_provides():
    from salframe_panoseg.detector import PanoSegDetector

    return [PanoSegDetector]
