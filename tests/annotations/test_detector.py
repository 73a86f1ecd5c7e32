"""The detector `annotations` on panoramas of boxes whose place is known."""

import json
from dataclasses import replace

import numpy as np
import pytest
from salframe_annotations.detector import AnnotationDetector
from tiny_folder import write_tiny_folder

from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import MethodStatus
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.errors import InputMissing
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.panorama import VISIBLE_PIXELS, Annotations, ObjectBoxes, Panorama

HEIGHT = 128


def panorama(name="frame", objects=12, shift=0, height=HEIGHT):
    """Patches at known ranges around the camera: object k spans 15 deg of azimuth at range 1 + 0.1 k, turned by `shift`
    columns."""
    range_m = np.full((height, 2 * height), 5.0, np.float32)
    ids = np.zeros((height, 2 * height), np.int32)
    span = 2 * height // objects
    for k in range(objects):
        columns = slice(k * span, k * span + span // 2)
        range_m[height // 2 : height // 2 + 20, columns] = 1 + 0.1 * k
        ids[height // 2 : height // 2 + 20, columns] = k + 1
    labels = {k + 1: f"label-{k % 5}" for k in range(objects)}
    return Panorama(name, range_m=np.roll(range_m, shift, 1), annotations=Annotations(np.roll(ids, shift, 1), labels))


def detect(pano, **settings):
    return AnnotationDetector(AnnotationDetector.Config(**settings)).detect(pano)


def test_points_and_centroids_are_those_of_the_patches():
    pano = panorama()
    found = detect(pano, noise="none")
    assert found.labels == tuple(f"label-{k % 5}" for k in range(12))
    for k in range(12):
        mask = pano.annotations.instance_id == k + 1
        expected = equirectangular_rays(HEIGHT)[mask] * (1 + 0.1 * k)
        np.testing.assert_allclose(found.centroid_m[k], expected.mean(0), atol=1e-5)
        assert len(found.points_m[k]) == mask.sum()


def test_small_and_unlabelled_objects_and_unknown_range_are_left_out():
    pano = panorama(objects=2)
    ids, range_m = np.array(pano.annotations.instance_id), np.array(pano.range_m)
    ids[0, : VISIBLE_PIXELS - 1] = 7
    ids[2, :VISIBLE_PIXELS] = 8
    ids[4, :VISIBLE_PIXELS] = 9
    range_m[4, :VISIBLE_PIXELS] = np.nan
    labels = {1: "a", 2: "b", 7: "few", 8: "just", 9: "no range"}
    found = detect(Panorama("x", range_m=range_m, annotations=Annotations(ids, labels)), noise="none")
    assert found.labels == ("a", "b", "just")


def test_noise_has_the_stated_rates():
    """300 frames of 12 objects: shares within 4 standard errors, spread of the ranges within 10 %."""
    clean = detect(panorama(), noise="none")
    missed, wrong, factors = 0, 0, []
    for frame in range(300):
        found = detect(panorama(f"frame-{frame}", height=64), noise="uniform-heavy")
        reference = detect(panorama(f"frame-{frame}", height=64), noise="none")
        missed += len(reference) - len(found)
        azimuth = np.arctan2(found.centroid_m[:, 1], found.centroid_m[:, 0])
        at = np.abs(azimuth[:, None] - np.arctan2(reference.centroid_m[:, 1], reference.centroid_m[:, 0])).argmin(1)
        wrong += sum(label != reference.labels[i] for label, i in zip(found.labels, at, strict=True))
        factors.extend(np.linalg.norm(found.centroid_m, axis=1) / np.linalg.norm(reference.centroid_m[at], axis=1))
    total = 300 * len(clean)
    assert missed / total == pytest.approx(0.20, abs=4 * np.sqrt(0.16 / total))
    assert wrong / (total - missed) == pytest.approx(0.10, abs=4 * np.sqrt(0.09 / total))
    assert np.std(factors) == pytest.approx(0.10, rel=0.1)
    assert np.mean(factors) == pytest.approx(1, abs=0.01)


def test_noise_is_keyed_by_seed_frame_and_object():
    base = detect(panorama(), noise="uniform-heavy")
    again = detect(panorama(), noise="uniform-heavy")
    np.testing.assert_array_equal(base.centroid_m, again.centroid_m)
    assert (
        len(detect(panorama("other"), noise="uniform-heavy")) != len(base)
        or detect(panorama("other"), noise="uniform-heavy").labels != base.labels
    )
    assert detect(panorama(), noise="uniform-heavy", seed=1).labels != base.labels


@pytest.mark.parametrize("columns", [1, 37, HEIGHT, 2 * HEIGHT - 3])
def test_turning_the_panorama_turns_the_objects(columns):
    """Also across the seam: patch 0 starts at column 0 and is cut by it when turned."""
    base, turned = detect(panorama(), noise="uniform-heavy"), detect(panorama(shift=columns), noise="uniform-heavy")
    angle = -2 * np.pi * columns / (2 * HEIGHT)
    c, s = np.cos(angle), np.sin(angle)
    assert turned.labels == base.labels
    np.testing.assert_allclose(
        turned.centroid_m, base.centroid_m @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), atol=1e-6
    )
    np.testing.assert_allclose(turned.size_m, base.size_m, atol=1e-6)
    np.testing.assert_allclose(np.sin(turned.yaw_rad - base.yaw_rad - angle), 0, atol=2e-5)  # float32 points


def test_split_and_merged_objects():
    whole = detect(panorama(), noise="none")
    split = detect(panorama(), noise={"split": 1.0})
    assert len(split) == 2 * len(whole)
    assert sum(len(points) for points in split.points_m) == sum(len(points) for points in whole.points_m)
    merged = detect(panorama(), noise={"merged": 1.0})
    assert len(merged) == len(whole)
    assert merged.size_m[:, :2].max(1).min() > whole.size_m[:, :2].max(1).max()


def listed():
    objects = ObjectBoxes(
        ("bed", "lamp"),
        ("k1", "k2"),
        np.array([[2, 0, -0.5], [0, 3, 0.2]]),
        np.array([[2, 1.5, 0.6], [0.3, 0.3, 0.5]]),
        np.array([0.3, 0.0]),
    )
    return Panorama("viewpoint", annotations=Annotations(objects=objects))


def test_object_lists_are_taken_as_they_are():
    """noise auto: real annotation has errors of its own."""
    found = detect(listed())
    expected = listed().annotations.objects
    assert found.labels == expected.labels
    np.testing.assert_allclose(found.centroid_m, expected.centroid_m, atol=1e-6)
    np.testing.assert_allclose(found.size_m, expected.size_m, atol=1e-6)
    assert np.abs(np.sin(found.yaw_rad[0] - 0.3)) < 1e-6


def test_object_lists_take_noise_when_asked():
    found = detect(listed(), noise={"range_share": 0.1})
    ratio = np.linalg.norm(found.centroid_m, axis=1) / np.linalg.norm(listed().annotations.objects.centroid_m, axis=1)
    assert (np.abs(ratio - 1) > 1e-3).all()
    np.testing.assert_allclose(
        found.size_m / listed().annotations.objects.size_m, ratio[:, None] * np.ones((1, 3)), rtol=1e-5
    )


def test_missing_input_is_said():
    with pytest.raises(InputMissing, match="has no annotations"):
        detect(Panorama("x", range_m=np.ones((4, 8), np.float32)))


def test_without_range_objects_have_bearings_and_solid_angles():
    """A patch of 20 rows by w columns from the horizon down: its solid angle is that of the band, its bearing the
    integral of the directions over it."""
    pano = replace(panorama(), range_m=None)
    found = detect(pano, noise="none")
    assert found.labels == tuple(f"label-{k % 5}" for k in range(12))
    assert np.isnan(found.centroid_m).all()
    assert found.points_m is None
    low, width = np.pi * 20 / HEIGHT, np.pi * 10 / HEIGHT  # 10 columns
    np.testing.assert_allclose(found.solid_angle_sr, width * np.sin(low), rtol=1e-3)
    azimuth = np.pi - np.pi * (21 * np.arange(12) + 5) / HEIGHT
    elevation = np.arctan2(-(np.sin(low) ** 2) * width / 2, (low + np.sin(2 * low) / 2) / 2 * 2 * np.sin(width / 2))
    expected = np.column_stack([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation)])
    np.testing.assert_allclose(found.bearing[:, :2], expected, atol=1e-3)
    np.testing.assert_allclose(found.bearing[:, 2], np.sin(elevation), atol=1e-3)


def test_without_range_the_same_objects_are_missed_and_mislabelled():
    for frame in range(20):
        pano = panorama(f"frame-{frame}")
        ranged, unranged = (
            detect(pano, noise="uniform-heavy"),
            detect(replace(pano, range_m=None), noise="uniform-heavy"),
        )
        assert unranged.labels == ranged.labels
        np.testing.assert_allclose(unranged.bearing, ranged.bearing, atol=6e-3)
        np.testing.assert_array_equal(unranged.solid_angle_sr, ranged.solid_angle_sr)


def test_halves_share_the_solid_angle_and_pairs_add_theirs():
    pano = replace(panorama(), range_m=None)
    whole = detect(pano, noise="none")
    halves = detect(pano, noise={"split": 1.0})
    assert len(halves) == 24
    np.testing.assert_allclose(halves.solid_angle_sr.reshape(12, 2).sum(1), whole.solid_angle_sr, rtol=1e-6)
    merged = detect(pano, noise={"merged": 1.0})
    np.testing.assert_allclose(merged.solid_angle_sr, 2 * whole.solid_angle_sr, rtol=1e-6)


def test_auto_noise_is_for_rendered_panoramas():
    """Real annotations hold errors of their own, perfect ones are given a detector's."""
    real = panorama()
    annotations = real.annotations
    rendered = Panorama(
        real.id,
        range_m=real.range_m,
        annotations=Annotations(annotations.instance_id, annotations.labels, rendered=True),
    )
    for pano, level in ((real, "none"), (rendered, "panoseg")):
        np.testing.assert_array_equal(detect(pano).centroid_m, detect(pano, noise=level).centroid_m)
    assert detect(rendered, noise="panoseg").labels != detect(rendered, noise="none").labels


def test_without_range_labels_are_enough_for_objects(fakes, monkeypatch, tmp_path):
    """A folder with instance images alone."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "salframe_annotations,salframe_objects,salframe_engines,salframe.configs")
    manifest = write_tiny_folder(tmp_path / "tiny") / "manifest.json"
    content = json.loads(manifest.read_text())
    for frame in content["frames"]:
        del frame["range"]
    manifest.write_text(json.dumps(content))
    result = compare(
        Request(("objects",), str(manifest.parent), settings=("detector.kind=annotations",), engine="inline")
    )
    assert result.rows[0].ended is MethodStatus.DONE
    assert result.rows[0].accuracy is not None
