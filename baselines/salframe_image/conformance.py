"""The rules of the role `image-network`, for the conformance suite."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from salframe.panoramas.perspective import ViewRig
from salframe.testing.asking import ask, expect, same
from salframe.testing.rooms import ROOMS, look, stand
from salframe_image.image_network import ImageNetwork

VIEWS = 3
BATCH_SLACK = 1e-3
"""What the features of an image may change, a share of the largest, with the images beside it: sums run in another
order."""


def check_image_network(make: Callable[[], ImageNetwork]) -> None:
    """Finite features of each image, whatever stands beside it, others for other images."""
    network = make()
    size_px = network.size_px
    expect(isinstance(size_px, int) and size_px > 0, "size_px", repr(size_px), "pixels")
    rig = ViewRig(VIEWS, size_px, size_px, np.pi / 2)
    rgb = look(ROOMS[0], ROOMS[0].name, stand(ROOMS[0]), {"rgb"}).rgb
    assert rgb is not None  # it was asked for
    views = rig.cut(rgb)
    features = _embed(network, f"embed of {VIEWS} views", views)
    expect(np.ptp(features, axis=0).max() > 0, "embed of different views", "the same features", "others")
    alone = _embed(network, "embed of one of them alone", views[1:2])
    expect(
        alone.shape[1:] == features.shape[1:], "embed of one of them alone", alone.shape[1:], str(features.shape[1:])
    )
    off = np.abs(alone[0] - features[1]).max() / max(float(np.abs(features).max()), 1e-12)
    expect(off <= BATCH_SLACK, "embed of one of them alone", f"features off by {off:.1g}", "the same as beside others")
    expect(same(features, make().embed(views)), "embed by another instance", "another answer", "the same")
    for level in (0, 255):
        _embed(network, f"embed of a blank image of {level}", np.full_like(views[:1], level))


def _embed(network: ImageNetwork, checked: str, views: np.ndarray) -> np.ndarray:
    features = ask(checked, network.embed, views)
    fits = isinstance(features, np.ndarray) and features.ndim in (2, 4) and features.dtype == np.float32
    expect(fits, checked, f"{getattr(features, 'dtype', None)} {np.shape(features)}", "float32 (V, C) or (V, C, h, w)")
    expect(len(features) == len(views), checked, f"{len(features)} rows", f"one an image: {len(views)}")
    expect(np.isfinite(features).all(), checked, "a feature that is not finite", "finite ones")
    return features
