"""Objects from pixels: perspective detectors on panoramas."""

import salframe


@salframe.hookimpl
def salframe_components():
    from salframe_detectors.detector import OnnxDetector

    return [OnnxDetector]
