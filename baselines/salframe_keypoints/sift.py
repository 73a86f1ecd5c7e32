"""SIFT (Lowe 2004) by OpenCV, matched by the ratio test; no network, no weights."""

from __future__ import annotations

import cv2
import numpy as np

from salframe_keypoints.pairs import DescriptorPair, View, gray, unit_rows

RATIO = 0.8
"""A match is kept where the nearest descriptor is closer than this share of the distance to the second (Lowe 2004,
section 7.1)."""


class Sift(DescriptorPair):
    """OpenCV's SIFT with the ratio test."""

    def __init__(self, config) -> None:
        self._sift = cv2.SIFT_create(nfeatures=config.max_keypoints)
        self._limit = config.max_keypoints

    def extract(self, images: np.ndarray) -> list[View]:
        """See Pair. OpenCV's descriptors are whole numbers up to 255, so uint8 holds them exactly."""
        views = []
        for image in gray(images):
            keypoints, descriptors = self._sift.detectAndCompute(image, None)
            keypoints = keypoints[: self._limit]  # OpenCV returns some more where the last responses tie
            points = np.array([point.pt for point in keypoints], np.float32).reshape(-1, 2) + np.float32(0.5)
            described = (
                np.zeros((0, 128), np.uint8) if descriptors is None else descriptors[: self._limit].astype(np.uint8)
            )
            views.append(View(points, described))
        return views

    def match_descriptors(self, query: View, reference: View) -> np.ndarray:
        """See DescriptorPair."""
        if len(query.features) == 0 or len(reference.features) < 2:
            return np.zeros((0, 2), int)
        a, b = query.features.astype(np.float32), reference.features.astype(np.float32)
        squared = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
        two = np.argpartition(squared, 1, axis=1)[:, :2]
        nearest, second = np.take_along_axis(squared, two, 1).T
        kept = np.flatnonzero(nearest < RATIO**2 * second)
        return np.stack([kept, two[kept, 0]], 1)

    def retrieval_features(self, view: View) -> np.ndarray:
        """RootSIFT (Arandjelovic and Zisserman 2012)."""
        return root_sift(view.features)


def root_sift(descriptors: np.ndarray) -> np.ndarray:
    """(N, 128) float32 of unit length: square roots of SIFT descriptors."""
    return unit_rows(np.sqrt(descriptors.astype(np.float32)))
