"""Errors in annotations: as often as stated, where they are stated to lie, and the same ones every time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from salframe.panoramas.object_noise import AnnotationNoise, another_label, spoil_annotations
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama

WORDS = ("bed", "chair", "lamp", "table")
COLUMNS, ROWS = 40, 20


def pictured(name: str = "frame") -> Panorama:
    """800 objects of 3 x 3 pixels with a rim of one pixel around each, k at a range of 1 + k / 1000 m, before a wall at
    5 m."""
    height = 128
    instance_id, range_m = np.zeros((height, 2 * height), np.int32), np.full((height, 2 * height), 5, np.float32)
    for key in range(1, COLUMNS * ROWS + 1):
        row, column = divmod(key - 1, COLUMNS)
        patch = slice(5 * row + 1, 5 * row + 4), slice(5 * column + 1, 5 * column + 4)
        instance_id[patch], range_m[patch] = key, 1 + key / 1000
    labels = {key: WORDS[key % 4] for key in range(1, COLUMNS * ROWS + 1)}
    rgb = np.full((height, 2 * height, 3), 90, np.uint8)
    return Panorama(name, rgb, range_m, annotations=Annotations(instance_id, labels, rendered=True))


def listed(name: str = "frame") -> Panorama:
    rng, count = np.random.default_rng(0), 800
    words = tuple(WORDS[i % 4] for i in range(count))
    keys = tuple(f"key-{i}" for i in range(count))
    boxes = ObjectBoxes(words, keys, rng.normal(0, 3, (count, 3)), rng.uniform(0.1, 2, (count, 3)), np.zeros(count))
    return Panorama(name, annotations=Annotations(objects=boxes))


def told(panorama: Panorama) -> dict[int, str]:
    ids = np.unique(panorama.annotations.instance_id)
    return {int(key): panorama.annotations.labels[int(key)] for key in ids if key}


def test_without_noise_nothing_changes() -> None:
    for one in (pictured(), listed()):
        spoilt = spoil_annotations(one, AnnotationNoise(), 3)
        if one.annotations.objects is None:
            np.testing.assert_array_equal(spoilt.annotations.instance_id, one.annotations.instance_id)
            np.testing.assert_array_equal(spoilt.range_m, one.range_m)
            assert spoilt.annotations.labels == one.annotations.labels
            assert spoilt.annotations.rendered
        else:
            np.testing.assert_array_equal(spoilt.annotations.objects.centroid_m, one.annotations.objects.centroid_m)
            assert spoilt.annotations.objects.labels == one.annotations.objects.labels


@pytest.mark.parametrize("share", [0.5, 0.66])
def test_as_many_are_missed_as_stated(share: float) -> None:
    """Of 800, within three deviations of the binomial; of the pixels nothing changes but who they belong to."""
    allowed = 3 * np.sqrt(800 * share * (1 - share))
    one = pictured()
    spoilt = spoil_annotations(one, AnnotationNoise(missed=share), 0)
    assert 800 - len(told(spoilt)) == pytest.approx(800 * share, abs=allowed)
    np.testing.assert_array_equal(spoilt.range_m, one.range_m)
    left = spoilt.annotations.instance_id > 0
    np.testing.assert_array_equal(spoilt.annotations.instance_id[left], one.annotations.instance_id[left])
    boxes = spoil_annotations(listed(), AnnotationNoise(missed=share), 0).annotations.objects
    assert 800 - len(boxes.labels) == pytest.approx(800 * share, abs=allowed)


def test_what_is_missed_at_a_share_is_missed_at_larger_ones() -> None:
    few, most = (set(told(spoil_annotations(pictured(), AnnotationNoise(missed=share), 0))) for share in (0.3, 0.6))
    assert most < few


def test_draws_are_those_of_seed_frame_and_object() -> None:
    noise = AnnotationNoise(missed=0.5)
    whole = pictured()
    found = set(told(spoil_annotations(whole, noise, 0)))
    assert set(told(spoil_annotations(whole, noise, 0))) == found
    others = [spoil_annotations(whole, noise, 1), spoil_annotations(pictured("other"), noise, 0)]
    for other in others:
        assert len(found & set(told(other))) == pytest.approx(200, abs=45)  # independent: a quarter of 800
    half = np.where(whole.annotations.instance_id <= 400, whole.annotations.instance_id, 0).astype(np.int32)
    alone = replace(whole, annotations=replace(whole.annotations, instance_id=half))
    assert set(told(spoil_annotations(alone, noise, 0))) == {key for key in found if key <= 400}


def test_mislabelled_objects_get_another_word_each_as_likely() -> None:
    spoilt = told(spoil_annotations(pictured(), AnnotationNoise(mislabelled=1), 0))
    assert all(word != WORDS[key % 4] for key, word in spoilt.items())
    counts = [sum(word == WORDS[0] for key, word in spoilt.items() if key % 4 == other) for other in (1, 2, 3)]
    assert counts == pytest.approx([200 / 3] * 3, abs=3 * np.sqrt(200 * 2 / 9))
    words = spoil_annotations(listed(), AnnotationNoise(mislabelled=0.25), 0).annotations.objects.labels
    assert sum(word != WORDS[i % 4] for i, word in enumerate(words)) == pytest.approx(200, abs=37)
    assert another_label("bed", ("bed",), np.random.default_rng(0)) == "bed"


def test_ranges_are_off_by_a_factor_an_object_and_walls_are_not() -> None:
    one = pictured()
    spoilt = spoil_annotations(one, AnnotationNoise(range_share=0.1), 0)
    factor, ids = spoilt.range_m / one.range_m, one.annotations.instance_id
    assert (factor[ids == 0] == 1).all()
    by_object = [factor[ids == key] for key in range(1, 801)]
    assert max(np.ptp(values) for values in by_object) < 1e-6
    means = np.array([values[0] for values in by_object])
    assert (means.mean(), means.std()) == (pytest.approx(1, abs=0.011), pytest.approx(0.1, abs=0.008))
    before, after = (
        p.annotations.objects for p in (listed(), spoil_annotations(listed(), AnnotationNoise(range_share=0.1), 0))
    )
    ratio = after.centroid_m / before.centroid_m
    np.testing.assert_allclose(ratio, np.repeat(ratio[:, :1], 3, 1))  # along the ray
    np.testing.assert_allclose(after.size_m / before.size_m, ratio)  # spanning the same angle
    assert ratio[:, 0].std() == pytest.approx(0.1, abs=0.008)


def test_what_is_made_up_has_the_outline_of_another_on_what_is_no_object() -> None:
    """One object of 4 x 6 pixels and as large a double: at its rows, on the wall, under the other word."""
    height = 64
    instance_id = np.zeros((height, 2 * height), np.int32)
    instance_id[20:24, 30:36] = 5
    range_m = np.full(instance_id.shape, 3, np.float32)
    one = Panorama("p", range_m=range_m, annotations=Annotations(instance_id, {5: "bed", 9: "lamp"}))
    spoilt = spoil_annotations(one, AnnotationNoise(false_positives=1), 0)
    false_positives = spoilt.annotations.instance_id == 10
    assert spoilt.annotations.labels == {5: "bed", 9: "lamp", 10: "lamp"}
    assert (spoilt.annotations.instance_id[instance_id == 5] == 5).all()
    rows, columns = np.nonzero(false_positives)
    assert set(rows) == {20, 21, 22, 23}
    assert false_positives.sum() == 24
    assert len(set(columns)) == 6
    np.testing.assert_array_equal(spoilt.range_m, range_m)
    twice = [spoil_annotations(replace(one, id=name), AnnotationNoise(false_positives=1), 0) for name in ("a", "b")]
    assert not np.array_equal(*(other.annotations.instance_id for other in twice))


def test_what_is_made_up_in_a_list_stands_as_high_and_far_as_another() -> None:
    before = listed().annotations.objects
    after = spoil_annotations(listed(), AnnotationNoise(false_positives=0.5), 0).annotations.objects
    false_positives = [i for i, key in enumerate(after.keys) if key.endswith("made up")]
    assert len(false_positives) == pytest.approx(400, abs=43)
    assert len(set(after.keys)) == len(after.keys) == 800 + len(false_positives)
    for i in false_positives[:50]:
        source = before.keys.index(after.keys[i].removesuffix(" made up"))
        assert after.labels[i] != before.labels[source]
        assert after.centroid_m[i, 2] == before.centroid_m[source, 2]
        assert np.linalg.norm(after.centroid_m[i]) == pytest.approx(np.linalg.norm(before.centroid_m[source]))
        np.testing.assert_array_equal(after.size_m[i], before.size_m[source])


def test_a_panorama_without_annotations_or_objects_stays() -> None:
    plain = Panorama("p", np.zeros((8, 16, 3), np.uint8))
    noise = AnnotationNoise(missed=0.5, false_positives=0.5)
    assert spoil_annotations(plain, noise, 0) is plain
    bare = Panorama("p", annotations=Annotations(np.zeros((8, 16), np.int32)))
    assert not spoil_annotations(bare, noise, 0).annotations.instance_id.any()
    assert (
        spoil_annotations(
            Panorama("p", annotations=Annotations(objects=ObjectBoxes.empty())), noise, 0
        ).annotations.objects.labels
        == ()
    )
