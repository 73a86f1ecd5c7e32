"""The detector `segments`: a semantic segmentation network on views of a panorama."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import SingleFile
from salframe.framework.errors import InputMissing, WeightsError
from salframe.framework.files.weights import Link, NetworkWeights, WeightsFile
from salframe.graphs.boxes import detections_where_known
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.pixels import without_strays
from salframe.graphs.turning import from_near_side
from salframe.panoramas.geometry import equirectangular_rays, pixel_solid_angles
from salframe.panoramas.panorama import Panorama
from salframe_segments.card import Calibration, Card, card_beside, read_card, shipped_card
from salframe_segments.instances import find_instances
from salframe_segments.networks import TFLITE, open_network
from salframe_segments.voting import HEIGHT, Views, vote

UNSEEN = 114
"""Grey value of the pixels that a partial panorama does not cover."""
MAX_SCORES = 160
"""Maximum number of rows and columns of a view's scores that vote: more than a panorama of 512 x 256 can resolve."""

ADE20K = NetworkWeights(
    name="ade20k",
    licence="Apache-2.0",
    data="ADE20K, whose images are for research and non-commercial use",
    files=(
        WeightsFile(
            "lite-model_deeplabv3-mobilenetv2-ade20k_1_default_1.tflite",
            "9476784566f88bf0bdc3169f0012fb7d08857b325811d8c1aaf5ada1c0d4e4f9",
            2_415_896,
        ),
    ),
    # TensorFlow Hub moved to Kaggle: the first address redirects, the second hosts its TensorFlow Lite files.
    source=Link(
        (
            "https://tfhub.dev/sayakpaul/lite-model/deeplabv3-mobilenetv2-ade20k/1/default/1?lite-format=tflite",
            "https://storage.googleapis.com/tfhub-lite-models/sayakpaul/lite-model/deeplabv3-mobilenetv2-ade20k/1/default/1.tflite",
        )
    ),
)


@dataclass(frozen=True, eq=False)
class PixelClasses:
    """The most likely class of each pixel of a panorama.

    Attributes:
        names: Class names: objects have their names in the graph, structure those of the network.
        class_id: Index (H, W) int32 into names.
        probability: Probability (H, W) float32 of that class.
        valid: Mask (H, W) bool, False where there is no view or the panorama is not valid.
    """

    names: tuple[str, ...]
    class_id: np.ndarray
    probability: np.ndarray
    valid: np.ndarray


class SegmentsDetector(Detector):
    """Objects from any network with class scores per pixel, averaged over overlapping views; doors and windows are
    objects.

    Works with colour only; then bearings, labels and scores are known, and positions are NaN.
    """

    name = "segments"
    version = "1"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb"})
    requires = ("ai_edge_litert",)
    extra = "salframe[tflite]"
    weights = (ADE20K,)

    class Config(ComponentConfig):
        model: Literal["ade20k"] | SingleFile = Field(
            "ade20k",
            union_mode="left_to_right",
            description="path of an ONNX or TensorFlow Lite file, or name of weights to download: ade20k",
        )
        card: SingleFile | None = Field(
            None,
            description="path of the network's model card; null: NAME.yaml beside the network's file, else the card "
            "that salframe ships for the file",
        )
        views: int = Field(6, ge=1, le=16, description="number of horizontal perspective views cut from the panorama")
        tilted_views: int = Field(
            0,
            ge=0,
            le=8,
            description="number of additional views that look up by 60 deg, and of those that look down by 60 deg",
        )
        fov_deg: float = Field(
            90.0, ge=30, le=120, description="horizontal field of view of each perspective view (degrees)"
        )
        mirrored: bool = Field(
            False,
            description="true: the network also runs on mirrored views, which takes twice the time and gives more "
            "stable results; false: only on the views themselves",
        )
        min_score: float = Field(0.3, ge=0, le=1, description="minimum confidence score of an object (0 to 1)")

        @model_validator(mode="before")
        @classmethod
        def _card_beside(cls, value: Any) -> Any:
            """Set the card beside the network explicitly, so that its content is part of the identity."""
            if isinstance(value, Mapping) and value.get("card") is None:
                model = value.get("model", "ade20k")
                if isinstance(model, str | Path) and model != "ade20k" and (card := card_beside(Path(model))):
                    return {**value, "card": str(card)}
            return value

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Open the network and run it once.

        Raises:
            WeightsError: The network does not exist or does not match its card.
            ConfigError: The card is invalid.
        """
        super().__init__(config)
        path = _model_path(self.config.model)
        card = shipped_card(path) if self.config.card is None else read_card(self.config.card)
        self._network = open_network(path, card)
        self._classes = Classes.of(card)
        self._views = Views(
            self.config.views, self.config.tilted_views, *card.input.size_px, np.radians(self.config.fov_deg)
        )
        width, height = card.input.size_px
        next(self._network.probabilities(np.full((1, height, width, 3), UNSEEN, np.uint8)))

    @property
    def calibration(self) -> Calibration:
        """Conversion of probabilities to scores."""
        return self._network.card.calibration

    @classmethod
    def requires_in_use(cls, config: Any) -> tuple[str, ...]:
        """Return LiteRT's package, which only TensorFlow Lite networks need."""
        return cls.requires if config.model == "ade20k" or config.model.suffix == TFLITE else ()

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """Return the downloadable weights that `model` names; none if it is a file."""
        return cls.weights if config.model == "ade20k" else ()

    @from_near_side
    def detect(self, panorama: Panorama) -> Detections:
        """See Detector. Raises InputMissing if the panorama has no colour."""
        pixel_classes = self.classify(panorama)
        rays = equirectangular_rays(HEIGHT)
        area_sr = np.broadcast_to(pixel_solid_angles(HEIGHT)[:, None], pixel_classes.valid.shape)
        points_m = None
        if panorama.range_m is not None:
            points_m = rays * _downsample(panorama.range_m)[..., None]
        # Pixels that are not valid get class 0, no object.
        class_id = np.where(pixel_classes.valid, pixel_classes.class_id, 0)
        instances = find_instances(class_id, self._classes.is_object, self._classes.is_fixed, points_m, area_sr)
        labels, scores, bearing, solid_angle_sr, masks, clouds = [], [], [], [], [], []
        for pixel_indices in instances:
            weight = area_sr.flat[pixel_indices]
            mean = float(np.average(pixel_classes.probability.flat[pixel_indices], weights=weight))
            score = self.calibration.score(mean)
            if score < self.config.min_score:
                continue
            labels.append(pixel_classes.names[int(class_id.flat[pixel_indices[0]])])
            scores.append(score)
            towards = weight @ rays.reshape(-1, 3)[pixel_indices]
            bearing.append(towards / np.linalg.norm(towards))
            solid_angle_sr.append(weight.sum())
            masks.append(rays.reshape(-1, 3)[pixel_indices])
            if points_m is not None:
                points = points_m.reshape(-1, 3)[pixel_indices]
                points = points[np.isfinite(points).all(1)]
                clouds.append(without_strays(points) if len(points) else points)
        return detections_where_known(
            labels,
            np.array(scores),
            None if points_m is None else clouds,
            np.array(bearing).reshape(-1, 3),
            np.array(solid_angle_sr),
            masks,
        )

    def classify(self, panorama: Panorama) -> PixelClasses:
        """Return the class of each pixel, on HEIGHT rows and 2 HEIGHT columns.

        Raises:
            InputMissing: The panorama has no colour.
        """
        if panorama.rgb is None:
            raise InputMissing(f"{panorama.id} has no colour, which the detector {self.name!r} needs")
        image, valid, shown = panorama.rgb, np.ones((HEIGHT, 2 * HEIGHT), bool), np.ones(self._views.count, bool)
        if panorama.valid is not None:
            image = np.where(panorama.valid[..., None], image, np.uint8(UNSEEN))
            valid = _downsample(panorama.valid.astype(np.uint8)) > 0
            shown = self._views.visible_views(valid)
        if not shown.any():
            zeros = np.zeros(valid.shape, np.float32)
            return PixelClasses(self._classes.names, zeros.astype(np.int32), zeros, zeros > 0)
        views = self._views.cut(image)[shown]
        probabilities = self._view_probabilities(views)
        if self.config.mirrored:
            probabilities = (probabilities + self._view_probabilities(views[:, :, ::-1])[:, :, ::-1]) / 2
        mean, weight = vote(self._views, shown, probabilities)
        class_id = mean.argmax(-1)
        probability = np.take_along_axis(mean, class_id[..., None], -1)[..., 0]
        return PixelClasses(self._classes.names, class_id.astype(np.int32), probability, valid & (weight > 0))

    def _view_probabilities(self, views: np.ndarray) -> np.ndarray:
        """Return the probabilities (V, h, w, names) float32 of views (V, height, width, 3) uint8 RGB."""
        return np.stack([self._classes.join(_subsample(scores)) for scores in self._network.probabilities(views)])


@dataclass(frozen=True, eq=False)
class Classes:
    """Classes of the graph, and their relation to the network's classes. Classes with the same name are merged.

    Attributes:
        names: Class names; the first, "", is no object.
        index: Index (C,) int into names of each of the network's classes.
        is_object, is_fixed: Whether each name is an object, and a part of the building: (names,) bool.
    """

    names: tuple[str, ...]
    index: np.ndarray
    is_object: np.ndarray
    is_fixed: np.ndarray

    @classmethod
    def of(cls, card: Card) -> Classes:
        name_by_class = [card.name_of(label) or label for label in card.labels]
        names = ("", *dict.fromkeys(name_by_class))
        objects = {name for label in card.labels if (name := card.name_of(label))}
        fixed = {card.fixed[label] for label in card.labels if label in card.fixed}
        return cls(
            names,
            np.array([names.index(name) for name in name_by_class]),
            np.array([name in objects for name in names]),
            np.array([name in fixed for name in names]),
        )

    def join(self, probabilities: np.ndarray) -> np.ndarray:
        """Sum the probabilities (h, w, C) of the classes with the same name: (h, w, names) float32."""
        joined = np.zeros((*probabilities.shape[:2], len(self.names)), np.float32)
        names, first = np.unique(self.index, return_index=True)
        joined[..., names] = probabilities[..., first]
        for other in np.setdiff1d(np.arange(len(self.index)), first):
            joined[..., self.index[other]] += probabilities[..., other]
        return joined


def _model_path(model: str | SingleFile) -> Path:
    """Return the path of a network: verified downloaded weights, or the user's file. Raises WeightsError."""
    if isinstance(model, str):
        return ADE20K.paths()[0]
    if not model.is_file():
        raise WeightsError(f"no file {model}, expected the path of an ONNX or TensorFlow Lite file, or ade20k")
    return model


def _subsample(scores: np.ndarray) -> np.ndarray:
    """Subsample scores (h, w, C) to at most MAX_SCORES evenly spaced rows and columns."""
    for axis in (0, 1):
        length = scores.shape[axis]
        if length > MAX_SCORES:
            scores = scores.take(((np.arange(MAX_SCORES) + 0.5) * length / MAX_SCORES).astype(int), axis)
    return scores


def _downsample(image: np.ndarray) -> np.ndarray:
    """Resize an image (H, 2H) of ranges or a mask to HEIGHT rows by nearest-neighbour sampling."""
    import cv2

    return cv2.resize(image, (2 * HEIGHT, HEIGHT), interpolation=cv2.INTER_NEAREST)
