"""Objects as a labelled data set tells them, with the errors that a detector would make."""

import salframe
from salframe_annotations.detector import AnnotationDetector


@salframe.hookimpl
def salframe_provides():
    return [AnnotationDetector]
