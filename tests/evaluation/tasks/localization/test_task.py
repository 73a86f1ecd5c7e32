from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from salframe.evaluation.finished_runs import evaluate
from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.evaluation.tasks.localization.table import LocalizationRow
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.components.installation import folder_bytes
from salframe.framework.errors import ConfigError, DataError
from salframe.localization.answers import Localization, LocalizationStatus
from salframe.topology.building_map import build_map


def run(methods, *settings, engine="inline", **given):
    """Rows by method, the run, and the result."""
    result = compare(Request(tuple(methods), "rooms", settings=settings, engine=engine, **given))
    return {row.method: row for row in result.rows}, Run.load(result.run), result


def answers(run: Run, label: str = "reader") -> dict:
    """A method's rows by (fold, query), the last of each."""
    return {(row.fold, row.query): row for row in run.rows(label, AnswerRow)}


def descriptions(run: Run, label: str = "reader") -> list[dict]:
    return [json.loads(line) for line in (run.folder(label) / "descriptions.jsonl").read_text().splitlines()]


def test_rows_have_the_promised_numbers(fakes):
    rows, _, result = run(["reader"], "wrong_from=3")
    row = rows["reader"]
    assert isinstance(row, LocalizationRow)
    assert (row.queries, row.accuracy.value, row.status) == (10, 0.8, {"ok": 10})
    assert row.recall_at_5 == 1.0
    # queries stand 0.1 and 0.2 m from the reference frame whose pose is answered
    assert row.median_translation_m == pytest.approx(0.15)
    assert row.recall_025m_2deg == 0.8  # room 3 is answered 4 m off
    build_map("rooms", Path("map"), "reader", topology=False, overrides=("wrong_from=3",))
    assert row.bytes_per_scene == folder_bytes(Path("map")) / 5
    assert row.available
    assert row.reason is None
    kept = (result.run / "methods" / "reader" / "metrics.json").read_text()
    assert json.loads(kept) == json.loads(json.dumps(result.to_json()["rows"][0]))
    assert result.measured
    assert not result.crashed
    assert row.input == ("rgb",)
    assert result.row("reader") is row
    with pytest.raises(KeyError):
        result.row("raeder")


def test_significance_is_against_the_first_measured_method(fakes):
    rows, _, _ = run(["weightless", "reader", "greedy"], "greedy.offset=1")
    assert rows["reader"].p_value is None
    # rooms 0 to 3 are wrong; in room 4 the nearest answer to one too many is right: 8 queries to 0, two a room
    assert rows["greedy"].p_value == pytest.approx(2 / 2**4)


def test_a_method_that_cannot_run_keeps_its_row(fakes):
    rows, _, result = run(["reader", "weightless", "ranger"])
    for method, reason in (
        ("weightless", "salframe weights fetch weightless"),
        ("ranger", "needs range images, which the dataset rooms does not have"),
    ):
        assert not rows[method].available
        assert reason in rows[method].reason
        assert rows[method].accuracy is None
        assert rows[method].status == {}
    assert result.measured
    assert not result.crashed


def test_a_method_that_crashes_does_not_stop_the_others(fakes):
    rows, opened, result = run(["unbuildable", "reader"])
    assert rows["unbuildable"].available
    assert rows["unbuildable"].reason == "RuntimeError: no map for you"
    assert rows["unbuildable"].status == {"crashed": 10}
    assert rows["unbuildable"].accuracy is None
    assert rows["reader"].accuracy.value == 1.0
    assert result.crashed
    assert "no map for you" in (opened.folder("unbuildable") / "crash.log").read_text()


def test_a_process_that_dies_costs_its_own_row(fakes):
    rows, _, result = run(["suicidal", "reader"], engine="processes")
    assert "the worker process died" in rows["suicidal"].reason
    assert rows["reader"].accuracy.value == 1.0
    assert result.crashed


def test_a_query_that_crashes_does_not_stop_the_others(fakes):
    rows, opened, result = run(["reader"], "fail_in=2")
    assert rows["reader"].accuracy.value == 0.8
    assert rows["reader"].status == {"ok": 8, "crashed": 2}
    assert answers(opened)["all", "query-2-0"].error == "ValueError: this room is too much"
    assert "all query-2-0" in (opened.folder("reader") / "crash.log").read_text()
    assert result.crashed


def test_a_refusal_is_a_failure(fakes):
    rows, _, result = run(["reader"], "refuse_in=1")
    assert rows["reader"].accuracy.value == 0.8
    assert rows["reader"].status == {"ok": 8, "low-score": 2}
    assert not result.crashed


def test_a_corrupt_query_is_an_error_of_its_own(fakes):
    rows, opened, result = run(["reader"], "data.broken=[query-3-1]")
    assert rows["reader"].status == {"ok": 9, "error": 1}
    assert answers(opened)["all", "query-3-1"].error == "query-3-1.png is no image"
    assert not result.crashed


def test_a_corrupt_mapping_frame_is_left_out_and_said_so(fakes):
    rows, _, _ = run(["reader"], "data.broken=[map-0]")
    assert rows["reader"].accuracy.value == 0.8
    assert rows["reader"].reason == (
        "1 of the reference frames (panoramas of the map) left out; the first error: map-0.png is no image"
    )


def test_a_map_without_a_frame_crashes(fakes):
    rows, _, result = run(["reader"], "data.rooms=1", "data.broken=[map-0]")
    assert rows["reader"].reason == "map-0.png is no image"
    assert result.crashed


def test_leave_one_out_describes_each_frame_once(fakes):
    rows, opened, _ = run(["reader"], "data.leave_one_out=true", "wrong_from=3")
    lines = (opened.folder("reader") / "descriptions.jsonl").read_text().splitlines()
    assert len(lines) == len({row["frame"] for row in descriptions(opened)}) == 5 + 10
    assert rows["reader"].accuracy.value == 0.8
    assert len({fold for fold, _ in answers(opened)}) == 10


def test_a_dataset_without_poses_has_no_pose_columns(fakes):
    rows, _, _ = run(["reader"], "data.posed=false")
    assert rows["reader"].accuracy.value == 1.0
    assert rows["reader"].median_translation_m is None
    assert rows["reader"].recall_1m_10deg is None


def test_a_dataset_without_queries_is_an_error(fakes):
    with pytest.raises(DataError, match="no query"):
        run(["reader"], "data.queries=0")


def test_no_method_is_an_error(fakes):
    with pytest.raises(ConfigError, match="at least one"):
        compare(Request((), "rooms"))


def test_resuming_asks_only_what_has_no_answer(fakes):
    _, opened, _ = run(["reader"])
    path = opened.folder("reader") / "rows.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    marked = [{**row, "query_ms": 12345.0} for row in rows[:7]]
    path.write_text("".join(json.dumps(row) + "\n" for row in marked) + '{"query": "query-3-1", "fo')
    run(["reader"])
    again = list(answers(opened).values())
    assert [row.query for row in again] == [row["query"] for row in rows]
    assert [row.query_ms == 12345.0 for row in again] == [True] * 7 + [False] * 3


def test_a_crashed_query_is_asked_again(fakes, monkeypatch):
    run(["reader"], "fail_in=2")
    asked = []

    def match(self, description):
        asked.append(description["room"].tolist())
        return Localization((), None, LocalizationStatus.LOW_SCORE)

    monkeypatch.setattr("fake_plugin.Reader.match", match)
    rows, _, _ = run(["reader"], "fail_in=2")
    assert asked == [[2, 1], [2, 2]]
    assert rows["reader"].status == {"ok": 8, "low-score": 2}


def test_a_method_that_was_unavailable_is_tried_again(fakes, monkeypatch):
    run(["weightless"])
    monkeypatch.setattr("fake_plugin.Weightless.check", classmethod(lambda cls, config: None))
    rows, _, _ = run(["weightless"])
    assert rows["weightless"].accuracy.value == 1.0


def test_a_changed_dataset_is_not_resumed(fakes, monkeypatch):
    run(["reader"])
    monkeypatch.setenv("ROOMS_CONTENT", "other")
    with pytest.raises(DataError, match="changed since the run began"):
        run(["reader"])


def test_a_kill_loses_no_finished_query(fakes, tmp_path):
    command = [
        sys.executable,
        "-c",
        "from salframe.cli import main; main()",
        "compare",
        "--methods",
        "reader",
        "--data",
        "rooms",
        "--set",
        "sleep_s=0.12",
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    before = b""
    while before.count(b"\n") < 3:
        time.sleep(0.02)
        found = list(tmp_path.glob("runs/*/methods/reader/rows.jsonl"))
        before = found[0].read_bytes() if found else b""
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(0.3)
    killed = found[0].read_bytes()
    assert killed.count(b"\n") < 10, "the worker outlived its parent"
    rows, _, _ = run(["reader"], "sleep_s=0.12", engine="inline")
    assert found[0].read_bytes().startswith(killed[: killed.rfind(b"\n") + 1])
    assert rows["reader"].accuracy.value == 1.0
    assert found[0].read_bytes().count(b"\n") == 10


def test_peak_memory_is_the_methods_own(fakes):
    rows, _, _ = run(["greedy", "reader"], "data.rooms=1", engine="processes")
    # greedy holds 200 MB, and twice that while it replaces them at its second query
    assert 390 < rows["greedy"].peak_memory_mb - rows["reader"].peak_memory_mb < 410
    assert run(["reader"], "data.rooms=2")[0]["reader"].peak_memory_mb is None


def test_cached_descriptions_keep_their_times(fakes):
    _, first, _ = run(["reader"])
    _, second, _ = run(["reader"], "offset=1")  # matches otherwise, describes alike
    assert descriptions(first) == descriptions(second)


def test_evaluate_measures_again_from_the_answers(fakes):
    rows, opened, _ = run(["reader", "weightless"], "wrong_from=3")
    assert {row.method: row for row in evaluate(opened.directory).rows} == rows
    path = opened.folder("reader") / "rows.jsonl"
    path.write_text(path.read_text().replace('"status": "ok"', '"status": "low-score"', 1))
    assert evaluate(opened.directory).rows[0].accuracy.value == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"out_of_map_probability": 0.5},
            "expected one probability for each place and a number as out_of_map_probability, or no probabilities",
        ),
        ({"places": []}, "an answer with the status ok has no place, expected at least one place"),
    ],
)
def test_an_answer_that_lacks_a_part_is_one_line(fakes, change, message):
    _, opened, _ = run(["reader"])
    path = opened.folder("reader") / "rows.jsonl"
    first, *others = path.read_text().splitlines(keepends=True)
    path.write_text(json.dumps(json.loads(first) | change) + "\n" + "".join(others))
    with pytest.raises(DataError, match=message):
        evaluate(opened.directory)


def test_evaluate_says_what_is_unfinished(fakes):
    _, opened, _ = run(["reader"])
    (opened.folder("reader") / "outcome.json").unlink()
    row = evaluate(opened.directory).rows[0]
    assert row.accuracy is None
    assert row.reason == "unfinished: 10 of 10 queries done"


def test_evaluate_of_no_run_is_an_error(tmp_path):
    with pytest.raises(ConfigError, match="not a run folder"):
        evaluate(tmp_path)


def test_progress_reaches_the_total(fakes):
    told: dict[str, tuple[int, int]] = {}
    request = Request(("reader",), "rooms", engine="inline")
    compare(request, progress=lambda what, done, total: told.update({what: (done, total)}))
    assert told == {"rooms": (5, 5), "reader": (25, 25)}  # 15 frames described, 10 queries answered


def test_runs_are_made_where_asked(fakes, tmp_path):
    _, _, result = run(["reader"], runs=Path("elsewhere"), name="mine")
    assert result.run.name.startswith("mine-")
    assert [folder.name[:5] for folder in (tmp_path / "elsewhere").iterdir()] == ["mine-"]
