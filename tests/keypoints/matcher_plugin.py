"""A third-party matcher of corners with the patch around them, for tests of `keypoints`."""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field
from salframe_keypoints.descriptors import DescriptorMatcher
from salframe_keypoints.feature_matcher import ViewFeatures

import salframe
from salframe.framework.component import ComponentConfig

PATCH_PX = 17


class Corners(DescriptorMatcher):
    """Shi-Tomasi corners with the patch around them, matched by mutual nearest neighbours."""

    name = "corners"
    version = "1"

    class Config(ComponentConfig):
        count: int = Field(100, ge=1, description="maximum number of corners per view")

    def extract(self, images: np.ndarray) -> list[ViewFeatures]:
        return [self._view(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)) for image in images]

    def match_descriptors(self, query: ViewFeatures, reference: ViewFeatures) -> np.ndarray:
        if not len(query.features) or not len(reference.features):
            return np.zeros((0, 2), int)
        cosines = query.features @ reference.features.T
        nearest = cosines.argmax(1)
        (mutual,) = np.nonzero(cosines.argmax(0)[nearest] == np.arange(len(nearest)))
        return np.column_stack([mutual, nearest[mutual]])

    def _view(self, image: np.ndarray) -> ViewFeatures:
        points = cv2.goodFeaturesToTrack(image, self.config.count, 0.01, 8)
        corners = np.zeros((0, 2), np.float32) if points is None else points.reshape(-1, 2)
        size_px = (PATCH_PX, PATCH_PX)
        patches = [cv2.getRectSubPix(image, size_px, corner.tolist()).ravel() for corner in corners]
        features = np.reshape(patches, (-1, PATCH_PX**2)).astype(np.float32)
        features -= features.mean(1, keepdims=True)
        features /= np.maximum(np.linalg.norm(features, axis=1, keepdims=True), 1e-9)
        return ViewFeatures(corners + np.float32(0.5), features)


@salframe.hookimpl
def salframe_provides() -> list[type]:
    return [Corners]
