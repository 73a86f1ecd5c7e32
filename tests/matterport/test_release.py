"""Stitching the official layout: a drawn room whose range and colour are known in every direction, and the real
viewpoint where it is at hand."""

import json
import os
import pickle

import cv2
import numpy as np
import pytest
from conformance import conforms
from salframe_matterport.bearings import direction
from salframe_matterport.matterport3d import Matterport3D
from salframe_matterport.readers import connectivity_path, read_connectivity, read_regions, regions_path
from salframe_matterport.release import read_viewpoints
from salframe_matterport.scenes import read_scenes

from salframe.framework.errors import DataError
from salframe.panoramas.geometry import column_azimuth, equirectangular_rays, pose_yaw, rays_to_pixels, row_elevation

from .official_layout import RISE_M, Room, camera_lines, rig, write_building, write_viewpoint

CENTRE, HEADING_DEG = (0.3, 0.4, 1.5), 36.6
NAMES = [digit * 32 for digit in "abc"]

# Label, category, centre, two axes, half extents; on the wall at x = 2.5, whose points lie in the boxes.
OBJECTS = (
    ("Wall#clock", "objects", (2.5, 1.0, 1.6), (0, 0.6, 0.8), (0, 0.8, -0.6), (0.35, 0.2, 0.05)),
    ("cabinet", "cabinet", (2.5, 1.0, 1.3), (1, 0, 0), (0, 1, 0), (0.2, 0.8, 0.6)),
    ("wall", "wall", (2.5, 0.0, 1.3), (1, 0, 0), (0, 1, 0), (0.1, 9, 9)),
    ("unknown", "misc", (-2.0, 0.0, 1.3), (1, 0, 0), (0, 1, 0), (0.1, 1, 1)),
)


@pytest.fixture(scope="module")
def release(tmp_path_factory):
    """A building of three viewpoints with the same images: two in region 0, one in region 1."""
    root = tmp_path_factory.mktemp("release")
    folder = root / "v1" / "scans" / "drawn"
    poses = rig(CENTRE, HEADING_DEG)
    write_viewpoint(folder, NAMES[0], Room(), poses, CENTRE)
    for path in list(folder.glob(f"*/{NAMES[0]}*")):
        for name in NAMES[1:]:
            os.link(path, path.with_name(path.name.replace(NAMES[0], name)))
    lines = [line for name in NAMES for line in camera_lines(name, poses)]
    regions = {0: ((-2, -1.5, 0), (2.5, 3, 2.6)), 1: ((9, 9, 0), (10, 10, 2))}
    write_building(folder, lines, regions, {name: (int(name == NAMES[2]), CENTRE) for name in NAMES}, OBJECTS)
    return root


def of(root, **settings):
    return Matterport3D(Matterport3D.Config(root=root, height=128, **settings))


@pytest.fixture(scope="module")
def prepared(release, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SALFRAME_CACHE", str(tmp_path_factory.mktemp("cache")))
        dataset = of(release)
        dataset.prepare(lambda done, total: None)
        yield dataset


@pytest.mark.parametrize("color", ["pictures", "skybox"])
def test_every_direction_shows_the_room_as_it_is_seen_from_amid_the_cameras(release, color):
    viewpoint = read_viewpoints(release / "v1" / "scans" / "drawn")[NAMES[0]]
    pose = viewpoint.T_world_pano
    assert pose[:3, 3] == pytest.approx(CENTRE, abs=1e-6)
    assert pose_yaw(pose) == pytest.approx(np.pi / 2 - np.radians(HEADING_DEG), abs=1e-6)
    panorama = viewpoint.stitch(256, color)
    ways = equirectangular_rays(256) @ pose[:3, :3].T
    range_m = Room().range_m(CENTRE, ways)
    level = np.abs(row_elevation(256)) < np.radians(60)
    assert np.isfinite(panorama.range_m[level]).all()
    error_m = np.abs(panorama.range_m - range_m)[level]
    assert np.median(error_m) < 0.002
    assert (
        np.quantile(error_m, 0.999) < 0.02
    )  # a pixel of a depth image is 1 mm wide at 1 m; walls are seen at an angle
    rgb = Room().color(CENTRE + ways * range_m[..., None])
    assert np.abs(panorama.rgb[level].astype(int) - rgb[level]).mean() < 2
    assert panorama.valid[level].all()
    assert panorama.valid.all() == (color == "skybox")


def test_folds_leave_one_viewpoint_out_and_queries_carry_nothing(prepared):
    folds = prepared.folds()
    assert [fold.id for fold in folds] == [f"drawn/{name}" for name in NAMES[:2]]
    assert [[frame.id for frame in fold.references] for fold in folds] == [
        [f"drawn/{NAMES[1 - i]}", f"drawn/{NAMES[2]}"] for i in (0, 1)
    ]
    assert {frame.place for frame in folds[0].references} == {"drawn/region-0", "drawn/region-1"}
    (query,) = folds[0].queries
    packed = pickle.dumps(query)
    assert b"region" not in packed
    assert prepared.truth(query.id).T_world_pano[:3, 3].tobytes() not in packed
    with pytest.raises(DataError, match="no query 'drawn'"):
        prepared.truth("drawn")


def test_the_truth_of_a_query_says_how_far_its_panorama_is_turned(prepared):
    query = prepared.folds()[0].queries[0]
    pose, panorama = prepared.truth(query.id).T_world_pano, query.load()
    seen = ~np.isnan(panorama.range_m)
    range_m = Room().range_m(CENTRE, equirectangular_rays(128) @ pose[:3, :3].T)
    assert np.median(np.abs(panorama.range_m - range_m)[seen]) < 0.003
    assert abs(pose_yaw(pose) - (np.pi / 2 - np.radians(HEADING_DEG))) > 0.01


def test_the_dataset_keeps_its_role(prepared):
    assert conforms(Matterport3D, prepared.config)


def test_pixels_show_the_object_whose_box_their_point_lies_in(prepared):
    """The clock hangs on the cabinet, turned: of two boxes the smaller counts. Walls and what nobody could name are no
    objects."""
    frame = prepared.folds()[0].queries[0]
    panorama, truth = frame.load(), prepared.truth(frame.id)
    assert panorama.annotations.labels == {1: "wall clock", 2: "cabinet"}
    assert not panorama.annotations.rendered
    assert truth.instances == (1, 2)
    ways = equirectangular_rays(128) @ truth.T_world_pano[:3, :3].T
    x, y, z = np.moveaxis(CENTRE + ways * Room().range_m(CENTRE, ways)[..., None], -1, 0)
    on_wall = np.abs(x - 2.5) < 1e-3
    along, across = 0.6 * (y - 1) + 0.8 * (z - 1.6), 0.8 * (y - 1) - 0.6 * (z - 1.6)
    expected = np.where(on_wall & (np.abs(y - 1) <= 0.83) & (np.abs(z - 1.3) <= 0.63), 2, 0)
    expected[on_wall & (np.abs(along) <= 0.38) & (np.abs(across) <= 0.23)] = 1
    assert (expected == 1).sum() > 50
    assert np.mean(panorama.annotations.instance_id == expected) > 0.998


def test_stitching_resumes_and_the_fingerprint_follows_the_files(prepared, release):
    stored = sorted(prepared._folder / prepared._cached_files(f"drawn/{name}")["rgb"] for name in NAMES)
    stored[1].unlink()
    before = [path.stat().st_mtime_ns for path in (stored[0], stored[2])]
    seen = []
    of(release).prepare(lambda done, total: seen.append((done, total)))
    assert stored[1].exists()
    assert [path.stat().st_mtime_ns for path in (stored[0], stored[2])] == before
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]
    assert of(release).fingerprint == prepared.fingerprint != of(release, seed=1).fingerprint


def test_bad_images_cost_their_own_viewpoint_only(release, tmp_path, monkeypatch):
    monkeypatch.setenv("SALFRAME_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "scans" / "drawn"
    for path in release.glob("v1/scans/drawn/*/*"):
        copy = folder / path.parent.name / path.name
        copy.parent.mkdir(parents=True, exist_ok=True)
        os.link(path, copy)
    (folder / "undistorted_depth_images" / f"{NAMES[0]}_d1_3.png").unlink()
    cut = folder / "undistorted_depth_images" / f"{NAMES[1]}_d0_0.png"
    whole = cut.read_bytes()
    cut.unlink()
    cut.write_bytes(whole[: len(whole) // 2])
    dataset = of(tmp_path)
    dataset.prepare(lambda done, total: None)
    frames = {frame.id: frame for fold in dataset.folds() for frame in (*fold.references, *fold.queries)}
    with pytest.raises(
        DataError,
        match=rf"{NAMES[0]}_d1_3\.png is missing: unpack undistorted_depth_images\.zip .* Matterport3D release",
    ):
        frames[f"drawn/{NAMES[0]}"].load()
    with pytest.raises(DataError, match=rf"{NAMES[1]}_d0_0\.png is not a readable image"):
        frames[f"drawn/{NAMES[1]}/query"].load()
    assert frames[f"drawn/{NAMES[2]}"].load().provides == {"rgb", "range", "annotations"}
    cut.unlink()
    cv2.imwrite(str(cut), np.ones((512, 640), np.uint16))
    with pytest.raises(DataError, match=r"_d0_0\.png is 640 x 512, expected 1280 x 1024"):
        read_viewpoints(folder)[NAMES[1]].stitch(64, "skybox")


def test_bad_folders_are_one_clear_line(release, tmp_path):
    with pytest.raises(DataError, match="--data-dir DIR"):
        Matterport3D().folds()
    with pytest.raises(
        DataError,
        match=r"is a folder without camera files, expected a folder with "
        r"v1/scans/<scan>/undistorted_camera_parameters/",
    ):
        of(tmp_path).folds()
    with pytest.raises(DataError, match="has no building other, expected one or more of drawn"):
        of(release, scans=("other",)).folds()
    write_building(tmp_path / "scans" / "bare", ["scan a b 1 2 3"], {0: ((0, 0, 0), (1, 1, 1))}, {})
    with pytest.raises(DataError, match=r"bare\.conf is not a valid camera file"):
        of(tmp_path).folds()
    (tmp_path / "scans" / "bare" / "house_segmentations" / "bare.house").unlink()
    with pytest.raises(
        DataError, match=r"cannot read .*bare\.house: No such file or directory, expected .* \(house_segmentations of"
    ):
        of(tmp_path).folds()


SCAN, REAL = "yqstnuAEVhm", "6f4d197078d14d6e944ed6533598a6f9"


@pytest.fixture(scope="module")
def real(real_root, tmp_path_factory):
    """A function of the cameras' rise that gives the shared viewpoint in the official layout: its images linked, its
    camera file the nominal rig."""
    position = read_connectivity(connectivity_path(real_root, SCAN))[REAL][:3, 3]

    def laid_out(rise_m):
        folder = tmp_path_factory.mktemp("real") / SCAN
        poses = rig(position, HEADING_DEG, rise_m)
        write_building(folder, camera_lines(REAL, poses), {0: ((0, 0, 0), (1, 1, 1))}, {REAL: (0, position)})
        sources = {
            "undistorted_color_images": "example/*_i*",
            "undistorted_depth_images": "example/*_d*",
            "matterport_skybox_images": "skybox/*",
        }
        for part, pattern in sources.items():
            (folder / part).mkdir()
            for path in (real_root / "rgbd").glob(f"matterport3d_{pattern}"):
                (folder / part / path.name).symlink_to(path)
        return read_viewpoints(folder)[REAL]

    return laid_out


@pytest.fixture(scope="module")
def stitched(real):
    return real(RISE_M).stitch(512, "skybox")


YAW = np.pi / 2 - np.radians(HEADING_DEG)
LEVEL = np.abs(row_elevation(512)) < np.radians(60)


@pytest.fixture(scope="module")
def reference(real_root):
    """The reference stitch at the directions of our panorama: range (512, 1024) in metres and colour. Its cameras share
    one centre."""
    rows = np.floor((np.pi / 2 - row_elevation(512)) / np.pi * 1024).astype(int)
    columns = np.floor((np.pi / 2 - column_azimuth(1024) - YAW) % (2 * np.pi) / (2 * np.pi) * 2048).astype(int) % 2048
    units, bgr = (
        cv2.imread(str(real_root / "rgbd" / f"reference_{name}.png"), -1)[rows][:, columns] for name in ("range", "rgb")
    )
    return np.where(units > 0, units / 4000, np.nan), bgr[..., ::-1].astype(int)


def test_real_range_agrees_with_the_reference(real, reference):
    panorama = real((0.0, 0.0, 0.0)).stitch(512, "skybox")
    error_m = np.abs(panorama.range_m - reference[0])[LEVEL]
    assert np.isfinite(panorama.range_m[LEVEL]).mean() > 0.935
    assert np.nanmedian(error_m) < 0.005
    assert (error_m[~np.isnan(error_m)] < 0.05).mean() > 0.97


def test_real_colour_agrees_with_the_reference(stitched, reference):
    differences = {
        shift: np.abs(np.roll(stitched.rgb, shift, 1) - reference[1])[LEVEL].mean() for shift in range(-8, 9)
    }
    best = min(differences, key=differences.get)
    assert (
        abs(best) <= 2
    )  # the nominal heading of the rig is a third of a degree, a column, beside that of the connectivity file
    assert differences[best] < 6 < differences[8]


def test_the_real_floor_lies_the_stated_height_below_the_camera(stitched, real_root):
    height_m = next(
        v["height"] for v in json.loads(connectivity_path(real_root, SCAN).read_text()) if v["image_id"] == REAL
    )
    steep = row_elevation(512) < np.radians(-45)
    below_m = -stitched.range_m[steep] * np.sin(row_elevation(512)[steep])[:, None]
    assert np.nanmedian(below_m) == pytest.approx(height_m, abs=0.02)


def test_annotated_bearings_land_on_their_objects(stitched, real_root, tmp_path):
    """REVERIE's objects lie within 3 m. Where their bearings point, something stands off the floor that near; turned
    another way it does not."""
    scenes = read_scenes(real_root, SCAN, read_regions(regions_path(real_root))[SCAN], 0.0, 0)
    scene = next(scene for scene in scenes if scene.id == f"{SCAN}/{REAL}")
    picture = cv2.cvtColor(stitched.rgb, cv2.COLOR_RGB2BGR)
    height_m = -np.nanmedian((stitched.range_m * np.sin(row_elevation(512))[:, None])[LEVEL][-40:])

    def pixels(turn_deg):
        return rays_to_pixels(direction(scene.azimuth_rad - YAW + np.radians(turn_deg), scene.elevation_rad), 512)

    def ranges_m(turn_deg):
        """Median range within the middle of each object's angles."""
        found = []
        for column, row, width, height in zip(*pixels(turn_deg), scene.width_rad, scene.height_rad, strict=True):
            down, across = (max(1, round(angle / 4 * 512 / np.pi)) for angle in (height, width))
            rows, columns = (
                np.arange(int(row) - down, int(row) + down + 1),
                np.arange(int(column) - across, int(column) + across + 1),
            )
            inside = stitched.range_m[np.ix_(rows, columns % 1024)]
            found.append(np.median(inside[~np.isnan(inside)]) if (~np.isnan(inside)).any() else np.inf)
        return np.array(found)

    def standing(turn_deg):
        range_m = ranges_m(turn_deg)
        return (height_m + range_m * np.sin(scene.elevation_rad) > 0.25) & (range_m < 3)

    for label, column, row in zip(scene.labels, *pixels(0), strict=True):
        cv2.circle(picture, (int(column), int(row)), 4, (0, 0, 255), -1)
        cv2.putText(picture, label, (int(column) + 6, int(row)), 0, 0.5, (0, 255, 255), 1)
    cv2.imwrite(str(tmp_path / "bearings.png"), picture)
    assert len(scene.labels) == 7
    assert standing(0).all()
    assert not any(standing(turn_deg).all() for turn_deg in range(20, 350, 10))
    # The one object that another viewpoint sees too, so that its distance is known.
    number = [number for number in scene.object_id if sum(number in other.object_id for other in scenes) > 1]
    assert len(number) == 1
    known = list(scene.object_id).index(number[0])
    assert ranges_m(0)[known] == pytest.approx(scene.range_m[known], abs=0.1)
