"""The role `image-network`: features of an image by a network, used by the localizer `image`."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from salframe.framework.component import Role


class ImageNetwork(Role):
    """Computes features of images with a neural network."""

    role = "image-network"
    conformance = "salframe_image.conformance:check_image_network"

    @property
    @abstractmethod
    def size_px(self) -> int:
        """Width and height of the input images, in pixels."""

    @abstractmethod
    def embed(self, views: np.ndarray) -> np.ndarray:
        """Compute features of images.

        Args:
            views: (V, size_px, size_px, 3) uint8 RGB images.

        Returns:
            float32 feature maps (V, C, h, w), or pooled features (V, C).

        Raises:
            WeightsError: The output of the network has another shape.
        """

    def pooled(self, views: np.ndarray, power: float) -> np.ndarray:
        """Return the features of `embed` as (V, C) float32. Feature maps are pooled by the generalised mean.

        Args:
            views: (V, size_px, size_px, 3) uint8 RGB images.
            power: Exponent of the generalised mean.
        """
        features = self.embed(views)
        return features if features.ndim == 2 else (np.maximum(features, 0) ** power).mean((2, 3)) ** (1 / power)

    def descriptors(self, views: np.ndarray, power: float) -> np.ndarray:
        """Return global descriptors of images: the pooled features, normalised to unit length, (V, C) float32.

        Args:
            views: (V, size_px, size_px, 3) uint8 RGB images.
            power: Exponent of the generalised mean.
        """
        pooled = self.pooled(views, power)
        return pooled / np.maximum(np.linalg.norm(pooled, axis=1, keepdims=True), 1e-9)
