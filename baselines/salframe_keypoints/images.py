"""What detector-free pairs have in common: no keypoints, two images go in and matches come out."""

from __future__ import annotations

import cv2
import numpy as np

from salframe_keypoints.pairs import Pair, View, gray
from salframe_keypoints.sift import root_sift

JPEG_QUALITY = 90


class ImagePair(Pair):
    """A view is its grey JPEG, and its points are those of a grid `stride_px` apart, to which matches in the reference
    are brought.

    As detector-free matching has no descriptors to pool, the shortlist comes from SIFT of the same JPEG.
    """

    stride_px: int

    def __init__(self, config) -> None:
        self._sift = cv2.SIFT_create(nfeatures=config.max_keypoints)

    def extract(self, images: np.ndarray) -> list[View]:
        """See Pair."""
        rows, columns = (np.arange(0, size, self.stride_px, np.uint16) for size in images.shape[1:3])
        grid = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        return [View(grid, cv2.imencode(".jpg", image, quality)[1].ravel()) for image in gray(images)]

    def restrict(self, view: View, seen: np.ndarray) -> View:
        """See Pair: the image stays whole."""
        return view

    def retrieval_features(self, view: View) -> np.ndarray:
        """RootSIFT of the view's image."""
        descriptors = self._sift.detectAndCompute(decode(view), None)[1]
        return np.zeros((0, 128), np.float32) if descriptors is None else root_sift(descriptors)


def decode(view: View) -> np.ndarray:
    """(h, w) uint8 grey image of a view."""
    return cv2.imdecode(view.features, cv2.IMREAD_GRAYSCALE)
