"""Detections from the annotations of a labelled data set, with simulated detector errors."""

import salframe
from salframe_annotations.detector import AnnotationDetector


@salframe.hookimpl
def salframe_provides():
    return [AnnotationDetector]
