"""The role `saliency`: scores how much an object stands out (docs/explanation/method.md#from-panorama-to-graph)."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from salframe.framework.component import Role
from salframe.graphs.detections import Detections


class SaliencyModel(Role):
    """Computes the saliency of each object: how much the object stands out among the objects of its panorama."""

    role = "saliency"

    @abstractmethod
    def score(self, detections: Detections) -> np.ndarray:
        """Return the saliency of each object, (N,) float64: numbers that are at least 0 and sum to 1."""
