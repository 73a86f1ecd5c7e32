"""Rules of the role `image-network` for the conformance suite."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from salframe.panoramas.perspective import ViewRig
from salframe.testing.expectations import call_twice, expect, same
from salframe.testing.rooms import ROOMS, look, stand
from salframe_image.image_network import ImageNetwork

VIEWS = 3
BATCH_SLACK = 1e-3
"""Maximum change of the features of an image if the other images of the batch change, as a fraction of the maximum
feature. Small changes occur because the order of sums depends on the batch."""


def check_image_network(make: Callable[[], ImageNetwork]) -> None:
    """Check that features are finite, differ between images and do not depend on the rest of the batch."""
    network = make()
    size_px = network.size_px
    expect(isinstance(size_px, int) and size_px > 0, "size_px", repr(size_px), "a positive number of pixels")
    rig = ViewRig(VIEWS, size_px, size_px, np.pi / 2)
    rgb = look(ROOMS[0], ROOMS[0].name, stand(ROOMS[0]), {"rgb"}).rgb
    assert rgb is not None  # look() was called with this part
    views = rig.cut(rgb)
    features = _embed(network, f"embed of {VIEWS} views", views)
    expect(np.ptp(features, axis=0).max() > 0, "embed of different views", "the same features", "different features")
    alone = _embed(network, "embed of a single view", views[1:2])
    expect(alone.shape[1:] == features.shape[1:], "embed of a single view", alone.shape[1:], str(features.shape[1:]))
    off = np.abs(alone[0] - features[1]).max() / max(float(np.abs(features).max()), 1e-12)
    expect(
        off <= BATCH_SLACK,
        "embed of a single view",
        f"features that differ by {off:.1g} of the maximum feature",
        f"the features of this view in a batch of {VIEWS} views, within {BATCH_SLACK:g} of the maximum feature",
    )
    expect(same(features, make().embed(views)), "embed by another instance", "other features", "the same features")
    for level in (0, 255):
        _embed(network, f"embed of a blank image with grey level {level}", np.full_like(views[:1], level))


def _embed(network: ImageNetwork, checked: str, views: np.ndarray) -> np.ndarray:
    features = call_twice(checked, network.embed, views)
    fits = isinstance(features, np.ndarray) and features.ndim in (2, 4) and features.dtype == np.float32
    expect(fits, checked, f"{getattr(features, 'dtype', None)} {np.shape(features)}", "float32 (V, C) or (V, C, h, w)")
    expect(len(features) == len(views), checked, f"{len(features)} rows", f"one row per image, {len(views)}")
    expect(np.isfinite(features).all(), checked, "a feature that is not finite", "finite features")
    return features
