"""Rules of the role `feature-matcher` for the conformance suite."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from salframe.framework.errors import ConfigError
from salframe.panoramas.perspective import ViewRig
from salframe.testing.expectations import attempt, call_twice, expect, same
from salframe.testing.rooms import ROOMS, look, stand
from salframe_keypoints.descriptors import DescriptorMatcher
from salframe_keypoints.feature_matcher import FeatureMatcher, ViewFeatures

RIG = ViewRig(3, 256, 192, np.pi / 2)
"""Perspective views for the checks. Their sides are multiples of all common grid strides."""
ODD_PX = 333, 111
"""Size of views that a matcher must either support or reject in `prepare`."""
SELF_SHARE, SELF_PX = 0.9, 1.0
"""Limits for matching a view with itself: minimum share of the matches whose two points coincide, and maximum distance
in pixels between two points that coincide."""
UNIT_SLACK = 1e-3
"""Maximum deviation of a descriptor's length from 1. Network descriptors are stored as float16."""


def check_feature_matcher(make: Callable[[], FeatureMatcher]) -> None:
    """Check that views and matches are well formed, also for blank views, and that a view matches itself."""
    matcher, images = _prepared(make), _images(RIG)
    views = _extract(matcher, "of a bedroom", images)
    matches = [_match(matcher, "of a view with itself", view, view) for view in views]
    offset_px = np.concatenate(
        [
            np.linalg.norm(pixels - view.points_px[positions], axis=1)
            for view, (pixels, positions) in zip(views, matches, strict=True)
        ]
    )
    checked = "match of views with themselves"
    expect(len(offset_px), checked, "no match", "matches, because the views show textured rooms")
    share = float((offset_px <= SELF_PX).mean())
    expect(
        share >= SELF_SHARE,
        checked,
        f"{share:.0%} of the matches within {SELF_PX:g} px of the matched point",
        f"at least {SELF_SHARE:.0%}",
    )

    matched = _match(matcher, "of two views", views[0], views[1])
    again = _prepared(make)
    first, second, *_ = again.extract(images)
    expect(same(list(views[:2]), [first, second]), "extract by another instance", "other views", "the same views")
    expect(same(matched, again.match(first, second)), "match by another instance", "other matches", "the same matches")

    (blank,) = _extract(matcher, "of a blank image", np.full_like(images[:1], 127))
    pairs = {
        "of a blank view with another": (blank, views[0]),
        "of a view with a blank one": (views[0], blank),
        "of two blank views": (blank, blank),
    }
    for what, (query, reference) in pairs.items():
        _match(matcher, what, query, reference)
    _check_described(matcher, [*views, blank])
    _check_restricted(matcher, views[0], views[1])
    _check_odd_size(make())


def _prepared(make: Callable[[], FeatureMatcher]) -> FeatureMatcher:
    matcher = make()
    attempt(f"prepare for {RIG.width_px} x {RIG.height_px} pixels", matcher.prepare, RIG.width_px, RIG.height_px)
    return matcher


def _images(rig: ViewRig) -> np.ndarray:
    """Return (V, h, w, 3) uint8 views of a bedroom."""
    room = ROOMS[0]
    rgb = look(room, room.name, stand(room), {"rgb"}).rgb
    assert rgb is not None  # look() was called with this part
    return rig.cut(rgb)


def _extract(matcher: FeatureMatcher, what: str, images: np.ndarray) -> list[ViewFeatures]:
    """Extract views and check them."""
    checked = f"extract {what}"
    views = call_twice(checked, matcher.extract, images)
    expect(
        isinstance(views, list) and all(isinstance(view, ViewFeatures) for view in views),
        checked,
        type(views).__name__,
        "a list of ViewFeatures",
    )
    expect(len(views) == len(images), checked, f"{len(views)} views", f"one view for each of {len(images)} images")
    for view in views:
        _check_view(checked, matcher, view, images.shape[2], images.shape[1])
    return views


def _check_view(checked: str, matcher: FeatureMatcher, view: ViewFeatures, width_px: int, height_px: int) -> None:
    points, features = view.points_px, view.features
    shaped = isinstance(points, np.ndarray) and points.ndim == 2 and points.shape[1] == 2 and points.dtype.kind in "fiu"
    expect(shaped, checked, f"points_px of shape {np.shape(points)}", "numbers of shape (K, 2)")
    inside = ((points >= 0) & (points <= (width_px, height_px))).all()
    expect(inside, checked, "a point outside its image", f"points within {width_px} x {height_px} pixels")
    is_array = isinstance(features, np.ndarray) and features.ndim in (1, 2) and features.dtype != object
    expect(
        is_array,
        checked,
        f"features of shape {np.shape(features)}",
        "an array with one or two axes, not of dtype object",
    )
    if isinstance(matcher, DescriptorMatcher):
        expect(
            len(points) == len(features),
            checked,
            f"{len(features)} descriptors",
            f"one descriptor per point, {len(points)}",
        )


def _match(
    matcher: FeatureMatcher, what: str, query: ViewFeatures, reference: ViewFeatures
) -> tuple[np.ndarray, np.ndarray]:
    """Match two views and check the matches."""
    checked = f"match {what}"
    pixels, positions = call_twice(checked, matcher.match, query, reference)
    shapes = f"pixels {np.shape(pixels)} and positions {np.shape(positions)}"
    fits = np.shape(pixels) == (len(positions), 2) and np.shape(positions) == (len(positions),)
    expect(fits, checked, shapes, "pixels (M, 2) of the query and positions (M,) in the reference")
    expect(np.isfinite(pixels).all(), checked, "a pixel that is not finite", "finite pixels of the query")
    expect(positions.dtype.kind in "iu", checked, f"positions of dtype {positions.dtype}", "integers")
    count = len(reference.points_px)
    expect(
        ((positions >= 0) & (positions < count)).all(),
        checked,
        f"positions {positions}",
        f"positions from 0 to {count - 1}",
    )
    return pixels, positions


def _check_described(matcher: FeatureMatcher, views: Sequence[ViewFeatures]) -> None:
    """Check that local descriptors have unit length, and the same dimension for all views including blank ones."""
    dimensions = set()
    for view in views:
        local = call_twice("describe", matcher.describe, view)
        shaped = isinstance(local, np.ndarray) and local.ndim == 2 and local.dtype == np.float32
        expect(shaped, "describe", f"{getattr(local, 'dtype', None)} of shape {np.shape(local)}", "float32 (N, D)")
        norm = np.linalg.norm(local, axis=1)
        unit = np.abs(norm - 1) <= UNIT_SLACK
        expect(
            (unit | (norm == 0)).all(), "describe", f"rows of length {norm.tolist()}", "rows of unit length or zeros"
        )
        dimensions.add(local.shape[1])
    expect(
        len(dimensions) == 1,
        "describe",
        f"descriptors of dimensions {sorted(dimensions)}",
        "the same dimension for all views",
    )


def _check_restricted(matcher: FeatureMatcher, view: ViewFeatures, reference: ViewFeatures) -> None:
    """Check that `restrict` retains all points on valid pixels, and that the restricted view can be matched."""
    left = view.points_px[:, 0] < RIG.width_px / 2
    for what, valid in (("the left half", left), ("no pixel", np.zeros_like(left))):
        checked = f"restrict to {what}"
        restricted = call_twice(checked, matcher.restrict, view, valid)
        expect(isinstance(restricted, ViewFeatures), checked, type(restricted).__name__, "a ViewFeatures")
        _check_view(checked, matcher, restricted, RIG.width_px, RIG.height_px)
        expected = set(map(tuple, view.points_px[valid].tolist()))
        expect(
            expected <= set(map(tuple, restricted.points_px.tolist())),
            checked,
            "fewer points",
            "all points on valid pixels",
        )
        _match(matcher, f"of a view restricted to {what}", restricted, reference)
        _match(matcher, f"with a view restricted to {what}", reference, restricted)


def _check_odd_size(matcher: FeatureMatcher) -> None:
    """Check that views of an unusual size are rejected in `prepare`, or work."""
    width_px, height_px = ODD_PX
    try:
        matcher.prepare(width_px, height_px)
    except ConfigError:
        return
    images = _images(ViewRig(3, width_px, height_px, RIG.hfov_rad))
    what = f"of views of {width_px} x {height_px} pixels, which prepare did not reject"
    views = _extract(matcher, what, images)
    _match(matcher, what, views[0], views[1])
