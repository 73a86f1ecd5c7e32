"""`salframe navigate`, from the command line and from Python."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import run as salframe
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

from salframe.evaluation.runs.records import Record
from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import MethodStatus, Outcome
from salframe.evaluation.tasks.navigation.options import TRUE_PLACE, Positioning
from salframe.evaluation.tasks.navigation.rows import EpisodeRow
from salframe.evaluation.tasks.navigation.survey import NavigationSurvey
from salframe.evaluation.tasks.navigation.table import NavigationRow
from salframe.evaluation.tasks.navigation.task import NavigationTask, navigate
from salframe.framework.errors import ConfigError
from salframe.navigation.walk import NavigationConfig

pytestmark = pytest.mark.usefixtures("apartment")


def run(methods, *settings, episodes=6, positioning=Positioning.ON, **given):
    request = Request(tuple(methods), "apartment", settings=settings, engine="inline", **given)
    result = navigate(request, episodes=episodes, positioning=positioning)
    return {row.method: row for row in result.rows}, result


def rows(result, method="seer"):
    return [json.loads(line) for line in (result.run / "methods" / method / "rows.jsonl").read_text().splitlines()]


def test_a_good_localizer_arrives(tmp_path):
    table, result = run(["seer"])
    row = table["seer"]
    assert isinstance(row, NavigationRow)
    assert (row.episodes, row.success_rate.value, row.status) == (6, 1.0, {"arrived": 6})
    assert row.spl.value > 0.9
    assert [walked["episode"] for walked in rows(result)] == list(range(6))
    kept = (result.run / "methods" / "seer" / "metrics.json").read_text()
    assert json.loads(kept) == json.loads(json.dumps(result.to_json()["rows"][0]))
    assert result.measured
    assert not result.crashed


def test_paths_are_written_as_trajectories():
    _, result = run(["seer"], episodes=2)
    for walked in rows(result):
        for kind, poses in (("true", walked["path"]), ("estimated", walked["believed"])):
            file = result.run / "methods" / "seer" / "trajectories" / f"{walked['episode']}-{kind}.tum"
            table = np.loadtxt(file)
            np.testing.assert_array_equal(table[:, 0], np.arange(len(poses)))
            np.testing.assert_allclose(table[:, 1:4], np.array(poses)[:, :3], atol=1e-6)
            yaw_rad = Rotation.from_quat(table[:, 4:]).as_euler("zyx")[:, 0]
            np.testing.assert_allclose(np.exp(1j * yaw_rad), np.exp(1j * np.array(poses)[:, 3]), atol=1e-5)


def test_the_same_command_gives_the_same_table_elsewhere_too():
    first, one = run(["seer"])
    again, other = run(["seer"], runs=Path("elsewhere"))
    assert first == again
    assert rows(one) == rows(other)


def test_a_run_resumes():
    table, result = run(["seer"])
    path = result.run / "methods" / "seer" / "rows.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:4]) + lines[4][:50])
    (result.run / "methods" / "seer" / "outcome.json").unlink()
    assert run(["seer"])[0] == table
    assert path.read_bytes() == b"".join(lines)


def test_without_positioning_the_place_is_all_it_has():
    table, result = run(["seer"], positioning=Positioning.BOTH)
    assert list(table) == ["seer", "seer without positioning"]
    frames = {(1.0, 2.0), (3.0, 3.5), (7.0, 2.0), (4.1, 2.0)}
    for walked in rows(result, "seer without positioning"):
        assert tuple(walked["believed"][0][:2]) in frames
        assert walked["believed"][0][3] == walked["path"][0][3]  # the heading that it was told
    assert table["seer without positioning"].p_value is not None
    assert list(run(["seer"], positioning=Positioning.OFF)[0]) == ["seer without positioning"]
    assert (
        run(["seer"], "posed=false")[0]["seer"].success_rate.value
        == table["seer without positioning"].success_rate.value
    )


def test_beside_it_an_agent_is_told_its_true_place():
    """It stands at the node that it is nearest to, whatever the method answers, and no method is given anything."""
    table, result = run(["seer"], "blind=true", positioning=Positioning.ALL)
    assert list(table) == ["seer", "seer without positioning", TRUE_PLACE]
    assert [row.input for row in table.values()] == [("range",), ("range",), (TRUE_PLACE,)]
    assert [row.success_rate.value for row in table.values()][:2] == [0.0, 0.0]
    assert table[TRUE_PLACE].success_rate_3m.value > 0
    nodes_m = [(1.0, 2.0), (3.0, 3.5), (7.0, 2.0), (4.075, 2.025)]  # the last is the doorway of the masks
    for walked in rows(result, TRUE_PLACE):
        assert tuple(walked["believed"][0][:2]) in nodes_m
        assert walked["believed"][0][3] == walked["path"][0][3]


def test_an_episode_that_crashes_costs_only_itself():
    asked = [{"start": "a-west", "goal": "a-north"}, {"start": "b", "goal": "a-west"}]
    Path("two.json").write_text(json.dumps(asked))
    table, result = run(["seer"], "crash_east_of_m=5.0", episodes=Path("two.json"))
    assert table["seer"].status == {"arrived": 1, "crashed": 1}
    assert table["seer"].success_rate.value == 0.5
    assert rows(result)[1]["error"] == "ValueError: too far east"
    assert "too far east" in (result.run / "methods" / "seer" / "crash.log").read_text()
    assert result.crashed


@pytest.mark.parametrize(
    ("match", "reason"),
    [
        (
            lambda self, description: {"status": "ok"},
            "the function `match` of the method returned dict, expected a Localization",
        ),
        (lambda self, description: sys.exit("it leaves"), "SystemExit: it leaves"),
    ],
)
def test_nonsense_and_an_exit_cost_the_method_its_row(monkeypatch, match, reason):
    from apartment_plugin import Seer

    Path("blind.yaml").write_text("kind: seer\nblind: true\n")
    answer = Seer.match
    monkeypatch.setattr(Seer, "match", lambda self, seen: (answer if self.config.blind else match)(self, seen))
    table, result = run(["seer", "blind.yaml"], episodes=2)
    assert (table["seer"].reason, table["seer"].success_rate) == (reason, None)
    assert table["blind"].success_rate.value == 0.0
    assert result.crashed


def test_a_method_that_cannot_run_keeps_its_row():
    table, _ = run(["weightless", "seer"])
    assert not table["weightless"].available
    assert "salframe weights fetch weightless" in table["weightless"].reason
    assert table["weightless"].success_rate is None
    assert table["seer"].success_rate.value == 1.0


def test_the_settings_are_part_of_the_run():
    _, one = run(["seer"])
    table, other = run(["seer"], "navigation.budget=1", "navigation.planner=dijkstra")
    assert one.run != other.run
    assert table["seer"].panoramas == 1.0
    with pytest.raises(ConfigError, match=r"unknown setting navigation\.bugdet"):
        run(["seer"], "navigation.bugdet=1")
    with pytest.raises(ConfigError, match="received 0 as the number of episodes, expected 1 to 100000"):
        run(["seer"], episodes=0)


def test_the_command_prints_the_table_and_the_report(read):
    result = salframe("navigate", "--data", "apartment", "--methods", "seer", "--episodes", 3, "--engine", "inline")
    assert result.code == 0
    assert "100.0 (100-100)" in result.out
    (walked,) = read(Path(result.out.split("report: ")[1].strip()))[0]["walks"]
    assert len(walked["episodes"]["0"]) == 3
    assert walked["worlds"]["floor"]["picture"].startswith("data:image/png;base64,")
    printed = salframe(
        "navigate", "--data", "apartment", "--methods", "seer", "--episodes", 3, "--engine", "inline", "--json"
    ).json
    assert printed["rows"][0]["success_rate"] == 1.0


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ("--data", "still"),
            "error: navigation needs panoramas at new poses, which the dataset still cannot render: choose another "
            "dataset, such as house-12\n",
        ),
        (
            ("--data", "unmasked"),
            "error: navigation needs floor masks (images of the free floor) to detect collisions, which the dataset "
            "unmasked does not have: choose another dataset, such as house-12\n",
        ),
        (
            ("--data", "apartment", "--episodes", "none.json"),
            "error: cannot read none.json: No such file or directory, expected JSON\n",
        ),
        (
            ("--data", "apartment", "--episodes", "-2"),
            "error: received -2 as the number of episodes, expected 1 to 100000\n",
        ),
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
    assert "episode 0: building floor: the position (4.10, 0.50) m is in a wall or obstacle" in result.out
    assert "episode 2: building floor: unknown node 'attic'." in result.out


def episodes(successes, **given):
    ended = {
        "status": "arrived",
        "oracle": True,
        "success_1m": True,
        "success_3m": True,
        "travelled_m": 4.0,
        "panoramas": 3,
        "collisions": 1,
        "path": [],
        "error": None,
        "shortest_m": 2.0,
        **given,
    }
    return tuple(
        EpisodeRow(episode=i, world="w", goal=f"room-{i}", **ended, success=success, spl=0.5 * success)
        for i, success in enumerate(successes)
    )


def summarize(*methods):
    """The lines of the table for methods with these rows, the same episodes each."""
    records = [Record(f"m{i}", Outcome(MethodStatus.DONE), found, Path()) for i, found in enumerate(methods)]
    survey = NavigationSurvey(None, [SimpleNamespace(number=i) for i in range(len(methods[0]))], sites={})
    return NavigationTask(NavigationConfig(), len(methods[0]), 0).summarize([(survey, records)], 0)


def test_means_and_intervals():
    (row,) = summarize(episodes([True] * 30 + [False] * 10))
    assert (row.success_rate.value, row.spl.value, row.oracle_success_rate.value) == (0.75, 0.375, 1.0)
    assert (row.path_m, row.panoramas, row.collisions) == (4.0, 3.0, 1.0)
    expected = binomtest(30, 40).proportion_ci(method="wilson")
    assert (row.success_rate.low, row.success_rate.high) == pytest.approx((expected.low, expected.high))


def test_a_crashed_episode_is_a_failure_and_has_no_length():
    failure = dict.fromkeys(("success", "oracle", "success_1m", "success_3m"), False)
    where = {"episode": 1, "world": "w", "goal": "room-1", "shortest_m": 2.0}
    crashed = EpisodeRow(status="crashed", error="ValueError: no", spl=0.0, **failure, **where)
    (row,) = summarize((*episodes([True]), crashed))
    assert (row.success_rate.value, row.path_m) == (0.5, 4.0)
    (row,) = summarize((crashed,))
    assert (row.success_rate.value, row.path_m) == (0.0, None)


def test_significance_is_of_the_same_episodes():
    first, second = summarize(episodes([True] * 8), episodes([False] * 8))
    assert first.p_value is None
    assert second.p_value == pytest.approx(2 / 2**8)
    _, alike = summarize(episodes([True, False]), episodes([True, False]))
    assert alike.p_value == 1.0


def test_significance_is_clustered_by_goal():
    """Eight episodes to two rooms tell no more than two tosses."""
    first, second = (
        [row.model_copy(update={"goal": f"room-{row.episode % 2}"}) for row in episodes([found] * 8)]
        for found in (True, False)
    )
    assert summarize(first, second)[1].p_value == pytest.approx(2 / 2**2)
