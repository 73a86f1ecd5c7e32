"""Votes of views on the panorama: smooth fields come back, weights are those stated."""

import numpy as np
import pytest
from salframe_segments.view_scores import HEIGHT, Views, average_scores, score_weights

from salframe.panoramas.geometry import equirectangular_rays

VIEWS = Views(level=6, tilted=4, width_px=120, height_px=120, fov_rad=np.pi / 2)


def field(rays):
    """Three probabilities that add up to 1 and change slowly over the sphere."""
    x, y, z = np.moveaxis(np.asarray(rays, float), -1, 0)
    return np.stack([(1 + x) / 3, (1 + y) / 3, (1 - x - y) / 3], -1) + 0 * z[..., None]


def seen_by_views(views, side):
    y, x = (np.mgrid[:side, :side] + 0.5) * views.width_px / side
    pixels = np.stack([x.ravel(), y.ravel()], 1)
    rays = [ring.bearings(view, pixels) for ring in views.rings for view in range(ring.count)]
    return field(np.reshape(rays, (-1, side, side, 3))).astype(np.float32)


@pytest.mark.parametrize("side", [60, 90])
def test_what_views_agree_on_is_what_the_panorama_shows(side):
    mean, weight = average_scores(VIEWS, np.ones(14, bool), seen_by_views(VIEWS, side))
    assert mean.shape == (HEIGHT, 2 * HEIGHT, 3)
    assert (weight > 0).all()  # with views up and down nothing is out of sight
    expected = field(equirectangular_rays(HEIGHT))
    assert np.abs(mean - expected).max() < 0.02  # half a pixel of 90 / 60 deg at a border
    np.testing.assert_allclose(mean.sum(-1), 1, atol=1e-4)


def test_level_views_leave_the_poles_without_a_vote():
    level = Views(6, 0, 120, 120, np.pi / 2)
    mean, weight = average_scores(level, np.ones(6, bool), seen_by_views(level, 60))
    elevation = np.degrees(np.arcsin(equirectangular_rays(HEIGHT)[:, 0, 2]))
    assert (weight[np.abs(elevation) < 37] > 0).all()
    assert (weight[np.abs(elevation) > 46] == 0).all()
    assert (mean[weight == 0] == 0).all()


def test_a_vote_counts_less_towards_the_border_of_its_view():
    alone = Views(1, 0, 120, 120, np.pi / 2)
    weight = np.asarray(score_weights(alone, 60, 60).sum(1)).reshape(HEIGHT, 2 * HEIGHT)
    middle = weight[HEIGHT // 2 - 1 : HEIGHT // 2 + 1, HEIGHT - 1 : HEIGHT + 1]
    assert middle == pytest.approx(np.ones((2, 2)), abs=0.02)
    # 22.5 deg to the side of a view of 90 deg: tan(22.5 deg) of the way to the border.
    column = HEIGHT + round(22.5 / 180 * HEIGHT)
    assert weight[HEIGHT // 2, column] == pytest.approx(1 - np.tan(np.radians(22.5)), abs=0.02)
    assert weight[HEIGHT // 2, : HEIGHT // 2].sum() == 0  # behind


def test_only_views_that_show_something_are_asked():
    valid = np.zeros((HEIGHT, 2 * HEIGHT), bool)
    assert not VIEWS.visible_views(valid).any()
    valid[HEIGHT // 2, HEIGHT] = True  # straight ahead
    shown = VIEWS.visible_views(valid)
    assert shown.tolist() == [True] + 5 * [False] + 8 * [False]
    probabilities = seen_by_views(VIEWS, 60)
    part, weight = average_scores(VIEWS, shown, probabilities[shown])
    np.testing.assert_allclose(part[HEIGHT // 2, HEIGHT], field([1, 0, 0]), atol=0.02)
    assert weight[HEIGHT // 2, 0] == 0
