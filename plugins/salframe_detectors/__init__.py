"""Objects from pixels: perspective detectors on panoramas."""

import salframe


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """The role `detection-decoder`, what fills it, and the detector `onnx`."""
    from salframe_detectors.decoders import Detr, RtDetr, Yolov5, Yolov8, Yolov8Seg, Yolox
    from salframe_detectors.detection_decoder import DetectionDecoder
    from salframe_detectors.detector import OnnxDetector

    return [DetectionDecoder, Yolox, Yolov5, Yolov8, Yolov8Seg, Detr, RtDetr, OnnxDetector]
