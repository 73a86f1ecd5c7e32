"""The detector `segments`: objects from semantic segmentation networks."""

import salframe


@salframe.hookimpl
def salframe_provides():
    from salframe_segments.detector import SegmentsDetector

    return [SegmentsDetector]
