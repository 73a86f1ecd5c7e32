"""Image networks in ONNX format: networks that salframe can download, and a file of the user."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import SingleFile
from salframe.framework.errors import WeightsError
from salframe.framework.files.weights import Download, NetworkWeights, WeightsFile
from salframe.framework.onnx import open_model
from salframe_image.efficientnet import EFFICIENTNET_LITE0
from salframe_image.image_network import ImageNetwork
from salframe_image.network_input import as_batch

RESNET101 = NetworkWeights(
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
            "https://media.githubusercontent.com/media/onnx/models/e8feddcd242650ccf821323cac6fdfb38fd09a05/vision/classification/resnet/model"
            "",
        )
    ),
)
"""ResNet-101 v1 of the ONNX model zoo. The hash is from the Git LFS pointer of the zoo."""

Colour = tuple[float, float, float]


class OnnxImageNetwork(ImageNetwork):
    """Base class of networks that run in onnxruntime. Subclasses define the file, the output and the colour scaling."""

    class Config(ComponentConfig):
        size_px: int = Field(224, ge=32, le=1024, description="width and height of the network's input (pixels)")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Load the network. Raises WeightsError if it does not accept images of this size."""
        super().__init__(config)
        self._path = self.path(self.config)
        self._model = open_model(self._path, [(None, 3, self.size_px, self.size_px)], self.outputs())

    @classmethod
    def path(cls, config: Any) -> Path:
        """Return the verified file of the network. Raises WeightsError if it is not installed."""
        return cls.weights[0].paths()[0]

    @classmethod
    def check(cls, config: Any) -> None:
        """Raise WeightsError if the network is not installed."""
        super().check(config)
        if not cls.weights_in_use(config):
            cls.path(config)

    def outputs(self) -> tuple[str, ...]:
        """Return a tuple with the name of the output tensor that has the features; empty: the first output."""
        return ()

    def colours(self) -> tuple[Colour, Colour]:
        """Return the mean that is subtracted from red, green and blue (0 to 255), and the divisors."""
        return (127.0, 127.0, 127.0), (128.0, 128.0, 128.0)

    @property
    def size_px(self) -> int:
        """See ImageNetwork."""
        return self.config.size_px

    def embed(self, views: np.ndarray) -> np.ndarray:
        """See ImageNetwork."""
        features = self._model.run(as_batch(views, *self.colours()))[0]
        if features.ndim not in (2, 4):
            raise WeightsError(
                f"the output tensor {self._model.outputs[0]!r} of the network {self._path} has the shape "
                f"{features.shape}; expected features of shape (N, C, h, w) or (N, C)"
            )
        return features


class EfficientNetLite0(OnnxImageNetwork):
    """EfficientNet-Lite0 (Google, 2020). The features are its last feature map."""

    name = "efficientnet-lite0"
    version = "1"
    weights = (EFFICIENTNET_LITE0,)


class ResNet101(OnnxImageNetwork):
    """ResNet-101 v1 of the ONNX model zoo. The features are its last feature map."""

    name = "resnet101"
    version = "1"
    weights = (RESNET101,)

    def outputs(self) -> tuple[str, ...]:
        """Return the last feature map before pooling and classifier."""
        return ("resnetv18_stage4_activation2",)

    def colours(self) -> tuple[Colour, Colour]:
        """Return the mean and standard deviation of ImageNet."""
        return (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)


class OwnNetwork(OnnxImageNetwork):
    """An image network in an ONNX file of your own."""

    name = "onnx"
    version = "1"

    class Config(OnnxImageNetwork.Config):
        model: SingleFile | None = Field(None, description="path of the ONNX file; required")
        output: str | None = Field(
            None,
            description="name of the output tensor that contains the features, of shape (N, C, h, w) or (N, C); null: "
            "the first output",
        )
        mean: Colour = Field(
            (127.0, 127.0, 127.0), description="values that are subtracted from red, green and blue (0 to 255)"
        )
        std: Colour = Field(
            (128.0, 128.0, 128.0),
            description="values that red, green and blue are divided by after the subtraction of `mean`",
        )

    @classmethod
    def path(cls, config: Any) -> Path:
        """See OnnxImageNetwork."""
        if config.model is None or not config.model.is_file():
            received = "the setting model is null" if config.model is None else f"{config.model} is not a file"
            raise WeightsError(f"{received}, expected the path of the ONNX file of an image network", "model=PATH")
        return config.model

    def outputs(self) -> tuple[str, ...]:
        """See OnnxImageNetwork."""
        return () if self.config.output is None else (self.config.output,)

    def colours(self) -> tuple[Colour, Colour]:
        """See OnnxImageNetwork."""
        return self.config.mean, self.config.std
