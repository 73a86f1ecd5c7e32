"""The detector `transformers`: published segmentation and detection networks on views of a panorama."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.identity import UserFile
from salframe.framework.errors import ConfigError, InputMissing, WeightsError
from salframe.framework.files.hub import EXTRA
from salframe.framework.files.weights import NetworkWeights
from salframe.framework.pretrained import (
    PretrainedConfig,
    PretrainedModel,
    check_model,
    find_model_folder,
    hub_weights,
    read_model_config,
)
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.image_detections import ImageDetections, merge_views, suppress
from salframe.graphs.turning import from_near_side
from salframe.graphs.vocabulary import vocabulary_names
from salframe.panoramas.coverage import MIN_FOV_DEG, RINGS, Rig
from salframe.panoramas.panorama import Panorama
from salframe_segments.network_labels import fixed_names, graph_name
from salframe_segments.semantic import UNSEEN, Classes, classify, find_objects
from salframe_segments.view_models import NetworkTask, class_probabilities, open_view_model, tasks
from salframe_segments.view_scores import Views

LEVEL_VIEWS = 6
"""Number of horizontal views for semantic networks, as in the detector `segments`."""
OVERLAP = 0.45
"""Maximum intersection over union of two boxes of one class in a view, as in the detector `onnx`. Of boxes with a
larger overlap, only the best one is returned."""
TEXT_MODELS = ("oneformer",)
"""Model types of networks with fixed classes that also take text."""
RING_VIEWS = sum(count for count, _ in RINGS)
"""Number of views that cover the sphere."""
EMPTY = ImageDetections(np.zeros((0, 4)), np.zeros(0), np.zeros(0, int))
"""Detections of a view that shows nothing."""


class TransformersDetector(Detector):
    """Objects from a published segmentation or detection network of the library `transformers`.

    The network may be for semantic, instance, panoptic or universal segmentation, or for closed-set or zero-shot
    detection. Range is optional. Without range, the objects have labels, scores and bearings, and their positions are
    NaN.
    """

    name = "transformers"
    version = "2"
    needs: ClassVar[frozenset[str]] = frozenset({"rgb"})
    requires = ("torch", "transformers")
    extra = EXTRA

    class Config(PretrainedConfig):
        labels: tuple[str, ...] | UserFile | None = Field(
            None,
            union_mode="left_to_right",
            description="labels that a zero-shot network searches for. Such a network receives the labels as text, so "
            "it can search for any object. a list: your labels; a path: the folder of a saved map, whose object labels "
            "are used; null: the names in salframe's vocabulary. A network with fixed labels requires null",
        )
        fov_deg: float = Field(
            90.0,
            ge=MIN_FOV_DEG,
            le=120,
            description="field of view (degrees) across the shorter side of each perspective view",
        )
        min_score: float = Field(0.3, gt=0, le=1, description="minimum confidence score of an object (0 to 1)")

    def __init__(self, config: ComponentConfig | None = None) -> None:
        """Load the network and run it once.

        Raises:
            WeightsError: A file is missing, or the network is of a kind that is not supported.
            ConfigError: The labels, the size or the device are not valid.
        """
        super().__init__(config)
        folder = find_model_folder(self.config.model)
        content, known = read_model_config(folder), tasks()
        zero_shot = any(known.get(name) is NetworkTask.ZERO_SHOT for name in content.get("architectures") or ())
        if self.config.labels is not None and not zero_shot:
            raise ConfigError(
                f"the setting `labels` has a value, but the network in {folder} has fixed labels: set labels=null, or "
                "use a zero-shot network (a network that takes labels as input)"
            )
        takes_text = zero_shot or content.get("model_type") in TEXT_MODELS
        model = PretrainedModel(folder, known, self.config.device, self.config.size_px, takes_text=takes_text)
        self._objects: AveragedViews | MergedViews = (
            AveragedViews(model, self.config.fov_deg, self.config.min_score)
            if known[model.architecture] is NetworkTask.SEMANTIC
            else MergedViews(
                model, self.config.fov_deg, self.config.min_score, _labels(self.config.labels) if zero_shot else ()
            )
        )

    @classmethod
    def weights_in_use(cls, config: Any) -> tuple[NetworkWeights, ...]:
        """Return the downloaded model of the hub that `model` names; empty if `model` is a folder."""
        return hub_weights(config)

    @classmethod
    def check(cls, config: Any) -> None:
        super().check(config)
        check_model(f"the detector {cls.name!r}", config)

    @from_near_side
    def detect(self, panorama: Panorama) -> Detections:
        """See Detector. Raises InputMissing if the panorama has no colour."""
        if panorama.rgb is None:
            raise InputMissing(
                f"{panorama.display_name} has no colour image, which the detector {self.name!r} needs: choose another "
                "detector"
            )
        return self._objects.detect(panorama.rgb, panorama.valid, panorama.range_m)


class AveragedViews:
    """Objects from a semantic segmentation network: class probabilities averaged over six horizontal views, as in the
    detector `segments`."""

    def __init__(self, model: PretrainedModel, fov_deg: float, min_score: float) -> None:
        """Run the network once. Raises WeightsError if its output does not match its labels."""
        self._model, self._min_score = model, min_score
        labels = model.labels()
        self._classes = Classes.of([(label, graph_name(label)) for label in labels], fixed_names())
        self._views = Views(LEVEL_VIEWS, 0, *model.size_px, np.radians(fov_deg))
        (probabilities,) = class_probabilities(model, _blank(model))
        if probabilities.shape[-1] != len(labels):
            raise WeightsError(
                f"{model.folder} returned {probabilities.shape[-1]} classes, expected {len(labels)}, one for each "
                "label of its config.json"
            )

    def detect(self, rgb: np.ndarray, valid: np.ndarray | None, range_m: np.ndarray | None) -> Detections:
        """Return the objects of a panorama from its colour (H, 2H, 3), mask (H, 2H) and range (H, 2H) in metres."""
        pixels = classify(rgb, valid, self._views, self._classes.names, self._view_probabilities)
        return find_objects(pixels, self._classes, range_m, lambda probability: probability, self._min_score)

    def _view_probabilities(self, views: np.ndarray) -> np.ndarray:
        return self._classes.join_views(class_probabilities(self._model, views))


class MergedViews:
    """Objects from boxes or masks in sixteen views that cover the sphere, merged as in the detector `onnx`."""

    def __init__(self, model: PretrainedModel, fov_deg: float, min_score: float, labels: Sequence[str]) -> None:
        """Open the network and run it once. A zero-shot network searches for `labels`; other networks ignore them."""
        self._model = open_view_model(model, min_score, labels)
        self._rig = Rig(*model.size_px, np.radians(fov_deg))
        self._model.detect(_blank(model))

    def detect(self, rgb: np.ndarray, valid: np.ndarray | None, range_m: np.ndarray | None) -> Detections:
        """Return the objects of a panorama from its colour (H, 2H, 3), mask (H, 2H) and range (H, 2H) in metres."""
        shown = np.ones(RING_VIEWS, bool)
        if valid is not None:
            rgb = np.where(valid[..., None], rgb, np.uint8(UNSEEN))
            grid = self._rig.grid(len(rgb))
            shown = np.any(grid.visible[:, grid.thin(valid)], axis=1)
        detections = [EMPTY] * RING_VIEWS
        shown_detections = self._model.detect(self._rig.cut(rgb)[shown])
        for view, view_detections in zip(np.flatnonzero(shown), shown_detections, strict=True):
            detections[view] = suppress(view_detections, OVERLAP)
        return merge_views(detections, self._model.names, self._rig, len(rgb), range_m)


def _labels(labels: tuple[str, ...] | UserFile | None) -> tuple[str, ...]:
    """Return the labels that a zero-shot network searches for.

    Raises:
        ConfigError: A label is empty or occurs twice, or there is none.
        DataError: The setting is a folder that is not a map.
    """
    from salframe.localization.map_files import map_labels

    if labels is None:
        return vocabulary_names()
    names = map_labels(labels) if isinstance(labels, UserFile) else labels
    if not names or not all(name.strip() for name in names) or len(set(names)) < len(names):
        bad = "no label"
        if names:
            wrong = next(name for name in names if not name.strip() or names.count(name) > 1)
            bad = f"the label {wrong!r} twice" if wrong.strip() else f"the empty label {wrong!r}"
        raise ConfigError(f"the setting labels has {bad}, expected one or more different labels that are not empty")
    return names


def _blank(model: PretrainedModel) -> np.ndarray:
    """Return a view (1, height, width, 3) uint8 without content."""
    return np.full((1, *model.size_px[::-1], 3), UNSEEN, np.uint8)
