"""Keypoint baselines.

Local features of perspective views are matched with a shortlist of reference frames. The matches are back-projected to
3D with the range, which gives the pose.
"""

import salframe
from salframe_keypoints.aliked import AlikedLightGlue, AlikedNearest
from salframe_keypoints.disk import DiskLightGlue
from salframe_keypoints.efficient_loftr import EfficientLoftr
from salframe_keypoints.feature_matcher import FeatureMatcher
from salframe_keypoints.localizer import Keypoints
from salframe_keypoints.loftr import Loftr
from salframe_keypoints.loftr_compact import LoftrCompact
from salframe_keypoints.sift import Sift
from salframe_keypoints.superpoint import SuperPointNearest, SuperPointSuperGlue
from salframe_keypoints.verified import VerifiedPlaces
from salframe_keypoints.xfeat import XFeat, XFeatNearest


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """Return the role `feature-matcher`, its components, and the localizers `keypoints` and `verified-places`."""
    return [
        FeatureMatcher,
        Sift,
        XFeat,
        XFeatNearest,
        AlikedNearest,
        AlikedLightGlue,
        DiskLightGlue,
        SuperPointNearest,
        SuperPointSuperGlue,
        EfficientLoftr,
        Loftr,
        LoftrCompact,
        Keypoints,
        VerifiedPlaces,
    ]
