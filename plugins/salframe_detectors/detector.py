"""The detector `onnx`: a perspective detection network on overlapping views of a panorama."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import SingleFile
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.framework.errors import ConfigError, InputMissing, WeightsError
from salframe.framework.files.weights import NetworkWeights
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.image_detections import ImageDetections, merge_views, suppress
from salframe.graphs.turning import from_near_side
from salframe.panoramas.coverage import MIN_FOV_DEG, Rig
from salframe.panoramas.panorama import Panorama
from salframe_detectors.detection_decoder import DecodeRequest, DetectionDecoder
from salframe_detectors.zoo import COCO_80, ZOO, read_class_names

BATCH = 4
"""Number of views per run of a network with a free batch axis. Larger batches take more memory and save no time on a
CPU."""


class OnnxDetector(Detector):
    """Runs any ONNX detection network on overlapping perspective views of a panorama, and merges the detections.

    The views cover the sphere. Range is optional. Without range, the objects have labels, scores and bearings, and
    their positions are NaN.
    """

    name = "onnx"
    version = "3"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb"})
    weights = tuple(ZOO.values())

    class Config(ComponentConfig):
        model: Literal[tuple(ZOO)] | SingleFile = Field(  # type: ignore[valid-type]
            "yolox-nano",
            union_mode="left_to_right",
            description=f"network. {', '.join(ZOO)}: weights that `salframe weights fetch` downloads; a path: your "
            "ONNX file",
        )
        decoder: slot("detection-decoder", "yolox", description="decoder for the output format of the network")  # type: ignore[valid-type]
        labels: Literal["coco-80"] | tuple[str, ...] | SingleFile = Field(
            "coco-80",
            union_mode="left_to_right",
            description="class labels in the order of the network's outputs. coco-80: the 80 classes of COCO; a list: "
            "your labels; a path: a YAML file with a list under the key `names`",
        )
        size_px: tuple[int, int] | None = Field(
            None,
            description="width and height of the network's input (pixels), such as [640, 480]; null: read from "
            "the file of the network",
        )
        channels: Literal["bgr", "rgb"] = Field(
            "bgr", description="order of the colour channels in the network's input. bgr: blue first; rgb: red first"
        )
        scale: float = Field(
            1.0,
            gt=0,
            description="factor that multiplies the colours (0 to 255) before normalisation: (colour * scale - mean) "
            "/ std",
        )
        mean: tuple[float, float, float] = Field(
            (0.0, 0.0, 0.0),
            description="value that is subtracted from each scaled colour channel, in the order of `channels`",
        )
        std: tuple[float, float, float] = Field(
            (1.0, 1.0, 1.0),
            description="value that each colour channel is divided by after the subtraction of `mean`, in the order "
            "of `channels`",
        )
        fill: int = Field(
            114, ge=0, le=255, description="grey value (0 to 255) of the pixels that a partial panorama does not show"
        )
        min_score: float = Field(0.3, gt=0, le=1, description="minimum confidence score of a detection (0 to 1)")
        overlap: float = Field(
            0.45,
            gt=0,
            lt=1,
            description="threshold of non-maximum suppression: minimum intersection over union (IoU) of two boxes in "
            "a view that count as the same object. Only the box with the better score remains",
        )
        fov_deg: float = Field(
            90.0,
            ge=MIN_FOV_DEG,
            le=120,
            description="field of view (degrees) across the shorter side of each perspective view",
        )

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Open the network and run it once.

        Raises:
            WeightsError: The file is not a network, or its input or output does not match the settings.
            ConfigError: The input size is unknown.
        """
        from salframe.framework.onnx import open_model

        super().__init__(config)
        self._path = _model_path(self.config.model)
        self._decoder: DetectionDecoder = registry().build("detection-decoder", self.config.decoder)
        self._labels = _class_labels(self.config.labels)
        width, height = self.config.size_px or (None, None)
        self._model = open_model(self._path, [(None, 3, height, width)])
        height, width = (
            file_size or setting
            for file_size, setting in zip(self._model.inputs[0].shape[2:], (height, width), strict=True)
        )
        if width is None or height is None:
            raise ConfigError(
                f"the network {self._path} has no fixed input size: set size_px to width and height, such as [640, 640]"
            )
        self._request = DecodeRequest(width, height, len(self._labels), self.config.min_score)
        self._rig = Rig(width, height, np.radians(self.config.fov_deg))
        self._detect_views(np.full((1, height, width, 3), self.config.fill, np.uint8))

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """Return the downloadable weights that `model` names; empty if `model` is a file."""
        return (ZOO[config.model],) if isinstance(config.model, str) else ()

    @from_near_side
    def detect(self, panorama: Panorama) -> Detections:
        if panorama.rgb is None:
            raise InputMissing(
                f"{panorama.display_name} has no colour image, which the detector {self.name!r} needs: choose another "
                "detector"
            )
        image = panorama.rgb
        if panorama.valid is not None:
            image = np.where(panorama.valid[..., None], image, np.uint8(self.config.fill))
        detections = self._detect_views(self._rig.cut(image))
        return merge_views(detections, self._labels, self._rig, len(image), panorama.range_m)

    def _detect_views(self, views: np.ndarray) -> list[ImageDetections]:
        """Run the network on views (V, height, width, 3) uint8 RGB and return the detections of each view."""
        detections = []
        ordered = views[..., ::-1] if self.config.channels == "bgr" else views
        scale, mean, std = (
            np.float32(value).reshape(-1, 1, 1) for value in (self.config.scale, self.config.mean, self.config.std)
        )
        for first in range(0, len(views), BATCH):
            batch = ordered[first : first + BATCH].transpose(0, 3, 1, 2).astype(np.float32, order="C")
            batch *= scale
            batch -= mean
            batch /= std
            try:
                detections += self._decoder.decode(self._model.run(batch), self._request)
            except WeightsError as error:
                raise WeightsError(f"{self._path}: {error}") from None
        return [suppress(view_detections, self.config.overlap) for view_detections in detections]


def _class_labels(labels: str | tuple[str, ...] | SingleFile) -> tuple[str, ...]:
    """Return the class labels of a network from the setting `labels`. Raises ConfigError if a file is not valid."""
    if isinstance(labels, SingleFile):
        return read_class_names(labels)
    return COCO_80 if isinstance(labels, str) else labels


def _model_path(model: str | SingleFile) -> Path:
    """Return the path of a network: downloaded weights with a verified hash, or the user's file.

    Raises:
        WeightsError: The file is missing, or the hash of the downloaded weights is wrong.
    """
    if isinstance(model, str):
        return ZOO[model].paths()[0]
    if not model.is_file():
        raise WeightsError(
            f"the setting model is {model}, which does not exist; expected the path of an ONNX file, or one of "
            f"{', '.join(ZOO)}"
        )
    return model
