"""Objects from pixels: perspective detectors on panoramas."""

import salframe


@salframe.hookimpl
def salframe_provides():
    from salframe_detectors.detector import OnnxDetector

    return [OnnxDetector]
