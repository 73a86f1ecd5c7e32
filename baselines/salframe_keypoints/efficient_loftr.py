"""Efficient LoFTR (Wang et al., CVPR 2024) by `transformers`: semi-dense matches without a detector."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from salframe_keypoints.feature_matcher import ViewFeatures
from salframe_keypoints.images import ImageMatcher, decode, require_multiples
from salframe_keypoints.networks import PIXEL_CENTRE
from salframe_keypoints.pretrained import Pretrained

EFFICIENT_LOFTR = Pretrained(
    "zju-community/efficientloftr", "Apache-2.0", "EfficientLoFTRForKeypointMatching", "efficientloftr"
)
SIDE_MULTIPLE_PX = 32
"""Factor by which the network downsamples the sides of an image."""


class EfficientLoftr(ImageMatcher):
    """Efficient LoFTR on grey views, which matches without keypoints.

    The map stores the range at the points of a grid. Each matched point in a reference view is moved to the nearest
    grid point, by at most one pixel. The matched point in the query is moved by the same offset.
    """

    name = "efficient-loftr"
    version = "1"
    requires = ("torch", "transformers")
    extra = "salframe[transformers]"
    stride_px = 2

    @classmethod
    def paths(cls, config: Any) -> tuple[Path, ...]:
        """See TrainedMatcher."""
        return EFFICIENT_LOFTR.files(config.checkpoint)

    def __init__(self, config: ImageMatcher.Config | None = None) -> None:
        super().__init__(config)
        self._network = EFFICIENT_LOFTR.load(self.config.checkpoint)
        self._network._get_matches_from_scores = align_match_columns(self._network._get_matches_from_scores)

    def prepare(self, width_px: int, height_px: int) -> None:
        """See FeatureMatcher."""
        super().prepare(width_px, height_px)
        require_multiples(self.name, self.view_size_px, SIDE_MULTIPLE_PX)

    def match(self, query: ViewFeatures, reference: ViewFeatures) -> tuple[np.ndarray, np.ndarray]:
        """See FeatureMatcher."""
        import torch

        size_px, images = np.array(self.view_size_px), np.stack([decode(view) for view in (query, reference)])
        with torch.inference_mode():
            output = self._network(torch.from_numpy(images)[None, :, None].float() / 255)
        matched = (output.matches[0, 0] >= 0).numpy()
        pixels = output.keypoints[0].numpy()[:, matched] * size_px + PIXEL_CENTRE
        query_px, reference_px = pixels[:, ((pixels >= 0) & (pixels < size_px)).all((0, 2))]
        columns, rows = -(-size_px // self.stride_px)
        cells = np.clip((reference_px / self.stride_px).round().astype(int), 0, (columns - 1, rows - 1))
        return query_px + cells * self.stride_px - reference_px, cells[:, 1] * columns + cells[:, 0]


def align_match_columns(find_cells: Callable[[Any], tuple[Any, Any]]) -> Callable[[Any], tuple[Any, Any]]:
    """Wrap a function of transformers so that each column of its result holds one match.

    The original function returns the mutual nearest cells (B, 2, N) of two images, -1 for no match.
    In transformers 5, entry j of the first row is the match of cell j of the second image, and entry i of the second
    row is the match of cell i of the first image. A column then contains the ends of two different matches, which
    breaks the refinement of the matches. The aligned result is computed from the second row.
    """

    def find_matches(scores: Any) -> tuple[Any, Any]:
        import torch

        cells, confidence = find_cells(scores)
        partner = cells[:, 1]
        cell = torch.where(partner >= 0, torch.arange(partner.shape[1]), -1)
        return torch.stack([cell, partner], 1), confidence[:, 1:].expand(-1, 2, -1)

    return find_matches
