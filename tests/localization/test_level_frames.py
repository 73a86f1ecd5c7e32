"""Maps and queries of tilted cameras are levelled, and answers have the pose of the camera as it stood."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.localization.map import LocalizationMap
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.geometry import pose_errors
from salframe.panoramas.view import View
from salframe.testing.rooms import ROOMS, look, stand


def tilted(pose, tilt_deg, axis_rad):
    axis = np.array([np.cos(axis_rad), np.sin(axis_rad), 0])
    pose = pose.copy()
    pose[:3, :3] = Rotation.from_rotvec(np.radians(tilt_deg) * axis).as_matrix() @ pose[:3, :3]
    return pose


def reference_frames(tilt_deg=0.0):
    frames = []
    for number, room in enumerate(ROOMS):
        for spot, shares in enumerate(((0.5, 0.5), (0.6, 0.4))):
            pose = tilted(stand(room, *shares, yaw_rad=0.3 + number), tilt_deg, 2.0 * number + spot)
            name = f"{room.name}-{spot}"
            frames.append(ReferenceFrame(name, room.name, pose, load=lambda r=room, n=name, p=pose: look(r, n, p)))
    return frames


def build(frames=None, **config):
    content = settings("localizer", "proposed")
    plain = {"detector": "annotations"}
    localizer = registry().build("localizer", configure("localizer", "proposed", content, [plain, config]))
    return LocalizationMap.build(localizer, frames or reference_frames())


def ask(built, pose, room):
    warnings = []
    return built.localize(look(room, "q", pose), warn=warnings.append), warnings


@pytest.mark.parametrize("room", ROOMS, ids=[room.name for room in ROOMS])
@pytest.mark.parametrize(("tilt_deg", "axis_rad"), [(8, 0.4), (20, -2.0)])
def test_a_tilted_query_is_answered_with_its_tilted_pose(room, tilt_deg, axis_rad):
    pose = tilted(stand(room, 0.45, 0.55, yaw_rad=-2.0), tilt_deg, axis_rad)
    answer, _ = ask(build(), pose, room)
    assert answer.places[0].place == room.name
    error_m, error_rad = pose_errors(answer.T_world_query, pose)
    assert error_m < 0.35
    assert np.degrees(error_rad) < 5
    measured_deg = float(answer.notes[-1].partition("from a tilt of ")[2].partition(" deg")[0])
    assert measured_deg == pytest.approx(tilt_deg, abs=0.5)


def test_level_queries_get_the_same_answer_with_and_without_levelling():
    room = ROOMS[1]
    pose = stand(room, 0.45, 0.6, yaw_rad=1.0)
    first, second = (ask(build(level=level), pose, room)[0] for level in ("auto", "off"))
    np.testing.assert_array_equal(first.T_world_query, second.T_world_query)
    assert first.notes == second.notes == ()


def test_tilted_reference_frames_are_levelled_by_their_poses():
    level, leaning = build(), build(reference_frames(tilt_deg=15))
    for frame in leaning.frames:
        np.testing.assert_allclose(frame.T_world_pano[2, :3], [0, 0, 1], atol=1e-9)
    for number, room in enumerate(ROOMS):
        pose = stand(room, 0.45, 0.55, yaw_rad=number)
        answers = [ask(built, pose, room)[0] for built in (level, leaning)]
        assert [answer.places[0].place for answer in answers] == [room.name] * 2
        error_m, error_rad = pose_errors(answers[1].T_world_query, pose)
        assert error_m < 0.35
        assert np.degrees(error_rad) < 5


def test_reference_frames_with_poses_in_the_plane_are_levelled_by_estimation():
    flat = []
    for frame in reference_frames(tilt_deg=10):
        upright = frame.T_world_pano.copy()
        rotation = Rotation.from_matrix(upright[:3, :3])
        up = rotation.inv().apply([0, 0, 1])
        levelling, _ = Rotation.align_vectors([[0, 0, 1]], [up])
        upright[:3, :3] = (rotation * levelling.inv()).as_matrix()
        upright[2, :2], upright[:2, 2], upright[2, 2] = 0, 0, 1
        flat.append(replace(frame, T_world_pano=upright))
    built = build(flat)
    pose = stand(ROOMS[2], 0.45, 0.55, yaw_rad=1.0)
    answer, _ = ask(built, pose, ROOMS[2])
    assert pose_errors(answer.T_world_query, pose)[0] < 0.35


@pytest.mark.parametrize("room", ROOMS, ids=[room.name for room in ROOMS])
def test_an_upside_down_query_is_answered_with_its_pose(room):
    pose = tilted(stand(room, 0.45, 0.55, yaw_rad=0.7), 180, 0.9)
    answer, warnings = ask(build(), pose, room)
    assert answer.places[0].place == room.name
    error_m, error_rad = pose_errors(answer.T_world_query, pose)
    assert error_m < 0.35
    assert np.degrees(error_rad) < 5
    assert warnings == []
    _, warnings = ask(build(level="off"), pose, room)
    assert any("upside down" in warning for warning in warnings)


@pytest.mark.parametrize("height_m", [1.0, 2.0])
def test_a_camera_at_another_height_is_placed_at_that_height(height_m):
    built = build()
    for room in ROOMS:
        pose = stand(room, 0.45, 0.55, yaw_rad=-1.0)
        pose[2, 3] = height_m
        answer, _ = ask(built, pose, room)
        assert answer.places[0].place == room.name
        assert answer.T_world_query[2, 3] == pytest.approx(height_m, rel=0.04)  # the estimated scale of the ranges
        assert pose_errors(answer.T_world_query, pose)[0] < 0.35


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_ranges_with_a_wrong_scale_do_not_move_the_camera_up_or_down(factor):
    built = build()
    for room in ROOMS:
        pose = stand(room, 0.45, 0.55, yaw_rad=-1.0)
        seen = look(room, "q", pose)
        answer = built.localize(replace(seen, range_m=seen.range_m * np.float32(factor)), warn=lambda note: None)
        assert answer.places[0].place == room.name
        assert answer.T_world_query[2, 3] == pytest.approx(pose[2, 3], abs=0.1)  # 0.22 m by the floor alone


def test_views_of_a_tilted_camera_are_joined():
    room, built = ROOMS[2], build()
    poses = [tilted(stand(room, 0.4, 0.5, yaw_rad=1.0), 9, 0.2), tilted(stand(room, 0.5, 0.5, yaw_rad=1.5), 6, 1.9)]
    motion = np.linalg.inv(poses[1]) @ poses[0]
    views = [View(look(room, "a", poses[0]), motion), View(look(room, "b", poses[1]))]
    answer = built.localize(views=views, warn=lambda note: None)
    assert answer.places[0].place == room.name
    error_m, error_rad = pose_errors(answer.T_world_query, poses[1])
    assert error_m < 0.35
    assert np.degrees(error_rad) < 5


def test_motions_in_the_plane_are_those_of_levelled_views():
    """A wheel odometry knows the heading and not the tilt of the camera."""
    room, built = ROOMS[2], build()
    level = [stand(room, 0.4, 0.5, yaw_rad=1.0), stand(room, 0.5, 0.5, yaw_rad=1.5)]
    poses = [tilted(level[0], 9, 0.2), tilted(level[1], 9, 1.9)]
    views = [View(look(room, "a", poses[0]), np.linalg.inv(level[1]) @ level[0]), View(look(room, "b", poses[1]))]
    answer = built.localize(views=views, warn=lambda note: None)
    error_m, error_rad = pose_errors(answer.T_world_query, poses[1])
    assert error_m < 0.35
    assert np.degrees(error_rad) < 5


def test_the_up_direction_of_an_imu_levels_a_hanging_camera():
    room, built = ROOMS[2], build()
    pose = tilted(stand(room, 0.45, 0.55, yaw_rad=0.7), 170, 0.9)
    panorama = look(room, "q", pose)
    measured = built.localize(replace(panorama, up=3 * pose[2, :3]), warn=lambda note: None)
    assert measured.places[0].place == room.name
    error_m, error_rad = pose_errors(measured.T_world_query, pose)
    assert error_m < 0.35
    assert np.degrees(error_rad) < 5
    assert "from a tilt of 170.0 deg" in measured.notes[-1]


def test_a_reference_frame_as_a_query_does_not_lend_its_pose():
    built, room = build(), ROOMS[0]
    pose = tilted(stand(room, 0.45, 0.55), 8, 0.4)
    wrong = np.eye(4)
    panorama = look(room, "q", pose)
    answers = [
        built.localize(query, warn=lambda note: None)
        for query in (ReferenceFrame("q", "x", wrong, load=lambda: panorama), QueryFrame("q", lambda: panorama))
    ]
    np.testing.assert_array_equal(*(answer.T_world_query for answer in answers))


def test_the_saved_map_answers_alike(tmp_path):
    built, room = build(reference_frames(tilt_deg=12)), ROOMS[1]
    built.save(tmp_path / "map")
    pose = tilted(stand(room, 0.45, 0.6, yaw_rad=1.0), 8, 1.0)
    pose[2, 3] = 1.1
    answers = [ask(each, pose, room)[0] for each in (built, LocalizationMap.open(tmp_path / "map"))]
    np.testing.assert_allclose(answers[0].T_world_query, answers[1].T_world_query, atol=2e-3)
