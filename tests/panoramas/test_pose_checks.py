"""Drawn rooms whose poses follow another convention or contradict the ranges."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from salframe.framework.errors import DataError
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frame_agreement import RangeView, nearest_pairs, pair_agreements
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import equirectangular_rays, invert_pose, pose_2d, pose_yaw
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.pose_checks import pose_notes
from salframe.testing.rooms import ROOMS, FurnishedRoom, look

STANDS = ((0.5, 0.4, 0.3), (0.2, 0.5, 2.0))


def reference_frames(height_m: float = 1.5, stands=STANDS, tilt: np.ndarray | None = None) -> list[ReferenceFrame]:
    """Frames in every drawn room; `tilt` (3, 3) turns the camera, and its pose says so."""
    frames = []
    for room in ROOMS:
        for number, (x, y, yaw) in enumerate(stands):
            pose = pose_2d(room.corner_m[0] + x * room.size_m[0], room.corner_m[1] + y * room.size_m[1], yaw, height_m)
            if tilt is not None:
                pose[:3, :3] = pose[:3, :3] @ tilt
            name = f"{room.name}-{number}"
            frames.append(ReferenceFrame(name, room.name, pose, load=partial(look, room, name, pose)))
    return frames


def with_poses(frames, change):
    return [replace(frame, T_world_pano=change(frame.T_world_pano)) for frame in frames]


def with_ranges(frames, change):
    def load(frame: ReferenceFrame) -> Panorama:
        panorama = frame.load()
        return replace(panorama, range_m=change(panorama.range_m).astype(np.float32))

    return [replace(frame, load=partial(load, frame)) for frame in frames]


def scaled(factor):
    def change(pose):
        pose = pose.copy()
        pose[:3, 3] *= factor
        return pose

    return change


def level(x, y, yaw, pose):
    return pose_2d(x, y, yaw, pose[2, 3])


@pytest.mark.parametrize("height_m", [0.2, 0.5, 1.5, 2.4])
def test_correct_poses_are_silent_at_any_camera_height(height_m):
    assert pose_notes(reference_frames(height_m)) == []


def test_survey_coordinates_are_silent():
    world = pose_2d(448123.5, 5411876.25, 0.7, 312.4)
    assert pose_notes(with_poses(reference_frames(), lambda pose: world @ pose)) == []


def test_one_frame_a_place_is_silent():
    assert pose_notes(reference_frames(stands=STANDS[:1])) == []


@pytest.mark.parametrize("axis", [(1.0, 0, 0), (0, 1.0, 0), (0.6, -0.8, 0)])
def test_cameras_tilted_by_5_deg_are_silent(axis):
    tilt = Rotation.from_rotvec(np.radians(5) * np.array(axis)).as_matrix()
    assert pose_notes(reference_frames(tilt=tilt)) == []
    flat = [
        replace(tilted, T_world_pano=upright.T_world_pano)
        for tilted, upright in zip(reference_frames(tilt=tilt), reference_frames(), strict=True)
    ]
    assert pose_notes(flat) == []


def test_frames_without_range_are_silent():
    frames = [replace(frame, load=partial(Panorama, frame.id)) for frame in reference_frames()]
    assert pose_notes(with_poses(frames, invert_pose)) == []


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (invert_pose, '"ros-world-to-camera"'),
        (lambda pose: level(*pose[:2, 3], np.pi / 2 - pose_yaw(pose), pose), '"compass"'),
        (lambda pose: level(pose[0, 3], -pose[1, 3], -pose_yaw(pose), pose), '"image-plan"'),
        (lambda pose: pose @ pose_2d(0, 0, -np.pi / 2), "90 deg to the left"),
    ],
    ids=["inverse", "compass", "image plan", "offset"],
)
def test_level_poses_of_another_convention_are_named(change, named):
    (note,) = pose_notes(with_poses(reference_frames(), change))
    assert "contradict" in note
    assert named in note


@pytest.mark.parametrize("factor", [0.001, 0.3, 0.5, 0.8, 1.25, 3.2808, 1000.0])
def test_positions_in_another_unit_are_named(factor):
    (note,) = pose_notes(with_poses(reference_frames(), scaled(factor)))
    unit = float(note.partition('"pose_unit_m" (default 1) by ')[2].partition(",")[0])
    assert unit == pytest.approx(1 / factor, rel=0.06)


def test_ranges_in_another_unit_are_named():
    (note,) = pose_notes(with_ranges(reference_frames(), lambda range_m: range_m * 0.512))
    factor = float(note.partition('"range_unit_m" (default 0.001) by ')[2].partition(" ")[0])
    assert factor == pytest.approx(1000 / 512, rel=0.06)


OPENCV = np.array([[0, 0, 1.0], [-1.0, 0, 0], [0, -1.0, 0]])


def test_poses_of_a_camera_with_z_forward_are_refused_with_the_convention():
    def to_opencv(pose):
        pose = pose.copy()
        pose[:3, :3] = pose[:3, :3] @ OPENCV
        return pose

    with pytest.raises(DataError, match=r'not upright.*"pose_convention": "opencv" in manifest'):
        pose_notes(with_poses(reference_frames(), to_opencv))


def test_poses_with_y_up_are_refused_with_the_convention():
    to_y_up = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    to_opengl = np.array([[0, 0, -1.0, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    with pytest.raises(DataError, match='"pose_convention": "opengl" in manifest'):
        pose_notes(with_poses(reference_frames(), lambda pose: to_y_up @ pose @ to_opengl))


def test_cameras_that_hang_upside_down_are_levelled_by_their_poses():
    frames = reference_frames(height_m=1.7, tilt=np.diag([1.0, -1.0, -1.0]))
    (note,) = pose_notes(frames)
    assert note.startswith(
        f"{len(frames)} of {len(frames)} reference frames (panoramas of the map) hang upside down acc"
    )


def test_poses_in_a_world_with_z_down_are_refused():
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    with pytest.raises(DataError, match="upside down"):
        pose_notes(with_poses(reference_frames(), lambda pose: down @ pose))


def test_a_few_tilted_frames_are_counted():
    frames = reference_frames()
    tilt = Rotation.from_euler("x", 20, degrees=True).as_matrix()
    one = frames[1].T_world_pano.copy()
    one[:3, :3] = one[:3, :3] @ tilt
    notes = pose_notes([frames[0], replace(frames[1], T_world_pano=one), *frames[2:]])
    assert notes[0].startswith(f"1 of {len(frames)} reference frames (panoramas of the map) are tilted")
    assert "20 deg" in notes[0]


def test_one_wrong_pair_is_named():
    frames = reference_frames()
    frames[1] = replace(frames[1], T_world_pano=frames[1].T_world_pano @ pose_2d(0, 0, np.pi / 2))
    (note,) = pose_notes(frames)
    assert frames[0].id in note
    assert frames[1].id in note


def test_cube_depth_is_named():
    frames = with_ranges(
        reference_frames(), lambda range_m: range_m * np.abs(equirectangular_rays(len(range_m))).max(-1)
    )
    (note,) = pose_notes(frames)
    assert '"range_kind": "cube"' in note


def test_the_height_of_floor_masks_is_compared():
    mask = np.ones((4, 4), bool)

    def floor(z_m: float) -> FloorMasks:
        return FloorMasks(mask, mask.astype(np.int32), ~mask, 0.5, (0.0, 2.0), {1: "a"}, z_m)

    frames = reference_frames(stands=STANDS[:1])
    assert pose_notes(frames, [floor(0.0)]) == pose_notes(frames, [floor(0.0), floor(3.0)]) == []
    (note,) = pose_notes(frames, [floor(1.0)])
    assert "floor at z = 0.00 m" in note
    assert "1.00 m" in note


def test_negative_heights_tell_an_inverse_where_nothing_else_does():
    single = reference_frames(stands=STANDS[:1])
    (note,) = pose_notes(with_poses(single, invert_pose))
    assert '"ros-world-to-camera"' in note


def test_points_of_a_box_agree_and_a_shift_is_seen_through():
    """An empty room 6 x 4 m: shifted by 1 m along x, the near wall lies 1 m inside what the other frame sees."""
    room = FurnishedRoom("box", (6.0, 4.0, 3.0), ())
    true = [pose_2d(2.0, 2.0, 0.0, 1.5), pose_2d(4.0, 2.0, 1.0, 1.5)]
    views = [RangeView(look(room, "a", pose).range_m) for pose in true]
    (right,) = pair_agreements(views, true, [(0, 1)])
    assert right.on_surface > 0.95
    assert right.in_free_space == 0
    (wrong,) = pair_agreements(views, [true[0], pose_2d(3.0, 2.0, 1.0, 1.5)], [(0, 1)])
    # One end wall is seen through, the other is hidden; the side walls agree. From the middle of the room the ends
    # (4 m wide at 2 and 4 m) cover 2 atan(2/2) and 2 atan(2/4) of 2 pi: about 1/4 and 0.15 of the points.
    assert 0.1 < wrong.in_free_space < 0.3


def test_frames_are_paired_within_their_place_first():
    positions = np.array([[0.0, 0, 0], [10.0, 0, 0], [1.0, 0, 0], [30.0, 0, 0]])
    assert nearest_pairs(["a", "a", "b", "c"], positions) == [(0, 1), (0, 2), (1, 3)]
    assert nearest_pairs(["a"], positions[:1]) == []
