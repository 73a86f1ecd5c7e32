"""`salframe navigate`, from the command line and from Python."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import run as salframe
from salframe.evaluation.navigation_metrics import COLUMNS

from salframe.evaluation.navigation import navigate
from salframe.framework.errors import ConfigError


def run(methods, *overrides, episodes=6, **given):
    navigation = navigate(methods, "apartment", episodes=episodes, overrides=overrides, engine="inline", **given)
    return {row["method"]: row for row in navigation.rows}, navigation


def rows(navigation, method="seer"):
    return [json.loads(line) for line in (navigation.run / method / "episodes.jsonl").read_text().splitlines()]


def test_a_good_localizer_arrives(tmp_path):
    table, navigation = run(["seer"])
    row = table["seer"]
    assert tuple(row) == COLUMNS
    assert (row["episodes"], row["success_rate"], row["status"]) == (6, 1.0, {"arrived": 6})
    assert row["spl"] > 0.9
    assert [walked["episode"] for walked in rows(navigation)] == list(range(6))
    assert json.loads((navigation.run / "seer" / "metrics.json").read_text()) == row
    assert navigation.measured
    assert not navigation.crashed


def test_the_same_command_gives_the_same_table_elsewhere_too():
    first, one = run(["seer"])
    again, other = run(["seer"], runs=Path("elsewhere"))
    assert first == again
    assert rows(one) == rows(other)


def test_a_run_resumes():
    table, navigation = run(["seer"])
    path = navigation.run / "seer" / "episodes.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:4]) + lines[4][:50])
    (navigation.run / "seer" / "outcome.json").unlink()
    assert run(["seer"])[0] == table
    assert path.read_bytes() == b"".join(lines)


def test_without_positioning_the_place_is_all_it_has():
    table, navigation = run(["seer"], positioning="both")
    assert list(table) == ["seer", "seer without positioning"]
    frames = {(1.0, 2.0), (3.0, 3.5), (7.0, 2.0), (4.1, 2.0)}
    for walked in rows(navigation, "seer without positioning"):
        assert tuple(walked["believed"][0][:2]) in frames
        assert walked["believed"][0][3] == walked["path"][0][3]  # the heading that it was told
    assert table["seer without positioning"]["p_value"] is not None
    assert list(run(["seer"], positioning="off")[0]) == ["seer without positioning"]
    assert run(["seer"], "posed=false")[0]["seer"]["success_rate"] == table["seer without positioning"]["success_rate"]


def test_an_episode_that_crashes_costs_only_itself():
    asked = [{"start": "a-west", "goal": "a-north"}, {"start": "b", "goal": "a-west"}]
    Path("two.json").write_text(json.dumps(asked))
    table, navigation = run(["seer"], "crash_east_of_m=5.0", episodes=Path("two.json"))
    assert table["seer"]["status"] == {"arrived": 1, "crashed": 1}
    assert table["seer"]["success_rate"] == 0.5
    assert rows(navigation)[1]["error"] == "ValueError: too far east"
    assert "too far east" in (navigation.run / "seer" / "crash.log").read_text()
    assert navigation.crashed


def test_a_method_that_cannot_run_keeps_its_row():
    table, _ = run(["weightless", "seer"])
    assert not table["weightless"]["available"]
    assert "salframe weights fetch weightless" in table["weightless"]["reason"]
    assert table["weightless"]["success_rate"] is None
    assert table["seer"]["success_rate"] == 1.0


def test_the_settings_are_part_of_the_run():
    _, one = run(["seer"])
    table, other = run(["seer"], "navigation.budget=1", "navigation.planner=dijkstra")
    assert one.run != other.run
    assert table["seer"]["panoramas"] == 1.0
    with pytest.raises(ConfigError, match=r"unknown key navigation\.bugdet"):
        run(["seer"], "navigation.bugdet=1")
    with pytest.raises(ConfigError, match="received 0 episodes, expected at least 1"):
        run(["seer"], episodes=0)


def test_the_command_prints_the_table_and_the_report():
    result = salframe("navigate", "--data", "apartment", "--methods", "seer", "--episodes", 3, "--engine", "inline")
    assert result.code == 0
    assert "100.0 (100-100)" in result.out
    report = Path(result.out.split("report: ")[1].strip())
    page = report.read_text()
    assert "where it\nbelieved to be" in page
    content = json.loads(page.split("const content = ")[1].split(";\n")[0])
    assert len(content["episodes"]["seer"]) == 3
    assert content["worlds"]["floor"]["picture"].startswith("data:image/png;base64,")
    printed = salframe(
        "navigate", "--data", "apartment", "--methods", "seer", "--episodes", 3, "--engine", "inline", "--json"
    ).json
    assert printed["rows"][0]["success_rate"] == 1.0


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ("--data", "still"),
            "error: still cannot render, and navigation needs panoramas from wherever the agent stands\n",
        ),
        (
            ("--data", "unmasked"),
            "error: unmasked has no floor masks, which navigation needs to know where walls are\n",
        ),
        (
            ("--data", "apartment", "--episodes", "none.json"),
            "error: cannot read none.json: No such file or directory\n",
        ),
        (("--data", "apartment", "--episodes", "-2"), "error: received -2 episodes, expected at least 1\n"),
    ],
)
def test_bad_input_is_one_line(arguments, line):
    result = salframe("navigate", "--methods", "seer", "--engine", "inline", *arguments)
    assert (result.code, result.err) == (2, line)


def test_bad_episodes_are_told_and_the_others_walked():
    asked = [{"start": [4.1, 0.5], "goal": "b"}, {"start": "a-west", "goal": "b"}, {"start": "a-west", "goal": "attic"}]
    Path("mixed.json").write_text(json.dumps(asked))
    result = salframe(
        "navigate", "--data", "apartment", "--methods", "seer", "--episodes", "mixed.json", "--engine", "inline"
    )
    assert result.code == 0
    assert "mixed.json, episode 0: floor: (4.10, 0.50) m is in a wall or obstacle" in result.out
    assert "mixed.json, episode 2: floor: unknown node 'attic'." in result.out
