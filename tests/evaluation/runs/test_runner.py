"""What goes wrong in a method costs its own row, whatever it is, wherever, and on whatever engine; what was answered
once is not asked again."""

from __future__ import annotations

import errno
import json
import os
import re
from pathlib import Path

import pytest
from command_line import run as salframe

from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.run_folder import MethodStatus, Run
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.evaluation.tasks.localization.task import compare

ENGINES = ("inline", "processes")


def run(methods, *settings, engine="inline", **given):
    """Rows by method, and the result."""
    result = compare(Request(tuple(methods), "rooms", settings=("data.rooms=3", *settings), engine=engine, **given))
    return {row.method: row for row in result.rows}, result


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("where", ["init", "describe", "index", "match"])
def test_a_method_that_exits_costs_its_own_row(faults, where, engine):
    rows, result = run(["faulty", "reader"], f"where={where}", engine=engine)
    faulty = rows["faulty"]
    assert (faulty.ended, faulty.reason) == (MethodStatus.CRASHED, "SystemExit: the network wants to leave")
    assert (faulty.accuracy, faulty.status) == (None, {"crashed": 6})
    assert "the network wants to leave" in (result.run / "methods" / "faulty" / "crash.log").read_text()
    assert rows["reader"].accuracy.value == 1.0
    assert result.crashed
    assert result.measured


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("where", "what"), [("match", "generator"), ("init", "value"), ("describe", "value"), ("index", "value")]
)
def test_whatever_else_a_method_raises_costs_its_own_row(faults, where, what, engine):
    rows, result = run(["faulty", "reader"], f"where={where}", f"what={what}", engine=engine)
    message = {"generator": "GeneratorExit: no more", "value": "ValueError: this is too much"}[what]
    assert (rows["faulty"].reason, rows["faulty"].accuracy) == (message, None)
    assert rows["reader"].accuracy.value == 1.0
    assert result.crashed


@pytest.mark.parametrize(("where", "message"), [("check", "the driver is odd"), ("weights", "no weights of that name")])
def test_a_method_that_cannot_be_looked_at_costs_its_own_row(faults, where, message):
    rows, result = run(["faulty", "reader"], f"where={where}")
    assert (rows["faulty"].ended, rows["faulty"].reason) == (MethodStatus.CRASHED, f"ValueError: {message}")
    assert rows["reader"].accuracy.value == 1.0
    assert result.crashed


def test_an_exception_costs_the_query_alone(faults):
    rows, _ = run(["faulty"], "where=match", "what=value")
    assert (rows["faulty"].ended, rows["faulty"].accuracy.value) == (MethodStatus.DONE, 0.0)
    assert rows["faulty"].status == {"crashed": 6}
    assert rows["faulty"].errors == {"crashed": "ValueError: this is too much"}


@pytest.mark.parametrize("engine", ENGINES)
def test_the_exit_code_tells_of_a_method_that_exits(faults, engine):
    asked = ("compare", "--methods", "faulty,reader", "--data", "rooms", "--engine", engine)
    done = salframe(*asked, "--set", "where=match")
    assert done.code == 1
    assert "faulty[where=match]: SystemExit: the network wants to leave" in done.out
    assert "100.0 (72-100)" in done.out


@pytest.mark.parametrize("where", ["init", "match"])
def test_an_interrupt_ends_the_command(faults, where):
    asked = ("compare", "--methods", "faulty,reader", "--data", "rooms", "--engine", "inline")
    done = salframe(*asked, "--set", f"where={where}", "--set", "what=interrupt")
    assert (done.code, done.out) == (130, "")
    assert done.err == "interrupted: finished work is stored; run the same command again to resume\n"


NONSENSE = {
    "shape": r"T_world_query of an answer is \[\[1\.0, 0\.0, 0\.0\].*, expected a rigid motion \(4, 4\) or None",
    "zero": r"T_world_query of an answer is \[\[0\.0, .*, expected a rigid motion",
    "scaled": r"T_world_query of an answer is \[\[2\.0, .*, expected a rigid motion",
    "mirrored": r"T_world_query of an answer is \[\[1\.0, .*, expected a rigid motion",
    "nan": r"T_world_query of an answer is \[\[nan, .*, expected a rigid motion",
    "status": r"a localization has the status 'certain', expected one of ok, no-pose, .*",
    "posed": "a localization has the status no-pose and a pose, expected no pose",
    "poseless": "a localization has the status ok and no pose, expected a pose",
    "placeless": "a localization has the status no-pose and no place, expected a place",
    "elsewhere": "the function `match` of the method returned the frame 'map-9' with the place 'room-9'",
    "misplaced": "the function `match` of the method returned the frame 'map-0' with the place 'room-1'",
    "mapping": "the function `match` of the method returned dict, expected a Localization",
    "nothing": "the function `match` of the method returned NoneType, expected a Localization",
    "text": "the function `match` of the method returned str, expected a Localization",
    "score": "a localization has the score NaN for the place 'room-0', expected a number",
}


@pytest.mark.parametrize(("answer", "message"), NONSENSE.items(), ids=NONSENSE.keys())
def test_nonsense_costs_its_own_row(faults, answer, message):
    rows, result = run(["nonsense", "reader"], f"answer={answer}")
    assert rows["nonsense"].ended is MethodStatus.CRASHED
    assert re.match(message, rows["nonsense"].reason), rows["nonsense"].reason
    assert "\n" not in rows["nonsense"].reason
    assert not rows["nonsense"].measured
    assert rows["reader"].accuracy.value == 1.0
    assert result.crashed


def test_a_method_that_crashes_when_all_is_answered_is_told(faults, monkeypatch):
    monkeypatch.setattr("salframe.evaluation.tasks.localization.answering.Answering.close", lambda self: 1 / 0)
    rows, result = run(["reader"])
    assert rows["reader"].status == {"ok": 6}
    assert rows["reader"].reason == "ZeroDivisionError: division by zero"
    assert result.crashed


@pytest.fixture
def asked(monkeypatch) -> list[str]:
    """The names of the localizers that are asked, a word a query."""
    from fake_plugin import Reader

    names, match = [], Reader.match

    def spy(self, description):
        names.append(self.name)
        return match(self, description)

    monkeypatch.setattr(Reader, "match", spy)
    return names


def kept(result, label="reader") -> str:
    return (result.run / "methods" / label / "rows.jsonl").read_text()


def test_another_comparison_with_a_method_more_asks_only_that_one(fakes, asked):
    before, first = run(["reader"])
    asked.clear()
    after, second = run(["reader", "greedy"], name="another")
    assert first.run != second.run
    assert asked == ["greedy"] * 6
    assert after["reader"] == before["reader"]
    assert kept(second) == kept(first)
    assert f"method reader: the answers and times of the earlier run {first.run} are reused" in second.notes
    assert "reused" not in " ".join(first.notes)
    assert run(["reader", "greedy"], name="another")[1].notes == second.notes  # of the resumed run too


def test_the_seed_of_the_intervals_is_no_reason_to_ask_again(fakes, asked):
    run(["reader"])
    asked.clear()
    _, result = run(["reader"], seed=1)
    assert asked == []
    assert result.rows[0].accuracy.value == 1.0


@pytest.mark.parametrize("settings", [("offset=1",), ("data.queries=1",), ("data.leave_one_out=true",)])
def test_another_setting_of_method_or_data_is_asked_anew(fakes, asked, settings):
    run(["reader"])
    asked.clear()
    _, result = run(["reader"], *settings)
    assert len(asked) == len(Run.load(result.run).rows("reader", AnswerRow)) > 0
    assert result.notes == ()


def test_another_content_of_the_data_is_asked_anew(fakes, asked, monkeypatch):
    run(["reader"])
    asked.clear()
    monkeypatch.setenv("ROOMS_CONTENT", "other")
    _, result = run(["reader"], name="other")
    assert len(asked) == 6
    assert result.notes == ()


def test_another_version_of_the_method_is_asked_anew(fakes, asked, monkeypatch):
    run(["reader"])
    asked.clear()
    monkeypatch.setattr("fake_plugin.Reader.version", "2")
    run(["reader"])
    assert len(asked) == 6


def test_another_content_of_a_users_file_is_asked_anew(faults, asked):
    Path("note.txt").write_text("one")
    run(["noted"])
    asked.clear()
    run(["noted"], name="same")
    assert asked == []
    Path("note.txt").write_text("two")
    _, result = run(["noted"])
    assert asked == ["noted"] * 6
    assert result.notes == ()


def test_what_crashed_elsewhere_is_asked_again(fakes, asked, monkeypatch):
    run(["reader"], "fail_in=2")
    asked.clear()
    _, result = run(["reader"], "fail_in=2", name="again")
    assert len(asked) == 2  # the two queries of room 2
    assert "are reused" in result.notes[0]


def test_a_run_folder_says_what_was_asked_and_where(fakes):
    _, result = run(["reader", "weightless"])
    assert {path.name for path in result.run.iterdir()} >= {"request.yaml", "env.json", "methods"}
    names = {path.name for path in (result.run / "methods" / "reader").iterdir()}
    files = {"rows.jsonl", "descriptions.jsonl", "maps.jsonl", "outcome.json", "identity.json", "metrics.json"}
    assert names == files
    environment = json.loads((result.run / "env.json").read_text())
    assert environment["dataset_fingerprint"] == result.to_json()["data_fingerprint"]
    outcome = json.loads((result.run / "methods" / "weightless" / "outcome.json").read_text())
    assert outcome["status"] == "unavailable"


def test_the_folders_of_odd_labels_stay_inside_the_run(faults):
    for name in ("...yaml", "..yaml", "a b.yaml"):
        Path(name).write_text("kind: reader\n")
    rows, result = run(["...yaml", "..yaml", "a b.yaml"])
    assert list(rows) == ["..", ".", "a b"]
    assert all(row.accuracy.value == 1.0 for row in rows.values())
    found = {path.parent.resolve() for path in Path().rglob("outcome.json")}
    assert len(found) == 3
    assert all(folder.parent == result.run.resolve() / "methods" for folder in found)
    assert sorted(os.listdir()) == ["...yaml", "..yaml", "a b.yaml", "cache", "runs"]


def test_a_full_disk_costs_the_report_and_not_the_table(fakes, monkeypatch):
    from salframe.evaluation.runs import runner

    def full(path, content):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(runner, "write_json", full)
    done = salframe("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline")
    assert done.code == 0
    assert "100.0 (72-100)" in done.out
    assert "the metrics and the report of the run runs/rooms-" in done.out
    assert " could not be written: No space left on device" in done.out


def test_a_folder_that_cannot_be_written_to_is_one_line(fakes, tmp_path):
    (tmp_path / "file").write_text("years")
    done = salframe("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline", "--runs", "file/runs")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert done.err.startswith("error: cannot use")
    assert done.err.endswith("Not a directory\n")
