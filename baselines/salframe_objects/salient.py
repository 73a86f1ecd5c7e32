"""Base class of localizers over salient objects: detector, saliency model, and the weight of an object."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from salframe.framework.component import ComponentConfig
from salframe.framework.components.registry import registry
from salframe.framework.components.slots import slot
from salframe.graphs.detections import Detections
from salframe.graphs.vocabulary import WRITTEN_LABELS
from salframe.localization.detecting import DetectingLocalizer
from salframe.localization.localizer import Description, LevelledConfig, posterior_slot, range_slot


class SalientObjects(DetectingLocalizer):
    """Base class of localizers over salient objects.

    The weight of an object is w = S^p, with its saliency S and p = `saliency_power`.
    """

    uses: ClassVar[frozenset[str]] = frozenset({"range"})

    class Config(LevelledConfig):
        range: range_slot()  # type: ignore[valid-type]
        detector: slot("detector", "auto")  # type: ignore[valid-type]
        saliency: slot(  # type: ignore[valid-type]
            "saliency", "volumetric", description="saliency model, which computes how much each object stands out"
        )
        saliency_power: float = Field(
            1 / 3,
            ge=0,
            le=100,
            description="exponent p of the weight S^p of an object with the saliency S. 1: the weight is proportional "
            "to the saliency (by default, the share of the volume); 1/3: proportional to the cube root of the "
            "saliency; 0: all objects have the same weight",
        )
        posterior: posterior_slot()  # type: ignore[valid-type]

    def __init__(self, config: ComponentConfig | None = None) -> None:
        super().__init__(config)
        self._saliency = registry().build("saliency", self.config.saliency)

    def weigh_objects(self, detections: Detections) -> np.ndarray:
        """Return the (N,) float64 weight of each object."""
        return self._saliency.score(detections) ** self.config.saliency_power

    def pack(self, description: Description) -> Description:
        """Return the description with floats in single precision, without the labels as the detector wrote them."""
        return {
            name: array.astype(np.float32) if array.dtype == np.float64 else array
            for name, array in description.items()
            if name != WRITTEN_LABELS
        }

    def unpack(self, packed: Description) -> Description:
        return {
            name: array.astype(np.float64) if array.dtype == np.float32 else array for name, array in packed.items()
        }
