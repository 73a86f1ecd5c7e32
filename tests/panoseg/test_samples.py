from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="the network is trained with torch: salframe[training]")

from salframe_panoseg.classes import HEIGHT, network_input
from salframe_panoseg.detector import into_panorama

from salframe.panoramas.geometry import equirectangular_rays
from training.panoseg.panoramas import read_panorama, render_panoramas
from training.panoseg.samples import Samples, target
from training.panoseg.train import LABELS, class_pixels, class_weights, panorama_shares

EQUAL = np.full(2, 0.5)


@pytest.fixture(scope="module")
def paths(tmp_path_factory) -> list[Path]:
    """Two panoramas of a building."""
    return render_panoramas(
        tmp_path_factory.mktemp("panoramas"), [21000], 2, HEIGHT, None, None, lambda done, total: None
    )


def test_panoramas_are_rendered_once_and_know_where_their_objects_are(paths):
    counts = []
    assert (
        render_panoramas(
            paths[0].parent, [21000], 2, HEIGHT, None, None, lambda done, total: counts.append((done, total))
        )
        == paths
    )
    assert counts == [(1, 1)]
    panorama = read_panorama(paths[0])
    points_m = equirectangular_rays(HEIGHT) * panorama.range_m[..., None]
    for instance in np.unique(panorama.instance_id)[1:]:
        own = points_m[panorama.instance_id == instance]
        middle = (own.min(0) + own.max(0)) / 2
        assert (
            np.linalg.norm(middle - panorama.centre_m[instance]) < 1.3
        )  # what is seen of an object is part of its box


def test_the_target_of_every_object_pixel_points_to_the_centre(paths):
    panorama = read_panorama(paths[0])
    index = {label: i for i, label in enumerate(sorted(set(panorama.labels.values())), 1)}
    class_id, vote_m = target(panorama, index)
    points_m = equirectangular_rays(HEIGHT) * panorama.range_m[..., None]
    centre_m = points_m + into_panorama(vote_m)
    for instance in np.unique(panorama.instance_id)[1:]:
        own = panorama.instance_id == instance
        assert set(class_id[own].tolist()) == {index[panorama.labels[instance]]}
        np.testing.assert_allclose(centre_m[own], np.tile(panorama.centre_m[instance], (own.sum(), 1)), atol=1e-4)
    assert np.isnan(vote_m[:, panorama.instance_id == 0]).all()
    assert (class_id[panorama.instance_id == 0] == 0).all()


def test_a_sample_depends_on_seed_and_number_alone(paths):
    labels = sorted(set(read_panorama(paths[0]).labels.values()))
    whole, resumed = Samples(paths, EQUAL, labels, 0, 2, 6), Samples(paths, EQUAL, labels, 0, 2, 6, start=4)
    assert (len(whole), len(resumed)) == (6, 2)
    for first, second in zip(whole[5], resumed[1], strict=True):
        np.testing.assert_array_equal(first, second)
    image, class_id, vote_m = whole[5]
    assert class_id.shape == vote_m.shape[1:] == (image.shape[1] // 2, HEIGHT)
    assert np.isfinite(vote_m[:, class_id > 0]).all()
    assert np.abs(whole[4][0] - image).max() > 0.1


def test_a_batch_shows_whole_panoramas_or_the_same_band_of_them(paths):
    labels = sorted(set(read_panorama(paths[0]).labels.values()))
    samples = Samples(paths, EQUAL, labels, 0, 2, 60)
    first_rows = []
    for number in range(0, 60, 2):
        one, other = samples[number][0], samples[number + 1][0]
        assert one.shape == other.shape
        assert one.shape[1:] in ((HEIGHT, 2 * HEIGHT), (160, 2 * HEIGHT))
        elevation = np.arcsin(one[5, 0, 0])
        first_rows.append(round((np.pi / 2 - elevation) / np.pi * HEIGHT - 0.5))
    assert set(first_rows) == {0, 32, 64}


def test_a_panorama_is_drawn_as_often_as_its_share_says(paths):
    labels = sorted(set(read_panorama(paths[0]).labels.values()))
    never_first, second_alone = (
        Samples(paths, np.array([0.0, 1.0]), labels, 0, 2, 4),
        Samples(paths[1:], np.ones(1), labels, 0, 2, 4),
    )
    for number in range(4):
        np.testing.assert_array_equal(never_first[number][1], second_alone[number][1])


def test_the_pixels_of_a_panorama_are_counted_by_class(paths):
    pixels = class_pixels(paths)
    assert pixels.shape == (2, len(LABELS) + 1)
    assert (pixels.sum(1) == 2 * HEIGHT**2).all()
    panorama = read_panorama(paths[1])
    for label in set(panorama.labels.values()):
        instances = [instance for instance, own in panorama.labels.items() if own == label]
        assert pixels[1, 1 + LABELS.index(label)] == np.isin(panorama.instance_id, instances).sum()


def test_panoramas_of_rare_classes_are_drawn_more_often():
    pixels = np.zeros((400, 3), int)
    pixels[:, 0], pixels[:, 1] = (
        1000,
        60,
    )  # structure and class 1 everywhere, class 2 in one panorama of 400, and too small in a second
    pixels[7, 2], pixels[8, 2] = 50, 49
    shares = panorama_shares(pixels)
    assert shares.sum() == pytest.approx(1)
    assert shares[7] / shares[0] == pytest.approx((0.1 / (1 / 400)) ** 0.5)  # LVIS: sqrt(t / f)
    assert shares[8] == shares[0]


def test_rare_classes_count_more_and_structure_least():
    weights = class_weights(np.array([[900, 25, 50, 100]])).numpy()
    np.testing.assert_allclose(weights, [0.12, 2**0.5, 1, 0.5**0.5], rtol=1e-6)


def test_the_networks_input_keeps_what_is_unknown_apart(paths):
    panorama = read_panorama(paths[0])
    range_m = panorama.range_m.copy()
    range_m[100:120, 200:220] = np.nan
    image = network_input(panorama.rgb, range_m)
    assert (image[3:5, 100:120, 200:220] == 0).all()
    known = np.isfinite(range_m)
    np.testing.assert_allclose(image[3][known], 1 / (1 + range_m[known]), rtol=1e-6)
    floor = image[4, -1]
    assert np.allclose(floor, floor[0], atol=0.01)  # straight below, the floor is as deep all around
    np.testing.assert_allclose(
        image[5, :, 0], np.sin(np.pi / 2 - np.pi * (np.arange(HEIGHT) + 0.5) / HEIGHT), atol=1e-6
    )
    large = network_input(np.repeat(np.repeat(panorama.rgb, 2, 0), 2, 1), np.repeat(np.repeat(range_m, 2, 0), 2, 1))
    np.testing.assert_allclose(large, image, atol=1e-5)
