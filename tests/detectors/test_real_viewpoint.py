"""A detector that a user would bring, on the shared data's RGB-D viewpoint. Skipped where either is absent."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from salframe_detectors.detector import OnnxDetector
from salframe_matterport.bearings import bearing, direction
from salframe_matterport.readers import boxes_path, read_boxes

from salframe.panoramas.panorama import Panorama

SHARED = Path(os.environ.get("SALFRAME_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data"))
SCAN, VIEWPOINT = "yqstnuAEVhm", "6f4d197078d14d6e944ed6533598a6f9"


def test_bearings_are_those_of_the_annotated_objects():
    """Chair and round table within 5 deg, and the sofa, 65 deg wide, within 10."""
    picture, network = (
        SHARED / "matterport3d" / "rgbd" / "reference_rgb.png",
        SHARED.parent / "weights" / "yolox_nano.onnx",
    )
    for needed in (picture, network):
        if not needed.exists():
            pytest.skip(f"no {needed} (set SALFRAME_SHARED_DATA)")
    depth = cv2.imread(str(picture.with_name("reference_range.png")), cv2.IMREAD_UNCHANGED)
    panorama = Panorama(
        VIEWPOINT,
        rgb=cv2.imread(str(picture))[..., ::-1],
        range_m=np.where(depth > 0, depth / 4000, np.nan).astype(np.float32),
    )
    found = OnnxDetector(OnnxDetector.Config(model=str(network))).detect(panorama)
    boxes = read_boxes(boxes_path(SHARED / "matterport3d", SCAN, VIEWPOINT), VIEWPOINT)
    for annotated, label, within_deg in (
        ("chair", "chair", 5),
        ("round table", "dining table", 5),
        ("sofa chair", "couch", 10),
    ):
        (seen,) = (bearing(box.view, box.box_px) for box in boxes.values() if box.label == annotated)
        # The picture begins at heading 0, so its frame looks along world -y: a quarter turn to the right of world +x.
        towards = direction(seen.azimuth_rad + np.pi / 2, seen.elevation_rad)
        own = found.centroid_m[[i for i, name in enumerate(found.labels) if name == label]]
        off_deg = np.degrees(np.arccos(own @ towards / np.linalg.norm(own, axis=1)))
        assert np.nanmin(off_deg) < within_deg
