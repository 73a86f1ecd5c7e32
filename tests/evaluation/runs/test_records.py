from __future__ import annotations

from salframe.evaluation.runs.records import count_statuses


def test_statuses_are_counted_ok_first():
    assert list(count_statuses(["low-score", "no-pose", "ok", "no-pose"]).items()) == [
        ("ok", 1),
        ("no-pose", 2),
        ("low-score", 1),
    ]
