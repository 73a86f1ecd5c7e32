"""The detector `panoseg`: a segmentation network for RGB-D panoramas, run with onnxruntime."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import UserFile
from salframe.framework.errors import InputMissing, WeightsError
from salframe.framework.files.reading import read_json
from salframe.framework.files.weights import NetworkWeights, Shipped, WeightsFile
from salframe.framework.onnx import open_model
from salframe.framework.validation import validate
from salframe.graphs.boxes import detections_from_points
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.pixels import without_strays
from salframe.graphs.score_calibration import ScoreCalibration
from salframe.graphs.turning import from_near_side
from salframe.panoramas.exposure import correct_dark, exposure_setting
from salframe.panoramas.geometry import column_azimuth, equirectangular_rays
from salframe.panoramas.panorama import Panorama
from salframe_panoseg.classes import CHANNELS, HEIGHT, network_input, smaller
from salframe_panoseg.objects import group_pixels

NETWORK, CARD = "panoseg.onnx", "panoseg.json"
OUTPUTS = ("class_id", "score", "vote_m")

PANOSEG = NetworkWeights(
    name="panoseg",
    licence="Apache-2.0",
    files=(
        WeightsFile(NETWORK, "c8308cd62db4fb23a765fc9c07821d3e02416bc7b281d6ca8946967635d4b8a2", 12_345_511),
        WeightsFile(CARD, "d50002b188b82e846101d0b0a547a368ad354e0e669d4b0fff7f4b71129ed39c", 42_365),
    ),
    source=Shipped(Path(__file__).parent),
)


class PanoSegDetector(Detector):
    """Objects from colour and range, by a segmentation network that is part of salframe.

    The network was trained on rendered buildings.
    """

    name = "panoseg"
    version = "6"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb", "range"})
    weights = (PANOSEG,)

    class Config(ComponentConfig):
        model: UserFile | None = Field(
            None,
            description="path of the folder with a network that you trained; null: the network that is part of "
            "salframe",
        )
        min_score: float = Field(
            0.04,
            ge=0,
            le=1,
            description="minimum score of an object (0 to 1). The score is the probability that the object's label "
            "and position are correct",
        )
        exposure: Literal["auto", "none"] = exposure_setting()

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        network, card = PANOSEG.paths(self.config.model)
        self._model = open_model(network, [(1, CHANNELS, HEIGHT, 2 * HEIGHT)], OUTPUTS)
        content = _card(card)
        self._labels = ["", *content.labels]
        self.calibration = content.calibration
        """Conversion of mean class probabilities to scores."""

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """Return the shipped weights; none if the user's own network is used."""
        return cls.weights if config.model is None else ()

    @from_near_side
    def detect(self, panorama: Panorama) -> Detections:
        """See Detector. Raises InputMissing if the panorama has no colour or no range."""
        if panorama.rgb is None or panorama.range_m is None:
            images = {"rgb": "colour image", "range": "range image"}
            missing = " and no ".join(name for part, name in images.items() if part not in panorama.provides)
            other = "another detector" if panorama.rgb is None else "the detector 'onnx', which needs only colour"
            raise InputMissing(
                f"{panorama.display_name} has no {missing}, which the detector {self.name!r} needs: choose {other}"
            )
        range_m = smaller(panorama.range_m)
        valid = np.isfinite(range_m)
        if panorama.valid is not None:
            valid &= smaller(panorama.valid.astype(np.uint8)) > 0
        rgb = correct_dark(panorama.rgb, panorama.valid) if self.config.exposure == "auto" else panorama.rgb
        class_id, score, vote_m = (output[0] for output in self._model.run(network_input(rgb, panorama.range_m)[None]))
        points_m = equirectangular_rays(HEIGHT) * np.nan_to_num(range_m)[..., None]
        objects = group_pixels(class_id, points_m, points_m + into_panorama(vote_m), valid)
        return self._detections(objects, class_id, score, points_m)

    def _detections(
        self, objects: np.ndarray, class_id: np.ndarray, score: np.ndarray, points_m: np.ndarray
    ) -> Detections:
        pixels = np.flatnonzero(objects)
        order = pixels[np.argsort(objects.flat[pixels], kind="stable")]
        instances = np.split(order, np.cumsum(np.bincount(objects.flat[pixels])[1:])[:-1]) if len(pixels) else []
        labels, scores, clouds = [], [], []
        for pixels in instances:
            of_object = self.calibration.score(float(score.flat[pixels].mean()))
            if of_object >= self.config.min_score:
                labels.append(self._labels[int(class_id.flat[pixels[0]])])
                scores.append(of_object)
                clouds.append(without_strays(points_m.reshape(-1, 3)[pixels]))
        return detections_from_points(labels, np.array(scores), clouds)


@dataclass(frozen=True)
class _ModelCard:
    """The part of a model card that detection uses: the label of each class from 1, and the conversion to scores."""

    labels: list[str]
    calibration: ScoreCalibration


def _card(path: Path) -> _ModelCard:
    """Read the model card beside a network. Raises WeightsError."""
    content = read_json(path)
    labels = content.get("labels") if isinstance(content, dict) else None
    if not isinstance(labels, list) or not all(isinstance(label, str) for label in labels):
        raise WeightsError(
            f"{path} has no list `labels`, expected the model card (description of the network) that the training of "
            "panoseg wrote"
        )
    return _ModelCard(labels, validate(ScoreCalibration, content.get("calibration", {}), f"{path}: calibration"))


def into_panorama(vote_m: np.ndarray) -> np.ndarray:
    """Convert the offsets (3, H, W) that the network predicts to the panorama frame: (H, W, 3).

    An offset leads from the point of a pixel to the centre of the pixel's object. The three coordinates that the
    network predicts are horizontally away from the camera, to the left, and up.
    """
    azimuth = column_azimuth(vote_m.shape[2])
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    along, left, up = vote_m
    return np.stack([along * cosine - left * sine, along * sine + left * cosine, up], -1)


def from_panorama(offset_m: np.ndarray) -> np.ndarray:
    """Inverse of `into_panorama`: convert offsets (H, W, 3) in the panorama frame to the network's output (3, H, W)."""
    azimuth = column_azimuth(offset_m.shape[1])
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    x, y, z = np.moveaxis(offset_m, -1, 0)
    return np.stack([x * cosine + y * sine, y * cosine - x * sine, z])
