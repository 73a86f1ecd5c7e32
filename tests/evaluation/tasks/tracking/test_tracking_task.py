"""The task `tracking`: walks, answers and beliefs, with localizers whose answers are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from salframe.evaluation.runs.records import Record
from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import MethodStatus, Outcome
from salframe.evaluation.studies.study import Study, run_study
from salframe.evaluation.tasks.tracking.measures import summarize_beliefs
from salframe.evaluation.tasks.tracking.rows import WalkRow
from salframe.evaluation.tasks.tracking.survey import TrackingSurvey
from salframe.evaluation.tasks.tracking.walks import NUM_VIEWS, STEP_M, draw_walk
from salframe.framework.components.defaults import default_of
from salframe.framework.components.presets import configure_default
from salframe.framework.components.registry import registry
from salframe.framework.errors import SalframeError
from salframe.framework.validation import validate
from salframe.navigation.episodes import Site
from salframe.navigation.guide import Guide
from salframe.navigation.world import open_worlds

pytestmark = pytest.mark.usefixtures("apartment")
EXACT = {"exact": {"drift_share": 0, "heading_drift_deg": 0}}


def table(method="seer", settings=None, **options):
    """The rows of a study by belief, and its result."""
    content = {"task": "tracking", "data": "apartment", "methods": {method: {"method": method, "set": settings or {}}}}
    study = validate(Study, {**content, "walks": 4, "views": [1], "odometry": EXACT, **options}, "study")
    result = run_study(study, Request(engine="inline", name="walks"))
    return {row.belief: row for row in result.rows}, result


@pytest.fixture
def site():
    (world,) = open_worlds(registry().build("dataset", configure_default("dataset", "apartment")))
    return Site(world, Guide(world.chart, configure_default("planner", default_of("navigation_planner"))))


def test_walks_go_through_two_rooms_in_steps_and_are_those_of_the_seed(site):
    walks = [draw_walk(site, number, 3) for number in range(5)]
    for walk in walks:
        assert len(walk.poses) == len(walk.places) == NUM_VIEWS
        assert {"a", "b"} == {*walk.places} - {""}
        steps_m = np.linalg.norm(np.diff([pose[:3, 3] for pose in walk.poses], axis=0), axis=1)
        assert steps_m.max() <= STEP_M + 1e-9
        for pose, after in zip(walk.poses[:-1], walk.poses[1:], strict=True):
            ahead = after[:2, 3] - pose[:2, 3]
            np.testing.assert_allclose(ahead / np.linalg.norm(ahead), after[:2, 0], atol=1e-6)  # it looks ahead
    again = draw_walk(site, 4, 3)
    np.testing.assert_array_equal(again.poses, walks[4].poses)
    assert not np.array_equal(draw_walk(site, 4, 2).poses, again.poses)
    assert len({walk.id for walk in walks}) == 5


def test_correct_answers_and_exact_odometry_are_tracked_without_an_error():
    rows, result = table(beliefs={"votes": {}, "latest": {"answers": "latest"}, "first": {"answers": "first"}})
    for row in rows.values():
        assert row.walks == 4
        assert (row.near.value, row.tracking.value) == (1.0, 1.0)
        assert row.position_m.value == pytest.approx(0.0, abs=1e-5)  # the range image is float32
        assert row.roc_area is None  # the apartment is not generated from a seed
    for name in ("votes", "first"):  # the place of a single answer is that of the nearest frame, also in the doorway
        assert rows[name].right == (1.0,) * 5
        assert rows[name].right_12.value == 1.0
    assert rows["votes"].recovered.value == 1.0
    assert rows["first"].position_m.value == pytest.approx(0.0, abs=1e-5)
    assert not result.crashed
    stored = json.loads((result.runs[0] / "beliefs.json").read_text())
    assert [row["belief"] for row in stored] == ["votes", "latest", "first"]


def test_shifted_answers_have_the_error_of_the_shift():
    rows, _ = table(settings={"shift_m": 0.4}, beliefs={"votes": {}, "latest": {"answers": "latest"}})
    for row in rows.values():
        assert row.position_m.value == pytest.approx(0.4, abs=1e-4)
    far, _ = table(settings={"shift_m": 0.6}, beliefs={"votes": {}})
    assert far["votes"].near.value == 0.0


def test_only_the_latest_answers_know_of_a_move_that_was_not_measured():
    _, result = table(beliefs={"latest": {"answers": "latest"}, "first": {"answers": "first"}})
    for walk in (result.runs[0] / "methods" / "seer" / "rows.jsonl").read_text().splitlines():
        latest, first = (json.loads(walk)["beliefs"][name] for name in ("latest", "first"))
        assert len(latest["kidnapped"]) == len(first["kidnapped"]) == 8
        assert latest["kidnapped"][-1]["position_m"] < 1e-4 < first["kidnapped"][-1]["position_m"]
        assert first["walk"][-1]["position_m"] < 1e-4


def test_larger_errors_of_odometry_are_a_row_of_their_own():
    """After the first answer, odometry alone has an error of about 20 % of each step of 0.5 m."""
    noisy = {**EXACT, "noisy": {"drift_share": 0.2, "heading_drift_deg": 0}}
    _, result = table(odometry=noisy, beliefs={"first": {"answers": "first"}})
    assert [row["odometry"] for row in result.settings] == ["exact", "noisy"]
    exact, drifted = (row.position_m.value for row in result.rows)
    assert exact == pytest.approx(0.0, abs=1e-4)
    assert 0.1 < drifted < 1.5


def test_a_localizer_that_never_answers_is_lost():
    rows, _ = table(settings={"blind": True}, beliefs={"votes": {}, "latest": {"answers": "latest"}})
    for row in rows.values():
        assert (row.right_12.value, row.near.value, row.tracking.value, row.position_m) == (0.0, 0.0, 0.0, None)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"views": [0]}, "greater than or equal to 1"),
        ({"beliefs": {}}, "at least 1"),
        ({"beliefs": {"votes": {"tracker": "vote"}}}, "unknown tracker 'vote'"),
        ({"walks": 0}, "greater than or equal to 1"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(SalframeError, match=message):
        table(**options)


def line(right=True, support=1.0, tracking=True, position_m=0.1, nees=3.0) -> dict:
    errors = {} if position_m is None else {"position_m": position_m, "heading_deg": 1.0, "nees": nees}
    return {"tracking": tracking, "support": support, "right": right, **errors}


def walk_row(number, last, kidnapped, elsewhere) -> WalkRow:
    belief = {
        "walk": [line(right=False)] * (NUM_VIEWS - 1) + [last],
        "kidnapped": kidnapped,
        "elsewhere": [elsewhere] * NUM_VIEWS,
    }
    content = {"walk": f"w{number}", "start": f"room-{number}", "beliefs": {"votes": belief}}
    return WalkRow.model_validate({**content, "status": "ok", "error": None})


def test_the_measures_are_those_of_rows_with_known_beliefs():
    rows = [
        walk_row(0, line(support=3.0, position_m=0.1, nees=2.0), [line(False), line()], line(support=1.0)),
        walk_row(
            1, line(support=2.0, position_m=0.3, nees=4.0), [line(), line(False)], line(tracking=False, support=2.0)
        ),
        walk_row(2, line(False, 0.5, False, None), [line(False), line(False)], line(tracking=False, support=0.0)),
        WalkRow.model_validate({"walk": "w3", "start": "room-3", "status": "crashed", "error": "it died"}),
    ]
    record = Record("seer", Outcome(MethodStatus.DONE, None, ()), tuple(rows), Path("seer"))
    survey = TrackingSurvey(None, range(4), worlds={}, other=None)
    (row,) = summarize_beliefs([(survey, [record])], ["votes"], 0)
    assert row.walks == 4
    assert (row.right[0], row.right_12.value) == (0.0, 0.5)  # the crashed walk counts as wrong
    assert row.near.value == 0.5
    assert row.recovered.value == 0.5
    assert row.right_later.value == 0.25
    assert row.tracking.value == 0.5
    assert row.nees == 3.0
    assert row.roc_area is None  # one walk has no answers in the other map
    (row,) = summarize_beliefs(
        [(survey, [Record("seer", Outcome(MethodStatus.DONE, None, ()), tuple(rows[:3]), Path("seer"))])], ["votes"], 0
    )
    # of the nine pairs of (3, 2, 0.5) with (1, 2, 0): six are larger, one is equal
    assert row.roc_area.value == pytest.approx(6.5 / 9)
    assert row.tracking_elsewhere.value == pytest.approx(1 / 3)
    assert row.position_m.value == 0.3
