"""show-objects: pictures and numbers of panoramas and photographs, and what can be wrong with them."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from ball_plugin import BALLS, angular_radius
from command_line import run
from PIL import Image
from tiny_folder import write_tiny_folder

from salframe.framework.components.registry import registry
from salframe.panoramas import images
from salframe.panoramas.geometry import equirectangular_rays

DETECTOR = ("--detector", "balls")


@pytest.fixture
def pictures(fakes, tmp_path, monkeypatch):
    """A working directory with a panorama, its range, a photograph and its depth, and the detector of balls."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "ball_plugin,salframe_graphs,salframe_annotations")
    registry.cache_clear()
    images.write_color(tmp_path / "hall.jpg", np.full((160, 320, 3), 128, np.uint8))
    images.write_range(tmp_path / "hall.range.png", np.full((160, 320), 2.5))
    images.write_color(tmp_path / "desk.png", np.full((480, 640, 3), 128, np.uint8))
    images.write_range(tmp_path / "desk.depth.png", np.full((480, 640), 3.0))
    return tmp_path


def test_a_panorama_with_range(pictures):
    shown = run("show-objects", "hall.jpg", *DETECTOR, "--range", "hall.range.png", "-o", "out", "--json")
    assert (shown.code, shown.err) == (0, "")
    (view,) = shown.json["images"]
    assert view["detector"] == "balls"
    assert (view["image"], view["picture"]) == ("hall.jpg", "out/hall.objects.png")
    assert view["seconds"] > 0
    for found, (label, centre_m, radius_m, score) in zip(view["objects"], BALLS, strict=True):
        x, y, z = centre_m
        distance_m = np.linalg.norm(centre_m)
        assert (found["label"], found["score"]) == (label, score)
        assert found["azimuth_deg"] % 360 == pytest.approx(np.degrees(np.arctan2(y, x)) % 360, abs=1)
        assert found["elevation_deg"] == pytest.approx(np.degrees(np.arcsin(z / distance_m)), abs=1)
        assert distance_m - radius_m < found["range_m"] < distance_m
        # What is seen of a ball across: a circle of radius r cos(a), a its angular radius.
        across_m = 2 * radius_m * np.cos(angular_radius(centre_m, radius_m))
        assert across_m - 3 * distance_m * np.pi / 256 < found["size_m"][0] < across_m + 1e-3
    assert sum(found["saliency"] for found in view["objects"]) == pytest.approx(1)
    assert max(view["objects"], key=lambda found: found["saliency"])["label"] == "ottoman"
    assert Image.open("out/hall.objects.png").size[0] == 1280


def test_without_range_there_are_bearings_alone(pictures):
    (view,) = run("show-objects", "hall.jpg", *DETECTOR, "--json").json["images"]
    globe = view["objects"][0]
    assert globe["azimuth_deg"] == pytest.approx(60)
    assert globe["elevation_deg"] == pytest.approx(0, abs=1e-9)
    assert globe["range_m"] is globe["size_m"] is globe["saliency"] is None


def test_a_photograph_is_drawn_in_its_own_pixels(pictures):
    arguments = ("desk.png", *DETECTOR, "--fov", "60", "--elevation", "40", "--range", "desk.depth.png")
    assert run("show-objects", *arguments).out.startswith("desk.objects.png: 3 objects in ")
    drawn = np.asarray(Image.open("desk.objects.png"))
    assert drawn.shape[1] == 2 * 640
    # The lamp, 45 deg up, is 5 deg above the middle; focal length 320 / tan 30 deg, all drawn twice as large.
    focal, middle = 2 * 320 / np.tan(np.radians(30)), 2 * 240
    row = middle - focal * np.tan(np.radians(5))
    title = 2 * round(1280 / 80)
    inside, outside = drawn[title + round(row) + 60, 640], drawn[title + round(row) + 400, 640]
    assert (inside != 128).any()
    assert (outside == 128).all()


def test_settings_change_detector_and_graph(pictures):
    arguments = ("hall.jpg", *DETECTOR, "--set", "detector.min_score=0.6", "--json")
    (view,) = run("show-objects", *arguments).json["images"]
    assert view["detector"] == "balls (min_score=0.6)"
    assert [found["label"] for found in view["objects"]] == ["globe", "ottoman"]
    assert (
        "unknown setting grph, did you mean" in run("show-objects", "hall.jpg", *DETECTOR, "--set", "grph.top_k=1").err
    )
    assert "unknown detector 'bals', did you mean 'balls'?" in run("show-objects", "hall.jpg", "--detector", "bals").err


def test_images_of_a_folder_come_with_what_its_manifest_names(pictures):
    folder = write_tiny_folder(pictures / "data")
    names = [folder / f"frames/{room}-map.rgb.png" for room in ("bedroom", "kitchen")]
    shown = run("show-objects", *names, "--detector", "annotations", "-o", "out", "--json").json
    assert [len(view["objects"]) for view in shown["images"]] == [7, 6]
    assert (pictures / "out/kitchen-map.rgb.objects.png").exists()


def test_a_range_in_a_wrong_unit_is_told(pictures):
    rays = equirectangular_rays(160)
    with np.errstate(divide="ignore"):
        floor_m = np.where(rays[..., 2] < -0.1, -1.5 / rays[..., 2], 3.0).astype(np.float32)
    for factor, told in ((1, ""), (4, "warning: the floor lies 6 m below the camera")):
        images.write_range(pictures / "room.png", floor_m * factor)
        done = run("show-objects", "hall.jpg", "--range", "room.png", *DETECTOR)
        assert done.code == 0
        assert ("warning" in done.err) == bool(told)
        assert told in done.err


def test_auto_is_decided_by_what_an_image_provides(pictures):
    folder = write_tiny_folder(pictures / "data")
    done = run("show-objects", folder / "frames/kitchen-map.rgb.png", "hall.jpg", "--json")
    assert done.code == 1
    assert [view["detector"] for view in done.json["images"]] == ["annotations"]
    assert done.err.startswith("'auto' selected the detector 'annotations'\nerror: 'auto' cannot select a detector")
    assert (
        "'auto' cannot select a detector for hall.jpg, because none can run: 'annotations': needs annotations"
        in done.err
    )
    assert (
        "unknown setting" in run("show-objects", folder / "frames/kitchen-map.rgb.png", "--set", "detector.nois=1").err
    )


def test_a_bad_image_costs_its_own_answer_alone(pictures):
    (pictures / "torn.png").write_bytes((pictures / "desk.png").read_bytes()[:100])
    done = run("show-objects", "torn.png", "hall.jpg", "desk.png", "gone.png", *DETECTOR)
    assert done.code == 1
    assert done.out.startswith("hall.objects.png: 3 objects in ")
    assert done.out.count("\n") == 1
    torn, desk, gone = done.err.splitlines()
    assert torn.startswith("error: torn.png is not a readable image")
    assert desk.startswith("error: desk.png is 640 x 480, expected width = 2 x height (a panorama)")
    assert "--fov" in desk
    assert gone == "error: cannot read gone.png: No such file or directory, expected a readable image"
    again = run("show-objects", "torn.png", "hall.jpg", *DETECTOR, "--json")
    assert again.code == 1
    assert [one["image"] for one in again.json["images"]] == ["hall.jpg"]
    assert [one["image"] for one in again.json["failures"]] == ["torn.png"]


def test_only_pictures_of_ours_are_overwritten(pictures):
    assert run("show-objects", "hall.jpg", *DETECTOR).code == 0
    assert run("show-objects", "hall.jpg", *DETECTOR).code == 0
    for spoil in (lambda path: cv2.imwrite(str(path), np.zeros((9, 9, 3))), lambda path: path.write_text("dear")):
        spoil(pictures / "hall.objects.png")
        before = (pictures / "hall.objects.png").read_bytes()
        done = run("show-objects", "hall.jpg", *DETECTOR)
        assert (done.code, done.err.count("\n")) == (1, 1)
        assert "hall.objects.png exists and was not written by show-objects" in done.err
        assert (pictures / "hall.objects.png").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (
            ("hall.jpg", "desk.png", "--range", "hall.range.png"),
            2,
            "received 2 images with --range, expected one image",
        ),
        (("hall.jpg", "--elevation", "10"), 2, "received --elevation without --fov"),
        (("hall.jpg", "-o", "desk.png"), 2, "desk.png is a file, expected a folder"),
        (("hall.jpg", "other/hall.png"), 2, "2 images would be drawn to the same file hall.objects.png"),
        (("hall.jpg", "--fov", "180"), 2, "received --fov '180', expected a number from 5.0 to 170.0"),
        (("hall.jpg", "--range", "hall.jpg"), 1, "hall.jpg has 3 channels of 8 bits, expected 1 channel of 16 bits"),
        (("hall.jpg", "--range", "desk.depth.png"), 1, "the range image is 640 x 480"),
        (("hall.jpg", "--detector", "range-balls"), 1, "'range-balls' needs range images (--range FILE), which"),
        (("hall.jpg", "--set", "detector.fail=true"), 1, "no ball today"),
    ],
)
def test_what_is_wrong_is_one_line(pictures, arguments, code, message):
    done = run("show-objects", *DETECTOR, *arguments)
    assert (done.code, done.out, done.err.count("\n")) == (code, "", 1)
    assert done.err.startswith("error: ")
    assert message in done.err
    assert not list(pictures.rglob("*.objects.png"))


def test_depth_of_a_photograph_is_read_as_declared(pictures):
    """A wall 3 m in front of the camera, as range in half millimetres with a window without reading."""
    rgb = np.full((120, 160, 3), 90, np.uint8)
    images.write_color(pictures / "wall.jpg", rgb)
    y, x = np.mgrid[:120, :160] + 0.5
    focal_px = 80 / np.tan(np.radians(35))
    ray = np.sqrt(1 + ((x - 80) / focal_px) ** 2 + ((y - 60) / focal_px) ** 2)
    steps = np.round(3 * ray / 0.0005).astype(np.int32)
    steps[20:60, 30:70] = 9999
    images.write_ids(pictures / "wall.png", steps)
    shown = "show-objects", "wall.jpg", "--fov", "70", "--range", "wall.png", "--range-unit", "0.0005"
    assert "9999 fills" in run(*shown, "--range-kind", "ray", *DETECTOR).err
    declared = run(*shown, "--range-kind", "ray", "--range-missing", "9999", *DETECTOR)
    assert "fills" not in declared.err
    error = run(*shown, "--range-kind", "cube", *DETECTOR).err
    assert "range_kind is 'cube' for a photograph, expected 'z' (depth along the optical axis) or 'ray'" in error


def test_a_photograph_of_a_calibrated_camera(pictures):
    calibration = {"width": 640, "height": 480, "fx": 300, "fy": 300, "cx": 319.5, "cy": 239.5}
    content = {**calibration, "distortion_model": "plumb_bob", "distortion": [-0.05, 0, 0, 0, 0]}
    (pictures / "camera.json").write_text(json.dumps(content))
    shown = run("show-objects", "desk.png", "--camera", "camera.json", "--range", "desk.depth.png", *DETECTOR)
    assert (shown.code, shown.err) == (0, "")
    both = run("show-objects", "desk.png", "--camera", "camera.json", "--fov", "90", *DETECTOR)
    assert both.err == "error: received both --camera and --fov, expected only one of them\n"
    (pictures / "camera.json").write_text(json.dumps({**content, "width": 642}))
    larger = run("show-objects", "desk.png", "--camera", "camera.json", *DETECTOR)
    assert larger.code == 1
    assert "desk.png is 640 x 480, expected 642 x 480, the image size of the camera" in larger.err
