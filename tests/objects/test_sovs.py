"""The localizer `sovs`, against sums computed by hand and exhaustive matching."""

from itertools import permutations

import numpy as np
import pytest
from salframe_objects.sovs import SalientVolumesLocalizer, compare_places

from salframe.graphs.detections import Detections
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama


def place(*objects):
    """A described place of objects (label, weight, position in metres)."""
    labels, weight, centroid_m = zip(*objects, strict=True)
    return {"labels": np.array(labels), "weight": np.array(weight, float), "centroid_m": np.array(centroid_m, float)}


def turn(described, yaw_rad):
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return {**described, "centroid_m": described["centroid_m"] @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])}


def random_place(seed, count=6):
    rng = np.random.default_rng(seed)
    labels, weight = rng.choice(["bed", "lamp", "chair"], count), rng.uniform(0.1, 1, count)
    return {"labels": labels, "weight": weight, "centroid_m": rng.uniform(-3, 3, (count, 3))}


def test_range_and_weight_by_hand():
    # Same directions; ranges 1 and 2 share half; weights share the smaller: 0.3 + 0.2, each halved.
    near = place(("bed", 0.3, (1, 0, 0)), ("lamp", 0.7, (0, 1, 0)))
    far = place(("bed", 0.8, (2, 0, 0)), ("lamp", 0.2, (0, 2, 0)))
    assert compare_places(near, far) == pytest.approx(0.25 / (2 - 0.25))


def test_direction_by_hand():
    # Bed and lamp stand 90 degrees apart, in the map 30 degrees: a turn brings one to its place and leaves the other
    # cos 60 = 0.5.
    query = place(("bed", 0.6, (1, 0, 0)), ("lamp", 0.4, (0, 1, 0)))
    mapped = place(("bed", 0.6, (1, 0, 0)), ("lamp", 0.4, (np.cos(np.pi / 6), np.sin(np.pi / 6), 0)))
    assert compare_places(query, mapped) == pytest.approx((0.6 + 0.2) / (2 - 0.8))


def test_height_is_part_of_direction():
    # A lamp at the ceiling, 45 degrees up, against one at eye height, as far away.
    assert compare_places(place(("lamp", 1, (1, 0, 1))), place(("lamp", 1, (2**0.5, 0, 0)))) == pytest.approx(
        0.5**0.5 / (2 - 0.5**0.5)
    )


def test_labels_must_agree_and_objects_count_once():
    assert compare_places(place(("bed", 1, (1, 0, 0))), place(("lamp", 1, (1, 0, 0)))) == 0
    two = place(("lamp", 0.5, (1, 0, 0)), ("lamp", 0.5, (1, 0, 0)))
    assert compare_places(two, place(("lamp", 0.5, (1, 0, 0)), ("bed", 0.5, (0, 1, 0)))) == pytest.approx(0.5 / 1.5)


@pytest.mark.parametrize("yaw_rad", [0.4, 1.9, 3.1, 5.5])
def test_heading_is_free(yaw_rad):
    one, other = random_place(1), random_place(2)
    assert compare_places(one, turn(one, yaw_rad)) == pytest.approx(1)
    assert compare_places(turn(one, yaw_rad), other) == pytest.approx(compare_places(one, other))


@pytest.mark.parametrize("seed", range(5))
def test_the_best_matching_and_turn_are_found(seed):
    """Against every permutation at every turn."""
    a, b = random_place(seed, 5), random_place(seed + 100, 5)
    best = 0.0
    for first, second in np.argwhere(a["labels"][:, None] == b["labels"]):
        azimuth_a, azimuth_b = (
            np.arctan2(p["centroid_m"][i, 1], p["centroid_m"][i, 0]) for p, i in ((a, first), (b, second))
        )
        p, q = turn(a, azimuth_b - azimuth_a)["centroid_m"], b["centroid_m"]
        range_p, range_q = np.linalg.norm(p, axis=1), np.linalg.norm(q, axis=1)
        for order in map(list, permutations(range(5))):
            cosine = np.maximum((p * q[order]).sum(1) / (range_p * range_q[order]), 0)
            ratio = np.minimum(range_p, range_q[order]) / np.maximum(range_p, range_q[order])
            same = a["labels"] == b["labels"][order]
            best = max(best, float((same * np.minimum(a["weight"], b["weight"][order]) * cosine * ratio).sum()))
    assert compare_places(a, b) == pytest.approx(best / (a["weight"].sum() + b["weight"].sum() - best))


def test_objects_of_unknown_range_are_left_out():
    centroid_m = np.array([[1.0, 0, 0], [np.nan, np.nan, np.nan]])
    objects = Detections(["bed", "lamp"], np.ones(2), centroid_m, np.full((2, 3), 0.5), np.zeros(2))
    config = SalientVolumesLocalizer.Config(detector={"kind": "annotations", "noise": "none"})
    localizer = SalientVolumesLocalizer(config)
    described = localizer.describe(
        Panorama(
            "room",
            annotations=Annotations(
                objects=ObjectBoxes(objects.labels, ("a", "b"), objects.centroid_m, objects.size_m, objects.yaw_rad)
            ),
        )
    )
    assert described["labels"].tolist() == ["bed"]
    assert described["weight"].tolist() == [1.0]
