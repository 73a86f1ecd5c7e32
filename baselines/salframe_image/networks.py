"""The classification networks that can be fetched."""

from __future__ import annotations

from salframe.framework.weights import Download, Weights, WeightsFile
from salframe_image.efficientnet import EFFICIENTNET_LITE0

RESNET101 = Weights(
    "resnet101",
    "Apache-2.0",
    (
        WeightsFile(
            "resnet101-v1-7.onnx", "760702f6ec0138f71ebac66f4e95d1c72dc9267a8544f4d4667a53075fd0497c", 178_914_043
        ),
    ),
    Download(
        (
            "https://huggingface.co/onnxmodelzoo/resnet101-v1-7/resolve/main",
            "https://media.githubusercontent.com/media/onnx/models/e8feddcd242650ccf821323cac6fdfb38fd09a05/vision/classification/resnet/model",
        )
    ),
)
"""ResNet-101 v1 of the ONNX model zoo; the hash is that of the zoo's own Git LFS pointer."""

NETWORKS = {weights.name: weights for weights in (EFFICIENTNET_LITE0, RESNET101)}
