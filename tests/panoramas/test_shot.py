"""Image files as panoramas: equirectangular, of a folder with a manifest, photographs."""

import json

import numpy as np
import pytest
from tiny_folder import write_tiny_folder

from salframe.framework.errors import DataError
from salframe.panoramas import images
from salframe.panoramas.geometry import equirectangular_rays
from salframe.panoramas.shot import open_panorama, open_photograph, read_panorama


def test_an_image_twice_as_wide_as_high_is_a_panorama(tmp_path):
    rgb = np.random.default_rng(0).integers(0, 255, (64, 128, 3), np.uint8)
    images.write_color(tmp_path / "a.png", rgb)
    images.write_range(tmp_path / "far.png", np.full((64, 128), 2.5))
    shot = open_panorama(tmp_path / "a.png", tmp_path / "far.png")
    assert shot.camera is None
    np.testing.assert_array_equal(shot.rgb, rgb)
    assert shot.panorama.rgb is shot.rgb
    assert (shot.panorama.range_m == 2.5).all()
    assert open_panorama(tmp_path / "a.png").panorama.provides == {"rgb"}


def test_an_image_that_a_manifest_names_comes_with_its_frame(tmp_path):
    folder = write_tiny_folder(tmp_path / "data")
    panorama = open_panorama(folder / "frames/kitchen-map.rgb.png").panorama
    assert (panorama.id, panorama.provides) == ("kitchen-map", {"rgb", "range", "annotations"})
    with pytest.raises(DataError, match=r"is the range image of kitchen-map, expected .*map\.rgb\.png"):
        open_panorama(folder / "frames/kitchen-map.range.png")
    images.write_color(folder / "frames/other.png", panorama.rgb)
    assert open_panorama(folder / "frames/other.png").panorama.provides == {"rgb"}
    given = open_panorama(folder / "frames/kitchen-map.rgb.png", folder / "frames/kitchen-map.range.png").panorama
    assert given.provides == {"rgb", "range"}
    (folder / "manifest.json").write_text(json.dumps({"format": "other"}))
    with pytest.raises(DataError, match=r"manifest\.json"):
        open_panorama(folder / "frames/kitchen-map.rgb.png")


def test_an_image_of_another_shape_needs_a_field_of_view(tmp_path):
    images.write_color(tmp_path / "a.jpg", np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(DataError, match=r"a\.jpg is 64 x 48, expected width = 2 x height.*--fov"):
        open_panorama(tmp_path / "a.jpg")


@pytest.mark.parametrize(("width", "height", "rows"), [(640, 480, 1024), (100, 80, 256), (6000, 4000, 1024)])
def test_a_photograph_is_laid_on_a_panorama_as_fine_as_itself(tmp_path, width, height, rows):
    """A wall 2 m ahead, its left half bright; 6000 pixels are far finer than the panorama and are averaged first."""
    rgb = np.zeros((height, width, 3), np.uint8)
    rgb[:, : width // 2] = 200
    images.write_color(tmp_path / "a.png", rgb)
    images.write_range(tmp_path / "depth.png", np.full((height, width), 2.0))
    shot = open_photograph(tmp_path / "a.png", tmp_path / "depth.png", fov_deg=70)
    assert shot.rgb.shape == (height, width, 3)
    assert (shot.camera.width, shot.camera.height) == (width, height)
    panorama, rays = shot.panorama, equirectangular_rays(rows)
    assert panorama.range_m.shape == (rows, 2 * rows)
    np.testing.assert_allclose(panorama.range_m[panorama.valid], (2 / rays[..., 0])[panorama.valid], rtol=0.02)
    left = panorama.valid & (rays[..., 1] > 0.02)
    assert (panorama.rgb[left] == 200).all()
    assert (panorama.rgb[panorama.valid & (rays[..., 1] < -0.02)] == 0).all()


def test_depth_of_another_size_is_refused(tmp_path):
    images.write_color(tmp_path / "a.png", np.zeros((48, 64, 3), np.uint8))
    images.write_range(tmp_path / "depth.png", np.ones((24, 32)))
    with pytest.raises(DataError, match=r"depth\.png is 32 x 24, expected 64 x 48"):
        open_photograph(tmp_path / "a.png", tmp_path / "depth.png", fov_deg=60)


def loose(tmp_path, steps):
    """The files of a panorama of one object, `steps` (H, 2H) its range image."""
    height = len(steps)
    images.write_color(tmp_path / "a.jpg", np.full((height, 2 * height, 3), 90, np.uint8))
    images.write_ids(tmp_path / "a.png", steps)
    images.write_ids(tmp_path / "b.png", np.full((height, 2 * height), 3))
    (tmp_path / "b.json").write_text('{"3": "bed"}')
    return [tmp_path / name for name in ("a.jpg", "a.png", "b.png", "b.json")]


def test_loose_images_are_a_panorama(tmp_path):
    steps = np.full((16, 32), 1500)
    steps[0, 0] = 0
    files = loose(tmp_path, steps)
    panorama = read_panorama(*files)
    assert panorama.id == "a.jpg"
    assert panorama.provides == {"rgb", "range", "annotations"}
    assert panorama.annotations.labels == {3: "bed"}
    assert np.isnan(panorama.range_m[0, 0])
    assert (panorama.range_m.ravel()[1:] == np.float32(1.5)).all()
    quarter = read_panorama(*files[:2], range_unit_m=0.00025)
    assert (quarter.range_m.ravel()[1:] == np.float32(0.375)).all()
    assert read_panorama(range_image=files[1]).provides == {"range"}


def test_depth_of_a_cubes_faces_becomes_range(tmp_path):
    """Walls, floor and ceiling 2 m away, each square to its face: the room is a cube, and points lie on it."""
    panorama = read_panorama(*loose(tmp_path, np.full((64, 128), 2000))[:2], range_kind="cube")
    points = equirectangular_rays(64) * panorama.range_m[..., None]
    np.testing.assert_allclose(np.abs(points).max(axis=2), 2, atol=1e-5)
    assert panorama.range_m.max() == pytest.approx(2 * 3**0.5, rel=0.03)  # the corners, to a pixel of 2.8 deg


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ((), "received no image"),
        (("a.jpg", None, "b.png"), "received an instance image without labels, expected both"),
        (("a.jpg", None, "b.png", "words.json"), r"words\.json has the instance id 'bed', expected a whole number"),
        (
            ("a.jpg", None, "b.png", "list.json"),
            r"list\.json has the type list, expected the label of each instance id",
        ),
        (("a.jpg", "a.jpg"), r"a\.jpg has 3 channels of 8 bits, expected 1 channel of 16 bits"),
    ],
)
def test_loose_images_that_are_none_are_told(tmp_path, given, said):
    loose(tmp_path, np.full((16, 32), 1500))
    (tmp_path / "words.json").write_text('{"bed": 3}')
    (tmp_path / "list.json").write_text('["bed"]')
    with pytest.raises(DataError, match=said):
        read_panorama(*(name and tmp_path / name for name in given))


def test_arrays_and_units_that_are_no_files_are_told():
    with pytest.raises(
        DataError, match=r"rgb has the type ndarray, expected the path of a file: for arrays, use salframe.Panor"
    ):
        read_panorama(np.zeros((16, 32, 3), np.uint8))
    with pytest.raises(DataError, match="range_unit_m is 0, expected the metres per unit of the range image"):
        read_panorama("a.jpg", "a.png", range_unit_m=0)
