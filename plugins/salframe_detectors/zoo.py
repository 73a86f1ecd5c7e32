"""Detection networks that users can download, and their labels."""

from __future__ import annotations

from pathlib import Path

from salframe.framework.config import read_yaml
from salframe.framework.errors import ConfigError, shorten
from salframe.framework.files.weights import Download, NetworkWeights, WeightsFile

YOLOX_RELEASE = Download(("https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0",))

ZOO = {
    weights.name: weights
    for weights in (
        NetworkWeights(
            "yolox-nano",
            "Apache-2.0",
            (
                WeightsFile(
                    "yolox_nano.onnx", "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d", 3_659_407
                ),
            ),
            YOLOX_RELEASE,
        ),
        NetworkWeights(
            "yolox-tiny",
            "Apache-2.0",
            (
                WeightsFile(
                    "yolox_tiny.onnx", "427cc366d34e27ff7a03e2899b5e3671425c262ea2291f88bb942bc1cc70b0f7", 20_219_662
                ),
            ),
            YOLOX_RELEASE,
        ),
        NetworkWeights(
            "yolox-s",
            "Apache-2.0",
            (
                WeightsFile(
                    "yolox_s.onnx", "c5c2d13e59ae883e6af3b45daea64af4833a4951c92d116ec270d9ddbe998063", 35_858_002
                ),
            ),
            YOLOX_RELEASE,
        ),
    )
}
"""YOLOX networks (Ge et al., arXiv 2107.08430) by name. The input is BGR with values from 0 to 255. The labels are
COCO_80."""

COCO_80 = (
    "person",
    "bicycle",
    "car",
    "motorcycle",
    "airplane",
    "bus",
    "train",
    "truck",
    "boat",
    "traffic light",
    "fire hydrant",
    "stop sign",
    "parking meter",
    "bench",
    "bird",
    "cat",
    "dog",
    "horse",
    "sheep",
    "cow",
    "elephant",
    "bear",
    "zebra",
    "giraffe",
    "backpack",
    "umbrella",
    "handbag",
    "tie",
    "suitcase",
    "frisbee",
    "skis",
    "snowboard",
    "sports ball",
    "kite",
    "baseball bat",
    "baseball glove",
    "skateboard",
    "surfboard",
    "tennis racket",
    "bottle",
    "wine glass",
    "cup",
    "fork",
    "knife",
    "spoon",
    "bowl",
    "banana",
    "apple",
    "sandwich",
    "orange",
    "broccoli",
    "carrot",
    "hot dog",
    "pizza",
    "donut",
    "cake",
    "chair",
    "couch",
    "potted plant",
    "bed",
    "dining table",
    "toilet",
    "tv",
    "laptop",
    "mouse",
    "remote",
    "keyboard",
    "cell phone",
    "microwave",
    "oven",
    "toaster",
    "sink",
    "refrigerator",
    "book",
    "clock",
    "vase",
    "scissors",
    "teddy bear",
    "hair drier",
    "toothbrush",
)
"""The 80 classes of COCO in the order of COCO."""


def read_class_names(path: Path) -> tuple[str, ...]:
    """Read the class labels of a network from the key `names` of a YAML file: a list, or a mapping from 0, 1, 2, ...

    The dataset files of Ultralytics have this key.

    Raises:
        ConfigError: The file cannot be read, or has no such list.
    """
    names = read_yaml(path).get("names")
    if isinstance(names, dict) and set(names) == set(range(len(names))):
        names = [names[number] for number in range(len(names))]
    if not (isinstance(names, list) and names and all(isinstance(name, str) for name in names)):
        raise ConfigError(
            f"{path}: the key `names` contains {shorten(str(names))}, expected a list of labels in the order of the "
            "network's outputs, or a mapping from 0, 1, 2, ... to labels"
        )
    return tuple(names)
