"""localize --views: several views as one query."""

from __future__ import annotations

import pytest
from command_line import run
from tiny_folder import write_tiny_folder

MOTION = "t_s,x_m,y_m,z_m,yaw_deg\n0,0,0,0,0\n1,0,0,0,0\n"


@pytest.fixture
def tiny(tmp_path, monkeypatch):
    """A dataset folder with annotations and the map `map` of it; returns the id of a query."""
    monkeypatch.chdir(tmp_path)
    write_tiny_folder(tmp_path / "tiny")
    assert run("build", "tiny", "-o", "map").code == 0
    return "bedroom-query"


def test_views_with_motion_are_joined(tiny, tmp_path):
    (tmp_path / "motion.csv").write_text(MOTION)
    single = run("localize", "map", tiny, "--data", "tiny", "--json").json
    two = run("localize", "map", "--views", tiny, tiny, "--data", "tiny", "--motion", "motion.csv", "--json").json
    assert two["status"] == "ok"
    assert two["places"][0]["place"] == single["places"][0]["place"]
    assert two["pose"] == pytest.approx(single["pose"], abs=0.05)
    assert not [note for note in two["notes"] if "one by one" in note]


def test_views_without_motion_are_fused(tiny):
    printed = run("localize", "map", "--views", tiny, tiny, "--data", "tiny").out
    assert "note: 2 views were localized one by one, and the answers were fused, because the motion between" in printed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("a", "b"), "received 2 values for FRAME without --views"),
        (("a", "--motion", "motion.csv"), "received --motion without --views"),
        (("--views",), "received --views without a view"),
        (("--views", "--rgb", "a.jpg"), "received --views with --rgb"),
    ],
)
def test_views_are_refused_with_other_options(words, message):
    error = run("localize", "map", *words)
    assert error.code != 0
    assert message in error.err
    assert len(error.err.strip().splitlines()) == 1
