"""The detectors `segments` and `transformers`: objects from segmentation networks, and from published networks."""

import salframe


@salframe.hookimpl
def salframe_provides():
    from salframe_segments.detector import SegmentsDetector
    from salframe_segments.transformers_detector import TransformersDetector

    return [SegmentsDetector, TransformersDetector]
