from __future__ import annotations

import numpy as np
import pytest

from salframe.panoramas.geometry import equirectangular_rays, sample_nearest
from salframe.panoramas.perspective import ViewRig, turned_similarity

RIG = ViewRig(6, 480, 352, np.deg2rad(90))


def test_the_first_view_looks_ahead_and_the_others_follow_to_the_left():
    centre = np.array([[240.0, 176.0]])
    looks = np.array([RIG.bearings(view, centre)[0] for view in range(6)])
    azimuth = np.deg2rad(60 * np.arange(6))
    np.testing.assert_allclose(looks, np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], 1), atol=1e-12)


def test_pixels_to_the_right_are_clockwise_and_pixels_below_look_down():
    right, below = RIG.bearings(0, np.array([[480.0, 176.0], [240.0, 352.0]]))
    np.testing.assert_allclose(right, [np.sqrt(0.5), -np.sqrt(0.5), 0], atol=1e-12)
    np.testing.assert_allclose(np.arctan2(below[2], below[0]), -np.arctan(352 / 480), atol=1e-12)


@pytest.mark.parametrize(("height", "width"), [(256, 240), (512, 120)])  # magnified, and averaged before it is reduced
def test_views_show_what_lies_in_the_direction_of_their_pixels(height, width):
    def colour(rays):
        return 127 + 100 * np.stack([np.sin(2 * rays[..., 0]), np.sin(3 * rays[..., 1]), np.sin(2 * rays[..., 2])], -1)

    rig = ViewRig(6, width, 80, np.deg2rad(90))
    views = rig.cut(colour(equirectangular_rays(height)).round().astype(np.uint8))
    y, x = np.mgrid[:80, :width] + 0.5
    for view in range(6):
        rays = rig.bearings(view, np.stack([x.ravel(), y.ravel()], 1)).reshape(80, width, 3)
        np.testing.assert_allclose(views[view], colour(rays), atol=1.6)


def test_nearest_samples_wrap_at_the_seam():
    image = np.arange(8 * 16).reshape(8, 16)
    behind = np.array([[-1, 1e-9, 0.1], [-1, -1e-9, 0.1], [0, 0, 1], [0, 0, -1]])
    assert sample_nearest(image, behind).tolist()[:2] == [48, 63]
    assert sample_nearest(image, behind)[2] < 16
    assert sample_nearest(image, behind)[3] >= 112


def test_the_turn_and_the_frame_are_found():
    rng = np.random.default_rng(0)
    reference = rng.normal(size=(4, 6, 32))
    reference /= np.linalg.norm(reference, axis=-1, keepdims=True)
    query = np.roll(reference[2], -5, axis=0)  # what query view i sees is what view i + 5 of the frame saw
    similarity = turned_similarity(query, reference)
    assert np.unravel_index(similarity.argmax(), similarity.shape) == (2, 5)
    assert np.isclose(similarity[2, 5], 1)


def test_a_ring_may_look_up_or_down_and_projection_undoes_bearings():
    for elevation in (np.pi / 3, -np.pi / 3):
        ring = ViewRig(4, 100, 80, np.deg2rad(90), elevation)
        for view in range(4):
            axis = ring.bearings(view, np.array([[50.0, 40.0]]))[0]
            np.testing.assert_allclose(np.arcsin(axis[2]), elevation, atol=1e-12)
            np.testing.assert_allclose(np.arctan2(axis[1], axis[0]) % (2 * np.pi), view * np.pi / 2, atol=1e-12)
            pixels = np.random.default_rng(view).uniform((0, 0), (100, 80), (20, 2))
            bearings = ring.bearings(view, pixels)
            assert bearings[:, 2] @ (40 - pixels[:, 1]) > 0  # up in the image is up
            back, shown = ring.project(np.concatenate([bearings, -bearings]), view)
            np.testing.assert_allclose(back[:20], pixels, atol=1e-9)
            assert shown.tolist() == [True] * 20 + [False] * 20
