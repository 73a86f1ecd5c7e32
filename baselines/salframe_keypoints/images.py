"""What detector-free matchers have in common: no keypoints, two images go in and matches come out."""

from __future__ import annotations

import numpy as np

from salframe.framework.component import match_only
from salframe.framework.errors import ConfigError, DataError
from salframe_keypoints.checkpoints import TrainedMatcher
from salframe_keypoints.feature_matcher import View
from salframe_keypoints.sift import gray, root_sift

JPEG_QUALITY = 90


class ImageMatcher(TrainedMatcher):
    """A view is its grey JPEG, and its points are those of a grid `stride_px` apart, to which matches in the reference
    are brought.

    As detector-free matching has no descriptors to pool, the shortlist comes from SIFT of the same JPEG.
    """

    stride_px: int

    class Config(TrainedMatcher.Config):
        max_keypoints: int = match_only(512, ge=16, description="SIFT keypoints a view that the shortlist is made by")

    def __init__(self, config: Config | None = None) -> None:
        import cv2

        super().__init__(config)
        self._sift = cv2.SIFT.create(nfeatures=self.config.max_keypoints)

    def extract(self, images: np.ndarray) -> list[View]:
        """See FeatureMatcher."""
        import cv2

        rows, columns = (np.arange(0, size, self.stride_px, dtype=np.uint16) for size in images.shape[1:3])
        grid = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        return [View(grid, cv2.imencode(".jpg", image, quality)[1].ravel()) for image in gray(images)]

    def restrict(self, view: View, seen: np.ndarray) -> View:
        """See FeatureMatcher: the image stays whole."""
        return view

    def describe(self, view: View) -> np.ndarray:
        """RootSIFT of the view's image."""
        descriptors = self._sift.detectAndCompute(decode(view), None)[1]
        return np.zeros((0, 128), np.float32) if descriptors is None else root_sift(descriptors)


def require_multiples(name: str, view_size_px: tuple[int, int], multiple_px: int, max_px: int | None = None) -> None:
    """Raise ConfigError where a side of the views is no multiple of `multiple_px`, or longer than `max_px`."""
    if any(side % multiple_px or (max_px is not None and side > max_px) for side in view_size_px):
        expected = f"multiples of {multiple_px}" + (f" up to {max_px}" if max_px else "")
        raise ConfigError(
            f"{name}: views of {view_size_px[0]} x {view_size_px[1]} pixels, expected {expected}: "
            "set view_width_px and view_height_px"
        )


def decode(view: View) -> np.ndarray:
    """(h, w) uint8 grey image of a view. Raises DataError where it is damaged."""
    import cv2

    image = cv2.imdecode(view.features, cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise DataError(f"a view holds {len(view.features)} bytes that are no JPEG: build the map again")
    return image
