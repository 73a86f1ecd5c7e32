"""Base class of detector-free matchers, which match two images directly, without detected keypoints."""

from __future__ import annotations

import numpy as np

from salframe.framework.component import match_only
from salframe.framework.errors import ConfigError, DataError
from salframe_keypoints.checkpoints import TrainedMatcher
from salframe_keypoints.feature_matcher import ViewFeatures
from salframe_keypoints.sift import gray, root_sift

JPEG_QUALITY = 90


class ImageMatcher(TrainedMatcher):
    """Base class of matchers that store a view as a grey JPEG.

    The points of a view form a grid with spacing `stride_px`. A match is a pair of points. Its point in the reference
    view is moved to the nearest point of the grid. Detector-free matching has no descriptors to pool, so the shortlist
    uses SIFT descriptors of the same JPEG.
    """

    stride_px: int

    class Config(TrainedMatcher.Config):
        max_keypoints: int = match_only(
            512,
            ge=16,
            description="maximum number of SIFT keypoints in each view. They only select the reference frames to "
            "match. The matching itself does not use them",
        )

    def __init__(self, config: Config | None = None) -> None:
        import cv2

        super().__init__(config)
        self._sift = cv2.SIFT.create(nfeatures=self.config.max_keypoints)

    def extract(self, images: np.ndarray) -> list[ViewFeatures]:
        """See FeatureMatcher."""
        import cv2

        rows, columns = (np.arange(0, size, self.stride_px, dtype=np.uint16) for size in images.shape[1:3])
        grid = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
        quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        return [ViewFeatures(grid, cv2.imencode(".jpg", image, quality)[1].ravel()) for image in gray(images)]

    def restrict(self, view: ViewFeatures, valid: np.ndarray) -> ViewFeatures:
        """Return the view itself, because its image cannot be restricted."""
        return view

    def describe(self, view: ViewFeatures) -> np.ndarray:
        """Return RootSIFT descriptors of the view's image."""
        descriptors = self._sift.detectAndCompute(decode(view), None)[1]
        return np.zeros((0, 128), np.float32) if descriptors is None else root_sift(descriptors)


def require_multiples(name: str, view_size_px: tuple[int, int], multiple_px: int, max_px: int | None = None) -> None:
    """Raise ConfigError if a side of the views is not a multiple of `multiple_px` or exceeds `max_px`."""
    if any(side % multiple_px or (max_px is not None and side > max_px) for side in view_size_px):
        expected = f"multiples of {multiple_px}" + (f" up to {max_px}" if max_px else "")
        raise ConfigError(
            f"the settings view_width_px and view_height_px are {view_size_px[0]} and {view_size_px[1]}, expected "
            f"{expected} for the feature matcher {name!r}"
        )


def decode(view: ViewFeatures) -> np.ndarray:
    """Return the (h, w) uint8 grey image of a view. Raises DataError if the JPEG is corrupt."""
    import cv2

    image = cv2.imdecode(view.features, cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise DataError(f"an image in the map ({len(view.features)} bytes) is not a readable JPEG: build the map again")
    return image
