"""Training of `loftr-compact`: true correspondences against closed forms, and runs that can be stopped and repeated."""

from __future__ import annotations

import json

import numpy as np
import pytest
from salframe_keypoints.loftr_compact import STRIDE_PX

from salframe.framework.errors import ConfigError
from salframe.panoramas.geometry import equirectangular_rays, pose_2d
from training.loftr_compact import view_pairs
from training.loftr_compact.panoramas import GrayPanorama
from training.loftr_compact.settings import LoftrTrainingSettings, Stage
from training.loftr_compact.view_pairs import PosedView, correspondences

SIZE_PX = 160, 120
COLUMNS = SIZE_PX[0] // STRIDE_PX
BLOCKED_RAD = 0.2
ROOM_M = np.array([[-3.0, -2.5, -1.5], [3.5, 2.0, 1.3]])  # that of conftest.py


@pytest.fixture(scope="module")
def shots(rooms):
    """Shots of one room 0.5 m apart."""
    poses = np.eye(4), pose_2d(0.4, 0.3, 0.2)
    panoramas = [rooms[0].panorama("a", pose) for pose in poses]
    return [
        GrayPanorama(p.rgb[..., 1].copy(), p.range_m.astype(np.float16), pose)
        for p, pose in zip(panoramas, poses, strict=True)
    ]


def true_points(cells, offset_px):
    """Indices of the matched cells of the first view and where the second sees them."""
    (matched,) = np.nonzero(cells >= 0)
    corner = np.column_stack([cells[matched] % COLUMNS, cells[matched] // COLUMNS]) * STRIDE_PX
    return matched, corner + offset_px[matched]


def test_two_views_of_a_panorama_are_related_by_a_homography(shots):
    rng = np.random.default_rng(5)
    first, second = view_pairs._draw_homography(shots[:1], SIZE_PX, rng)
    matched, points = true_points(*correspondences(first, second))
    assert len(matched) > 30
    mapped = np.column_stack([first.grid()[matched], np.ones(len(matched))])
    mapped = mapped @ (second.camera @ second.rotation.T @ first.rotation @ np.linalg.inv(first.camera)).T
    np.testing.assert_allclose(points, mapped[:, :2] / mapped[:, 2:], atol=1e-3)
    assert np.abs(points - np.round(points / STRIDE_PX) * STRIDE_PX).max() <= STRIDE_PX / 2 + 1e-3


def test_views_from_two_places_see_the_same_point_of_the_room(shots):
    camera = view_pairs._camera(SIZE_PX, 120.0)
    first, second = (
        PosedView(shot, camera, view_pairs._rotation(turn, 0.02, 0.01), SIZE_PX)
        for shot, turn in zip(shots, (0.1, -0.15), strict=True)
    )
    matched, points = true_points(*correspondences(first, second))
    assert len(matched) > 100

    def hit(view, pixels):
        origin, rays = view.panorama.T_world_pano[:3, 3], view.bearings(pixels) @ view.panorama.T_world_pano[:3, :3].T
        return origin + rays * ((np.where(rays > 0, ROOM_M[1], ROOM_M[0]) - origin) / rays).min(1, keepdims=True)

    np.testing.assert_allclose(hit(first, first.grid()[matched]), hit(second, points), atol=0.02)


def test_what_stands_in_the_way_in_the_second_view_has_no_match(shots):
    blocked = shots[1].range_m.copy()
    rays = equirectangular_rays(len(blocked))
    azimuth = np.arctan2(rays[..., 1], rays[..., 0])
    blocked[np.abs(azimuth) < BLOCKED_RAD] = 0.7
    camera, ahead = view_pairs._camera(SIZE_PX, 120.0), view_pairs._rotation(0.0, 0.0, 0.0)
    first = PosedView(shots[0], camera, view_pairs._rotation(0.2, 0.0, 0.0), SIZE_PX)
    free = PosedView(shots[1], camera, ahead, SIZE_PX)
    behind = PosedView(GrayPanorama(shots[1].gray, blocked, shots[1].T_world_pano), camera, ahead, SIZE_PX)
    matched, points = true_points(*correspondences(first, free))
    left, _ = true_points(*correspondences(first, behind))
    bearing = free.bearings(points)
    hidden = np.abs(np.arctan2(bearing[:, 1], bearing[:, 0])) < BLOCKED_RAD - 0.01
    assert hidden.sum() > 10
    assert not np.isin(matched[hidden], left).any()


torch = pytest.importorskip("torch")
pytest.importorskip("kornia")


@pytest.fixture
def train(shots, monkeypatch):
    """Training on views of two shots, a few pixels large, with rows of its log instead of a report."""
    from training.loftr_compact import train as module

    monkeypatch.setattr(module, "read_rooms", lambda config, seeds: [tuple(shots)])
    monkeypatch.setattr(module, "HELD_OUT_PAIRS", 1)
    monkeypatch.setattr(module, "HELD_OUT_SIZE_PX", (96, 72))
    return module.train


def tiny(**changes) -> LoftrTrainingSettings:
    stage = Stage(width_px=96, height_px=72, batch=2, steps=4, buildings=1)
    return LoftrTrainingSettings(
        **{"stages": (stage,), "warmup_steps": 1, "decay_steps": 2, "report_every": 2, "processes": 1, **changes}
    )


@pytest.mark.slow
def test_a_run_that_was_stopped_ends_like_one_that_was_not(train, tmp_path):
    whole = train(tiny(), tmp_path / "whole", lambda row: None)

    def stop(row):
        if row["step"] == 2:
            raise RuntimeError

    with pytest.raises(torch.multiprocessing.ProcessRaisedException):
        train(tiny(), tmp_path / "stopped", stop)
    resumed = train(tiny(), tmp_path / "stopped", lambda row: None)
    for name, value in whole.state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name
    for folder in ("whole", "stopped"):
        assert [json.loads(line)["step"] for line in (tmp_path / folder / "log.jsonl").read_text().splitlines()] == [
            2,
            4,
        ]


def test_a_folder_holds_one_run(train, tmp_path):
    (tmp_path / "settings.json").write_text(tiny(seed=1).model_dump_json())
    with pytest.raises(ConfigError, match="contains a training run with other settings"):
        train(tiny(), tmp_path, lambda row: None)


def test_the_learning_rate_rises_stays_and_falls():
    from training.loftr_compact.train import learning_rate

    config = LoftrTrainingSettings(warmup_steps=10, decay_steps=20)
    rates = [learning_rate(step, 100, config) / config.peak_learning_rate for step in (0, 9, 50, 80, 90, 100)]
    np.testing.assert_allclose(rates, [0.1, 1, 1, 1, 0.51, 0.02], atol=1e-12)
