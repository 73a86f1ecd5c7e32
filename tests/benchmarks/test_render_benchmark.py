"""Time of a panorama: the goal is 1.2 s in colour at 1024 x 512 on two cores."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from salframe_house.render import Renderer

from salframe.geometry import pose_2d

sys.path.append(str(Path(__file__).parents[1] / "house"))
from room import furnished_room

POSE = pose_2d(1.8, 3.3, 0.3, 1.5)


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer(furnished_room(), "day")


def test_render(benchmark, renderer: Renderer) -> None:
    benchmark.pedantic(renderer.render, (POSE,), rounds=5, warmup_rounds=1)


def test_geometry(benchmark, renderer: Renderer) -> None:
    benchmark.pedantic(renderer.geometry, (POSE,), rounds=10, warmup_rounds=1)
