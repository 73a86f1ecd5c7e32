"""The range model `onnx-depth`: a monocular depth network on a panorama, whole or in overlapping views."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import SingleFile
from salframe.framework.errors import ConfigError, WeightsError
from salframe_depth.monocular import UNSEEN, DepthConfig, MonocularDepth, Quantity


class OnnxDepth(MonocularDepth):
    """Runs any monocular depth network in ONNX format, on overlapping views of a panorama or on the whole panorama.

    This component has not been tested with published networks. The depth of each view is scaled so that the views agree
    where they overlap. If the output is known only up to an added constant, this constant is estimated too. The views
    are then merged. The weight of a pixel falls to 0 at the border of its view. With `camera_height_m`, all ranges are
    scaled so that the floor is at this distance below the camera. If no floor is visible, the ranges of a network with
    `metric: true` are not scaled, and those of other networks are unknown.
    """

    name = "onnx-depth"
    version = "1"

    class Config(DepthConfig):
        model: SingleFile | None = Field(None, description="path of the network, an ONNX file; required")
        gives: Quantity = Field(
            "inverse",
            description="quantity that the network outputs. inverse: 1 / depth; z-depth: depth along the optical axis "
            "of the view; range: distance along the ray; points: points (x, y, z)",
        )
        metric: bool = Field(
            False,
            description="true: the output of the network is in metres; false: the scale of the output is unknown. For "
            "inverse and z-depth, an added constant may also be unknown",
        )
        input: Literal["views", "equirectangular"] = Field(
            "views",
            description="images that the network receives. views: perspective views of the panorama; equirectangular: "
            "the whole panorama",
        )
        size_px: tuple[int, int] | None = Field(
            None,
            description="width and height of the network's input (pixels), such as [640, 480]; null: read from "
            "the file of the network",
        )
        channels: Literal["bgr", "rgb"] = Field(
            "rgb", description="order of the colour channels in the network's input. bgr: blue first; rgb: red first"
        )
        scale: float = Field(
            1 / 255,
            gt=0,
            description="factor that multiplies the colours (0 to 255) before normalisation: (colour * scale - mean) "
            "/ std",
        )
        mean: tuple[float, float, float] = Field(
            (0.485, 0.456, 0.406),
            description="value that is subtracted from each scaled colour channel, in the order of `channels`",
        )
        std: tuple[float, float, float] = Field(
            (0.229, 0.224, 0.225),
            description="value that each colour channel is divided by after the subtraction of `mean`, in the order "
            "of `channels`",
        )

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Open the network and run it once.

        Raises:
            WeightsError: The file is not a network, or its input or output does not match the settings.
            ConfigError: The settings are incomplete, or do not determine the scale.
        """
        from salframe.framework.onnx import open_model

        super().__init__(config)
        settings = self.config
        self.quantity, self.metric = settings.gives, settings.metric
        self._check_scale("set metric=true if the network outputs metres")
        if settings.input == "equirectangular" and settings.gives == "z-depth":
            raise ConfigError(
                f"the range model {self.name!r} received gives=z-depth with input=equirectangular, expected "
                "gives=range, inverse or points: a panorama has no optical axis"
            )
        width, height = settings.size_px or (None, None)
        self._model = open_model(settings.model, [(None, 3, height, width)])
        height, width = (
            file_size or setting
            for file_size, setting in zip(self._model.inputs[0].shape[2:], (height, width), strict=True)
        )
        if width is None or height is None:
            example = "[1024, 512]" if settings.input == "equirectangular" else "[518, 518]"
            raise ConfigError(
                f"the network {settings.model} has no fixed input size: set size_px to width and height, such as "
                f"{example}"
            )
        if settings.input == "equirectangular" and width != 2 * height:
            raise ConfigError(
                f"the network {settings.model} takes images of {width} x {height}, expected width = 2 x height "
                "(equirectangular)"
            )
        self.size_px = width, height
        self._run_network(np.full((1, height, width, 3), UNSEEN, np.uint8))

    @classmethod
    def check(cls, config: Any) -> None:
        super().check(config)
        if config.model is None:
            raise WeightsError(
                f"the range model {cls.name!r} has no network: set `model` to the path of an ONNX file", "model=PATH"
            )
        if not config.model.is_file():
            raise WeightsError(
                f"the setting model is {config.model}, which does not exist; expected the path of an ONNX file"
            )

    def _estimate_nearness(self, image: np.ndarray, valid: np.ndarray | None) -> np.ndarray:
        """Estimate 1 / range (h, 2h) float32, in the network's scale, from overlapping views or the whole panorama."""
        if self.config.input == "views":
            return super()._estimate_nearness(image, valid)
        return self._estimate_from_panorama(image)

    def _estimate_from_panorama(self, image: np.ndarray) -> np.ndarray:
        """Estimate 1 / range (h, 2h) float32, in the network's scale, from the whole panorama (H, 2H, 3)."""
        import cv2

        shown = cv2.resize(image, self.size_px, interpolation=cv2.INTER_AREA)
        (depth,) = self._run_network(shown[None])
        with np.errstate(divide="ignore", invalid="ignore"):
            return depth if self.quantity == "inverse" else 1 / depth

    def _run_network(self, images: np.ndarray) -> np.ndarray:
        """Run the network on images (N, height, width, 3) uint8 RGB, and return its output (N, h, w) float32.

        If the network returns points, the output is their distance from the camera.
        """
        ordered = images[..., ::-1] if self.config.channels == "bgr" else images
        scale, mean, std = (
            np.float32(value).reshape(-1, 1, 1) for value in (self.config.scale, self.config.mean, self.config.std)
        )
        outputs = []
        for image in ordered:  # one by one: larger batches take more memory and save no time on a CPU
            batch = image.transpose(2, 0, 1)[None].astype(np.float32, order="C")
            outputs.append(self._read(self._model.run((batch * scale - mean) / std)[0]))
        return np.concatenate(outputs)

    def _read(self, output: np.ndarray) -> np.ndarray:
        shape, points = output.shape, self.config.gives == "points"
        if points and len(shape) == 4 and 3 in (shape[1], shape[3]):
            return np.linalg.norm(output, axis=1 if shape[1] == 3 else 3).astype(np.float32)
        if not points and (len(shape) == 3 or (len(shape) == 4 and 1 in (shape[1], shape[3]))):
            image = output if len(shape) == 3 else output[:, 0] if shape[1] == 1 else output[..., 0]
            return image.astype(np.float32, order="C")
        expected = (
            "(1, 3, height, width) or (1, height, width, 3) of points"
            if points
            else "(1, height, width), (1, 1, height, width) or (1, height, width, 1)"
        )
        raise WeightsError(
            f"the network {self.config.model} returned a first output of shape {shape}, expected {expected}"
        )
