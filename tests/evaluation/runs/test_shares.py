"""A method whose work several workers share answers as if one had done it all."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from salframe.evaluation.runs.request import Request
from salframe.evaluation.runs.rows import read_rows
from salframe.evaluation.runs.run_folder import MethodStatus, Outcome, Run
from salframe.evaluation.runs.shares import join_outcomes, join_shares, split_work
from salframe.evaluation.tasks.localization.task import compare
from salframe.evaluation.tasks.matching.task import measure_matching
from salframe.evaluation.tasks.navigation.task import navigate

TIMES = {"query_ms", "describe_ms", "peak_memory_mb", "ms", "seconds"}
"""Fields that differ from run to run."""


def rows_of(result, label):
    rows = read_rows(Run.load(result.run).folder(label) / "rows.jsonl", dict)
    return [{key: value for key, value in row.items() if key not in TIMES} for row in rows]


def described(result):
    """The frames whose description is known to have cost something."""
    lines = (result.run / "methods" / "reader" / "descriptions.jsonl").read_text().splitlines()
    return sorted(json.loads(line)["frame"] for line in lines)


@pytest.fixture
def both(monkeypatch):
    """What one worker makes of it, and two: each without knowing of the other."""

    def measured(measure, methods, data, *settings, **given):
        results = []
        for workers in (1, 2):
            monkeypatch.setenv("SALFRAME_CACHE", f"cache-{workers}")
            settings = (*settings, f"engine.workers={workers}")
            results.append(measure(Request(methods, data, settings=settings, runs=Path(f"runs-{workers}")), **given))
        return results

    return measured


@pytest.mark.parametrize("leave_one_out", ["true", "false"])
def test_answers_of_several_workers_are_those_of_one(fakes, both, leave_one_out):
    alone, shared = both(compare, ["reader", "weightless"], "rooms", f"data.leave_one_out={leave_one_out}", "fail_in=2")
    assert rows_of(alone, "reader") == rows_of(shared, "reader")
    assert [row.status for row in alone.rows] == [row.status for row in shared.rows]
    assert [row.reason for row in alone.rows] == [row.reason for row in shared.rows]
    assert alone.rows[0].bytes_per_scene == shared.rows[0].bytes_per_scene > 0
    assert described(alone) == described(shared)
    assert not (shared.run / "methods" / "reader" / "shares").exists()


def test_matches_of_several_workers_are_those_of_one(furnished, both):
    alone, shared = both(measure_matching, ["points", "nodes"], "furnished")
    assert [rows_of(alone, label) for label in ("points", "nodes")] == [
        rows_of(shared, label) for label in ("points", "nodes")
    ]


def test_episodes_of_several_workers_are_those_of_one(apartment, both):
    alone, shared = both(navigate, ["seer"], "apartment", episodes=5)
    assert rows_of(alone, "seer") == rows_of(shared, "seer")
    assert len(rows_of(shared, "seer")) == 5


def test_pieces_are_split_in_their_order(tmp_path):
    keys = [(number,) for number in range(7)]
    assert [share.keys for share in split_work(keys, 3, tmp_path)] == [keys[:2], keys[2:4], keys[4:]]
    assert [share.folder for share in split_work(keys, 1, tmp_path)] == [tmp_path]
    assert [share.keys for share in split_work(keys[:2], 9, tmp_path)] == [keys[:1], keys[1:2]]
    assert [share.keys for share in split_work([], 9, tmp_path)] == [[]]  # which tells how the method would end


def test_what_a_killed_run_left_is_joined(tmp_path):
    """Whole lines alone, and each once, however often the joining itself is cut off."""
    (tmp_path / "rows.jsonl").write_text('{"query": "a"}\n')
    first, second = (share.folder for share in split_work([("b",), ("c",)], 2, tmp_path))
    for folder, text in ((first, '{"query": "a"}\n{"query": "b"}\n{"que'), (second, '{"query": "c"}\n')):
        folder.mkdir(parents=True)
        (folder / "rows.jsonl").write_text(text)
        (folder / "crash.log").write_text("a traceback\n")
    join_shares(tmp_path)
    assert (tmp_path / "rows.jsonl").read_text() == '{"query": "a"}\n{"query": "b"}\n{"query": "c"}\n'
    assert (tmp_path / "crash.log").read_text() == "a traceback\n" * 2
    assert sorted(os.listdir(tmp_path)) == ["crash.log", "rows.jsonl"]


def test_an_outcome_is_that_of_the_worst_share():
    done = Outcome(MethodStatus.DONE, "1 frame left out", ("rgb",))
    crashed = Outcome(MethodStatus.CRASHED, "ValueError: no")
    assert join_outcomes([done, done]) == done
    assert join_outcomes([done, crashed]) == Outcome(MethodStatus.CRASHED, "1 frame left out; ValueError: no", ("rgb",))
