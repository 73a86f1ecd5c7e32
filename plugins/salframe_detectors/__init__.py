"""Object detectors: perspective detection networks on panoramas."""

import salframe


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """Return the role `detection-decoder` with its implementations, and the detectors `onnx` and `union`."""
    from salframe_detectors.decoders import Detr, RtDetr, Yolov5, Yolov8, Yolov8Seg, Yolox
    from salframe_detectors.detection_decoder import DetectionDecoder
    from salframe_detectors.detector import OnnxDetector
    from salframe_detectors.union import UnionDetector

    return [DetectionDecoder, Yolox, Yolov5, Yolov8, Yolov8Seg, Detr, RtDetr, OnnxDetector, UnionDetector]
