"""`loftr-compact`: a small LoFTR, trained by `python -m training.loftr_compact` and shipped with salframe. It runs in
onnxruntime."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from salframe.framework.component import match_only
from salframe.framework.components.identity import UserFile
from salframe.framework.files.weights import NetworkWeights, Shipped, WeightsFile
from salframe.framework.onnx import open_model
from salframe_keypoints.descriptors import unit_rows
from salframe_keypoints.feature_matcher import ViewFeatures
from salframe_keypoints.images import ImageMatcher, decode, require_multiples

FILES = ("features.onnx", "coarse.onnx", "fine.onnx")
STATE = "state.pt"
"""File with the same weights for kornia's module, next to FILES."""

FOLDER = Path(__file__).with_name("loftr_compact_weights")

THRESHOLD = 0.5
"""Minimum confidence of a match. It was measured on a building that is used for tuning only (house-12, seed 100). Of
the matches with kornia's threshold of 0.2, this threshold retains 67 % of those with an error of at most 3 pixels, and
29 % of the others.
"""

ARCHITECTURE = {
    "resnetfpn": {"initial_dim": 16, "block_dims": [16, 32, 64]},
    "coarse": {"d_model": 64, "d_ffn": 64, "nhead": 4, "layer_names": ["self", "cross"] * 2, "temp_bug_fix": True},
    "match_coarse": {"border_rm": 0, "thr": THRESHOLD},
    "fine": {"d_model": 16, "d_ffn": 16, "nhead": 2},
}
"""Values of the architecture that differ from kornia's default_cfg. The matcher `loftr` can run the weights STATE if
its setting `architecture` has this value."""

STRIDE_PX, FINE_STRIDE_PX, WINDOW = 8, 2, 5
"""Stride of the coarse and the fine grid, and side of the fine stage's window in cells. These are kornia's defaults."""

MAX_PX = 512
"""Maximum side of a view in pixels, limited by the position encoding in the network file."""

CACHED_VIEWS = 32
"""Number of views whose features are cached. The views of a query are matched with several reference frames."""


LOFTR_COMPACT = NetworkWeights(
    name="loftr-compact",
    licence="Apache-2.0",
    files=(
        WeightsFile(FILES[0], "8aac202dc59ac1e42d45f9386821535344e4ff6d28b3f59811e169036e710e7e", 2_068_553),
        WeightsFile(FILES[1], "dca8da87c43efc6d7987c5d4cf7ed2c0c4ed244743c475bafff291f5598d88e3", 868_293),
        WeightsFile(FILES[2], "bb0f22f75187e1890d691b2cf0a38767689c6a5dd1ad8a2fec49a47a562016b5", 153_491),
    ),
    source=Shipped(FOLDER),
)


@dataclass(frozen=True, eq=False)
class Features:
    """Features of an image.

    Attributes:
        tokens: (1, L, C) tokens of the coarse grid, row by row, with `columns` cells per row.
        fine: (1, D, h / 2, w / 2) fine feature map.
    """

    tokens: np.ndarray
    fine: np.ndarray

    @property
    def columns(self) -> int:
        return self.fine.shape[3] * FINE_STRIDE_PX // STRIDE_PX


class Network:
    """The network: three ONNX networks (features, coarse and fine stage), and the steps of kornia's LoFTR between them
    in numpy."""

    def __init__(self, paths: tuple[Path, ...]) -> None:
        """Load the network. Raises WeightsError if a file does not contain the expected ONNX network."""
        features, coarse, fine = paths
        self._features = open_model(features, [(1, 1, None, None)])
        self._coarse = open_model(coarse, [(1, None, None)] * 2)
        self._fine = open_model(fine, [(None, WINDOW**2, None)] * 2 + [(None, None)] * 2)

    def features(self, image: np.ndarray) -> Features:
        """Return the features of a grey image (h, w) uint8, whose sides are multiples of STRIDE_PX up to MAX_PX."""
        return Features(*self._features.run(image[None, None].astype(np.float32) / 255))

    def match(self, first: Features, second: Features) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Match the features of two images.

        Matches are mutual maxima of the confidence above THRESHOLD (LoFTR section 3.3). The fine stage then refines the
        point in the second image.

        Returns:
            Cells (M,) int64 of the first image, points (M, 2) float32 of the second image in pixels, and confidences
            (M,).
        """
        confidence, *tokens = self._coarse.run(first.tokens, second.tokens)
        cells, second_cells, best = mutual_maxima(confidence[0], THRESHOLD)
        if not len(cells):
            return cells, np.zeros((0, 2), np.float32), best
        offset = self._fine.run(
            windows(first, cells), windows(second, second_cells), tokens[0][0, cells], tokens[1][0, second_cells]
        )[0]
        grid = np.stack([second_cells % second.columns, second_cells // second.columns], 1) * STRIDE_PX
        return cells, (grid + offset * (WINDOW // 2 * FINE_STRIDE_PX)).astype(np.float32), best


def mutual_maxima(confidence: np.ndarray, threshold: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and values of the entries of a matrix that exceed the threshold and are the maximum of both
    their row and their column."""
    columns = confidence.argmax(1)
    best = confidence[np.arange(len(columns)), columns]
    rows = np.flatnonzero((best > threshold) & (confidence.max(0)[columns] == best))
    return rows, columns[rows], best[rows]


def windows(features: Features, cells: np.ndarray) -> np.ndarray:
    """Return the fine features (M, WINDOW * WINDOW, D) around coarse cells (M,), row by row; 0 outside the image."""
    margin, step = WINDOW // 2, STRIDE_PX // FINE_STRIDE_PX
    padded = np.pad(features.fine[0].transpose(1, 2, 0), ((margin, margin), (margin, margin), (0, 0)))
    offset = np.arange(WINDOW)
    rows = (cells // features.columns * step)[:, None, None] + offset[:, None]
    columns = (cells % features.columns * step)[:, None, None] + offset
    return padded[rows, columns].reshape(len(cells), WINDOW**2, -1)


class LoftrCompact(ImageMatcher):
    """A small LoFTR, which is part of salframe, on grey views. The matched points of a reference view are the cells of
    its coarse grid."""

    name = "loftr-compact"
    version = "1"
    extra = ""
    weights = (LOFTR_COMPACT,)
    stride_px = STRIDE_PX

    class Config(ImageMatcher.Config):
        checkpoint: UserFile | None = Field(
            None,
            description="path of a file with weights, or of a folder with several such files; null: the weights that "
            "are part of salframe",
        )
        pooled: Literal["sift", "tokens"] = match_only(
            "tokens",
            description="local descriptors that are pooled to one global descriptor of a view, which selects the "
            "reference frames to match. sift: RootSIFT; tokens: features of the network's coarse grid, so that SIFT "
            "keypoints are not computed and max_keypoints has no effect",
        )

    def __init__(self, config: Config | None = None) -> None:
        super().__init__(config)
        self._network = Network(self.paths(self.config))
        self._features = lru_cache(maxsize=CACHED_VIEWS)(lambda jpeg: self._network.features(decode(jpeg)))

    def prepare(self, width_px: int, height_px: int) -> None:
        """See FeatureMatcher."""
        super().prepare(width_px, height_px)
        require_multiples(self.name, self.view_size_px, STRIDE_PX, MAX_PX)

    def describe(self, view: ViewFeatures) -> np.ndarray:
        """Return the local descriptors that the setting `pooled` selects: RootSIFT of the image, or features of the
        coarse grid."""
        return unit_rows(self._features(view).tokens[0]) if self.config.pooled == "tokens" else super().describe(view)

    def match(self, query: ViewFeatures, reference: ViewFeatures) -> tuple[np.ndarray, np.ndarray]:
        """See FeatureMatcher.

        The reference is LoFTR's first image, in which matches are at grid points. The query is the second image, in
        which matches are refined to sub-pixel positions.
        """
        cells, points, _ = self._network.match(self._features(reference), self._features(query))
        return points, cells
