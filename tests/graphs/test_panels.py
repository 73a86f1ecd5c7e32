"""Pieces of one flat panel are joined to one object."""

import numpy as np
import pytest

from salframe.graphs.boxes import detections_where_known
from salframe.graphs.panels import join_panels
from salframe.panoramas.geometry import equirectangular_rays, pixel_solid_angles

HEIGHT = 256
RAYS = equirectangular_rays(HEIGHT).astype(np.float32)
AREA_SR = np.broadcast_to(pixel_solid_angles(HEIGHT)[:, None], RAYS.shape[:2])


def piece(left_m, right_m, bottom_m=-0.5, top_m=0.5, x_m=2.0):
    """Return the pixels, the points, the bearing and the solid angle of a rectangle on the plane x = x_m."""
    with np.errstate(divide="ignore", invalid="ignore"):
        points_m = RAYS * (x_m / np.where(RAYS[..., :1] > 0, RAYS[..., :1], np.nan))
    y, z = points_m[..., 1], points_m[..., 2]
    inside = (y >= left_m) & (y < right_m) & (z >= bottom_m) & (z < top_m)
    towards = (AREA_SR[inside][:, None] * RAYS[inside]).sum(0)
    return RAYS[inside], points_m[inside], towards / np.linalg.norm(towards), AREA_SR[inside].sum()


def detections(pieces, labels, scores, with_range=True):
    rays, points_m, bearing, solid_angle_sr = zip(*pieces, strict=True)
    return detections_where_known(
        labels, np.array(scores), points_m if with_range else None, np.array(bearing), np.array(solid_angle_sr), rays
    )


@pytest.mark.parametrize("with_range", [True, False])
def test_three_pieces_of_a_wall_display_are_one_object(with_range):
    pieces = [piece(-1.0, -0.4), piece(-0.4, 0.5), piece(0.5, 1.0)]
    joined = join_panels(detections(pieces, ["window", "monitor", "picture"], [0.9, 0.6, 0.5], with_range))
    assert joined.labels == ("monitor",)  # the largest score times solid angle: .9 m is wider than .6 m, and central
    assert joined.scores[0] == pytest.approx(0.6)
    whole = piece(-1.0, 1.0)
    assert joined.solid_angle_sr[0] == pytest.approx(whole[3], rel=1e-6)
    np.testing.assert_allclose(joined.bearing[0], whole[2], atol=1e-3)
    assert len(joined.rays[0]) == len(whole[0])
    if with_range:
        np.testing.assert_allclose(joined.centroid_m[0, :2], [2.0, whole[1][:, 1].mean()], atol=1e-5)
        assert joined.size_m[0, 0] == pytest.approx(2.0, abs=0.06)  # 0.02 m a pixel
    else:
        assert np.isnan(joined.centroid_m).all()


@pytest.mark.parametrize(
    ("pieces", "labels"),
    [
        ([piece(-1.0, -0.4), piece(-0.1, 0.5)], ["window", "monitor"]),  # 0.3 m apart
        ([piece(-1.0, 0.0), piece(0.0, 1.0, x_m=2.6)], ["window", "monitor"]),  # on two planes
        ([piece(-1.0, 0.0), piece(0.0, 1.0)], ["window", "cabinet"]),  # a cabinet is no panel
    ],
    ids=["apart", "two planes", "no panel"],
)
def test_other_objects_remain_separate(pieces, labels):
    separate = detections(pieces, labels, [0.9, 0.6])
    assert join_panels(separate) is separate


def test_pieces_without_range_that_are_apart_in_the_image_remain_separate():
    separate = detections([piece(-1.0, -0.4), piece(-0.3, 0.5)], ["window", "monitor"], [0.9, 0.6], with_range=False)
    assert join_panels(separate) is separate


def test_other_objects_stay_in_place_when_a_panel_is_joined():
    pieces = [piece(-2.0, -1.5), piece(0.0, 0.5), piece(2.0, 2.5), piece(0.5, 1.0)]
    before = detections(pieces, ["chair", "television", "lamp", "mirror"], [0.9, 0.8, 0.7, 0.6])
    joined = join_panels(before)
    assert joined.labels == ("chair", "television", "lamp")
    np.testing.assert_allclose(joined.centroid_m[[0, 2]], before.centroid_m[[0, 2]])
    np.testing.assert_allclose(joined.bearing[[0, 2]], before.bearing[[0, 2]], atol=1e-12)


def test_no_objects():
    empty = detections([piece(0.0, 0.5)], ["chair"], [0.9]).take([])
    assert join_panels(empty) is empty
