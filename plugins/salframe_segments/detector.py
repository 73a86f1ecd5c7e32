"""The detector `segments`: a semantic segmentation network on views of a panorama."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import SingleFile
from salframe.framework.errors import InputMissing, WeightsError
from salframe.framework.files.weights import Download, Link, NetworkWeights, WeightsFile
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.score_calibration import ScoreCalibration
from salframe.graphs.turning import from_near_side
from salframe.panoramas.exposure import correct_dark, exposure_setting
from salframe.panoramas.panorama import Panorama
from salframe_segments.card import card_beside, read_card, shipped_card
from salframe_segments.networks import TFLITE, open_network
from salframe_segments.semantic import UNSEEN, Classes, PixelClasses, classify, find_objects
from salframe_segments.view_scores import Views

_ADE20K_TERMS = "ADE20K, whose images are for research and non-commercial use"
NETWORKS = {
    weights.name: weights
    for weights in (
        NetworkWeights(
            name="ade20k",
            licence="Apache-2.0",
            data=_ADE20K_TERMS,
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
        ),
        NetworkWeights(
            name="ade20k-32",
            licence="Apache-2.0",
            data=_ADE20K_TERMS,
            files=(
                WeightsFile(
                    "deeplabv3_mnv2_ade20k_uint8.tflite",
                    "2d58c681d81b5e181816b81cc815b82edf3daad905b4d7d35afade80aee93b5f",
                    2_348_952,
                ),
            ),
            source=Download(
                ("https://github.com/mlcommons/mobile_models/raw/1f9963316b81a63fdef1040133ae64f6e8879c5b/v0_7/tflite",)
            ),
        ),
    )
}
"""Networks that `salframe weights fetch` downloads, by name. Both are DeepLabv3 on MobileNetV2."""


class SegmentsDetector(Detector):
    """Objects from any semantic segmentation network, whose class scores are averaged over overlapping views.

    Doors and windows are objects too. Range is optional. Without range, the objects have labels, scores and bearings,
    and their positions are NaN.
    """

    name = "segments"
    version = "4"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb"})
    requires = ("ai_edge_litert",)
    extra = "salframe[tflite]"
    weights = tuple(NETWORKS.values())

    class Config(ComponentConfig):
        model: Literal[tuple(NETWORKS)] | SingleFile = Field(  # type: ignore[valid-type]
            "ade20k",
            union_mode="left_to_right",
            description="network. ade20k, with 150 classes, and ade20k-32, with 32 classes: weights that `salframe "
            "weights fetch` downloads; a path: your ONNX or TensorFlow Lite file",
        )
        card: SingleFile | None = Field(
            None,
            description="path of the model card, a YAML file that describes input, output and classes of the network; "
            "null: for ade20k and ade20k-32, the model card of this package; for your file, the YAML file beside it, "
            "such as net.yaml for net.onnx",
        )
        views: int = Field(
            6, ge=1, le=16, description="number of horizontal perspective views that are cut from the panorama"
        )
        tilted_views: int = Field(
            0,
            ge=0,
            le=8,
            description="number of additional views that look up by 60 deg. The same number of views looks down by 60 "
            "deg; 0: only horizontal views",
        )
        fov_deg: float = Field(
            90.0, ge=30, le=120, description="horizontal field of view (degrees) of each perspective view"
        )
        mirrored: bool = Field(
            False,
            description="true: the network runs on each view and on its mirror image, which doubles the time and "
            "makes the results more stable; false: it runs on each view only",
        )
        min_score: float = Field(0.3, ge=0, le=1, description="minimum confidence score of an object (0 to 1)")
        exposure: Literal["auto", "none"] = exposure_setting()

        @model_validator(mode="before")
        @classmethod
        def _card_beside(cls, value: Any) -> Any:
            """Set `card` to the card file beside the network file, so that its content is part of the cache key."""
            if isinstance(value, Mapping) and value.get("card") is None:
                model = value.get("model", "ade20k")
                if isinstance(model, str | Path) and model not in NETWORKS and (card := card_beside(Path(model))):
                    return {**value, "card": str(card)}
            return value

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Open the network and run it once.

        Raises:
            WeightsError: The network does not exist or does not match its model card.
            ConfigError: The model card is invalid.
        """
        super().__init__(config)
        path = _model_path(self.config.model)
        card = shipped_card(path) if self.config.card is None else read_card(self.config.card)
        self._network = open_network(path, card)
        self._classes = Classes.of([(label, card.name_of(label)) for label in card.labels], set(card.fixed.values()))
        self._views = Views(
            self.config.views, self.config.tilted_views, *card.input.size_px, np.radians(self.config.fov_deg)
        )
        width, height = card.input.size_px
        next(self._network.probabilities(np.full((1, height, width, 3), UNSEEN, np.uint8)))

    @property
    def calibration(self) -> ScoreCalibration:
        """Conversion of probabilities to scores."""
        return self._network.card.calibration

    @classmethod
    def requires_in_use(cls, config: Any) -> tuple[str, ...]:
        """Return LiteRT's package, which only TensorFlow Lite networks need."""
        return cls.requires if isinstance(config.model, str) or config.model.suffix == TFLITE else ()

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """Return the downloadable weights that `model` names; empty if `model` is a file."""
        return (NETWORKS[config.model],) if isinstance(config.model, str) else ()

    @from_near_side
    def detect(self, panorama: Panorama) -> Detections:
        """See Detector. Raises InputMissing if the panorama has no colour."""
        return find_objects(
            self.classify(panorama), self._classes, panorama.range_m, self.calibration.score, self.config.min_score
        )

    def classify(self, panorama: Panorama) -> PixelClasses:
        """Return the class of each pixel, on HEIGHT rows and 2 HEIGHT columns.

        Raises:
            InputMissing: The panorama has no colour.
        """
        if panorama.rgb is None:
            raise InputMissing(
                f"{panorama.display_name} has no colour image, which the detector {self.name!r} needs: choose another "
                "detector"
            )
        rgb = correct_dark(panorama.rgb, panorama.valid) if self.config.exposure == "auto" else panorama.rgb
        return classify(rgb, panorama.valid, self._views, self._classes.names, self._view_probabilities)

    def _view_probabilities(self, views: np.ndarray) -> np.ndarray:
        """Return the probabilities (V, h, w, names) float32 of views (V, height, width, 3) uint8 RGB."""
        probabilities = self._classes.join_views(self._network.probabilities(views))
        if self.config.mirrored:
            mirrored = self._classes.join_views(self._network.probabilities(views[:, :, ::-1]))
            probabilities = (probabilities + mirrored[:, :, ::-1]) / 2
        return probabilities


def _model_path(model: str | SingleFile) -> Path:
    """Return the path of a network: downloaded weights with a verified hash, or the user's file.

    Raises:
        WeightsError: The file is missing, or the hash of the downloaded weights is wrong.
    """
    if isinstance(model, str):
        return NETWORKS[model].paths()[0]
    if not model.is_file():
        raise WeightsError(
            f"the setting model is {model}, which does not exist; expected the path of an ONNX or TensorFlow Lite "
            f"file, or one of {', '.join(NETWORKS)}"
        )
    return model
