"""Association of bearings with objects, against the objects that the bearings were computed from."""

from __future__ import annotations

import numpy as np
import pytest
from salframe_graphs.association import ObjectBearings, triangulate_objects

CAMERAS = np.array([[0, 0, 1.5], [1, 0, 1.5], [0, 1, 1.5], [1, 1, 1.5]])


def rays_of(points_m, labels, noise_rad=0.0):
    rng = np.random.default_rng(0)
    offset = (points_m[None] - CAMERAS[:, None]).reshape(-1, 3)
    distance = np.linalg.norm(offset, axis=1, keepdims=True)
    direction = offset / distance + noise_rad * rng.standard_normal(offset.shape)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    frame = np.repeat(np.arange(len(CAMERAS)), len(points_m))
    label = np.tile(np.array(labels, object), len(CAMERAS))
    return ObjectBearings(
        frame, np.zeros(len(CAMERAS), int), label, CAMERAS[frame], direction, 0.25 / distance[:, 0] ** 2
    )


def test_equal_labels_are_told_apart_and_lie_where_the_objects_are():
    points = np.array([[2.5, 0.5, 0.6], [-1.5, 2.0, 0.5], [0.4, -1.8, 0.9], [0.6, 2.8, 1.2]])
    objects = triangulate_objects(rays_of(points, ["chair", "chair", "chair", "lamp"]))
    assert len(objects.position_m) == 4
    nearest = np.linalg.norm(points[:, None] - objects.position_m, axis=2).min(1)
    assert nearest == pytest.approx(np.zeros(4), abs=1e-3)
    owner = objects.owner.reshape(4, 4)
    assert (owner == owner[0]).all()
    assert len(set(owner[0].tolist())) == 4
    assert np.exp(objects.log_area) == pytest.approx(np.full(4, 0.25), rel=1e-3)


def test_the_covariance_covers_the_errors_of_noisy_bearings():
    points = np.array([[2.5, 0.5, 0.6], [-1.5, 2.0, 0.5], [0.4, -1.8, 0.9]])
    objects = triangulate_objects(rays_of(points, ["chair", "bed", "lamp"], 0.01))
    for position, covariance in zip(objects.position_m, objects.covariance_m2, strict=True):
        error = points[np.linalg.norm(points - position, axis=1).argmin()] - position
        assert error @ np.linalg.solve(covariance, error) < 16.3  # 99.9 % quantile of chi-square, 3 degrees


def select(rays, is_selected):
    return ObjectBearings(
        *(
            rays.group if name == "group" else getattr(rays, name)[is_selected]
            for name in ObjectBearings.__dataclass_fields__
        )
    )


def test_an_object_of_one_panorama_has_no_position_if_the_size_of_its_label_is_unknown():
    rays = rays_of(np.array([[2.5, 0.5, 0.6]]), ["chair"])
    assert triangulate_objects(select(rays, rays.frame == 0)).owner.tolist() == [-1]


@pytest.mark.parametrize(("num_cameras", "is_placed"), [(2, True), (3, False), (4, False)])
def test_an_object_of_one_panorama_is_placed_by_size_unless_several_panoramas_miss_it(num_cameras, is_placed):
    points = np.array([[2.5, 0.5, 0.6], [-1.5, 2.0, 0.5], [0.4, -1.8, 0.9], [0.6, 2.8, 1.2]])
    rays = rays_of(points, ["chair"] * 4)
    number = np.tile(np.arange(4), len(CAMERAS))
    rays = select(rays, (rays.frame < num_cameras) & ((number < 3) | (rays.frame == 0)))
    objects = triangulate_objects(rays)
    single = objects.owner[3]  # the fourth chair, which only the first camera sees
    assert (single >= 0) == is_placed
    if is_placed:
        offset = points[3] - CAMERAS[0]
        assert objects.position_m[single] == pytest.approx(points[3], abs=1e-3)  # all chairs have the same size
        direction = offset / np.linalg.norm(offset)
        along_m = np.sqrt(direction @ objects.covariance_m2[single] @ direction)
        # range^2 is proportional to area / solid angle; deviations of their logarithms: 0.35 and 0.6
        assert along_m == pytest.approx(np.linalg.norm(offset) * np.hypot(0.35, 0.6) / 2, rel=1e-3)
        across = np.cross(direction, [0.0, 0.0, 1.0])
        assert np.sqrt(across @ objects.covariance_m2[single] @ across) < along_m / 5
