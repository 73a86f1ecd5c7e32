"""The role that the localizer `image` is built around: what a network makes of an image."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from salframe.framework.component import Role


class ImageNetwork(Role):
    """Makes features of an image that tell what it shows."""

    role = "image-network"
    conformance = "salframe_image.conformance:check_image_network"

    @property
    @abstractmethod
    def size_px(self) -> int:
        """Width and height of the images that it takes."""

    @abstractmethod
    def embed(self, views: np.ndarray) -> np.ndarray:
        """Feature maps (V, C, h, w), or features (V, C) that are pooled already, float32, of the images (V, size_px,
        size_px, 3) uint8 RGB. Raises WeightsMissing where the network gives something else."""

    def pooled(self, views: np.ndarray, power: float) -> np.ndarray:
        """(V, C) float32: the features of `embed`, maps pooled by their generalised mean of this power."""
        features = self.embed(views)
        return features if features.ndim == 2 else (np.maximum(features, 0) ** power).mean((2, 3)) ** (1 / power)
