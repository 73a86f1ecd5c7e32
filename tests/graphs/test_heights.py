"""Heights of cameras above the floor, in descriptions and in places, and what they change in the likelihood."""

import numpy as np
import pytest
from salframe_graphs.places.heights import (
    height_of,
    join_heights,
    measure_height,
    pack_height,
    place_heights,
    unpack_height,
)
from salframe_graphs.places.outline import free_outline
from salframe_graphs.places.scene_frames import SceneFrames

from salframe.panoramas.geometry import pose_2d
from salframe.panoramas.panorama import Panorama
from salframe.testing.rooms import ROOMS, look, stand


@pytest.mark.parametrize("height_m", [0.4, 1.0, 1.5, 2.1])
def test_the_height_of_a_camera_is_measured_and_packed(height_m):
    pose = stand(ROOMS[2])
    pose[2, 3] = height_m
    description = measure_height(look(ROOMS[2], "q", pose, {"range"}))
    assert height_of(description) == pytest.approx(height_m, abs=0.01)
    packed = pack_height(description)
    assert sum(array.nbytes for array in packed.values()) == 2
    assert height_of(unpack_height(packed)) == pytest.approx(height_m, abs=0.011)


def test_no_height_is_known_without_a_measured_range():
    range_m = look(ROOMS[0], "q", stand(ROOMS[0]), {"range"}).range_m
    estimated = Panorama("q", np.zeros((*range_m.shape, 3), np.uint8), range_m, range_by="network")
    blind = Panorama("q", range_m=np.full_like(range_m, np.nan))
    for panorama in (estimated, blind, Panorama("q")):
        description = measure_height(panorama)
        assert np.isnan(height_of(description))
        assert pack_height(description) == unpack_height(pack_height(description)) == {}


def test_the_height_of_the_last_view_is_the_median_of_what_all_views_know():
    motions = np.array([pose_2d(1, 0, 0, 0.2), pose_2d(0, 1, 1, -0.3), pose_2d(0, 0, 0)])
    assert height_of(join_heights([1.7, np.nan, np.nan], motions)) == pytest.approx(1.5)
    assert height_of(join_heights([1.7, 1.1, 1.52], motions)) == pytest.approx(1.5)
    assert join_heights([np.nan] * 3, motions) == {}


def test_the_height_of_a_place_is_that_of_its_median_camera_over_the_floor():
    scene_frames = SceneFrames(("a", "b", "c"), np.arange(3), np.arange(6), np.array([0, 3, 5, 6]))
    z_m = np.array([1.5, 1.6, 0.4, 4.5, 4.5, 1.0])
    height_m = np.array([1.5, 1.6, 0.4, np.nan, 1.4, np.nan])
    np.testing.assert_allclose(place_heights(scene_frames, height_m, z_m), [1.5, 1.4, np.nan])


@pytest.mark.parametrize("height_m", [0.5, 1.0, 2.0])
def test_the_outline_is_taken_at_one_height_over_the_floor(height_m):
    usual, other = stand(ROOMS[2]), stand(ROOMS[2])
    other[2, 3] = height_m
    first, second = (free_outline(look(ROOMS[2], "q", pose, {"range"}).range_m, pose[2, 3]) for pose in (usual, other))
    finite = np.isfinite(first) & np.isfinite(second)
    assert finite.mean() > 0.9
    assert np.median(np.abs(np.log(first[finite] / second[finite]))) < 0.02
