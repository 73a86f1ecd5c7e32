"""The program evo, in an environment of its own, reads the trajectories that salframe writes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from fresh_environment import make_environment, output, pip_install

from salframe.localization.trajectory import tum_lines
from salframe.panoramas.geometry import pose_2d


@pytest.mark.slow
def test_evo_measures_the_errors_between_two_trajectories(tmp_path):
    rng = np.random.default_rng(0)
    true = [(0.5 * i, pose_2d(i, np.sin(i), 0.3 * i, 1.5)) for i in range(12)]
    offsets_m = rng.normal(0, 0.1, (12, 3))
    turns_rad = rng.normal(0, 0.05, 12)
    moved = [(t_s, pose @ pose_2d(0, 0, turn)) for (t_s, pose), turn in zip(true, turns_rad, strict=True)]
    for (_, pose), offset_m in zip(moved, offsets_m, strict=True):
        pose[:3, 3] += offset_m
    (tmp_path / "true.tum").write_text(tum_lines(true), encoding="utf-8")
    (tmp_path / "estimated.tum").write_text(tum_lines(moved, ["a note"]), encoding="utf-8")
    python = make_environment(tmp_path / "environment")
    pip_install(python, "evo")

    def rmse(*options: str) -> float:
        evo_ape = python.parent / "evo_ape"
        printed = output(tmp_path, evo_ape, "tum", Path("true.tum"), Path("estimated.tum"), *options)
        return float(re.search(r"rmse\s+([\d.]+)", printed)[1])

    assert rmse() == pytest.approx(np.sqrt((offsets_m**2).sum(1).mean()), abs=1e-5)
    assert rmse("--pose_relation", "angle_deg") == pytest.approx(np.degrees(np.sqrt((turns_rad**2).mean())), abs=1e-3)
