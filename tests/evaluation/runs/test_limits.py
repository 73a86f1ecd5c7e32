"""Work that hangs, takes all memory or ends its process costs its own answer."""

from __future__ import annotations

import psutil
import pytest

from salframe.evaluation.runs.limits import Limits
from salframe.evaluation.runs.request import Request
from salframe.evaluation.tasks.localization.task import compare
from salframe.framework.errors import ConfigError

DIED = "the worker process died: it was killed, ran out of memory, or crashed in a library"
LONG, LARGE = (
    "the worker process took more than 3 s, the limit of --timeout",
    "the worker process used more than 450 MB, the limit of --memory",
)


def ask(*settings: str, methods: tuple[str, ...] = ("deadly", "reader"), **limits: float):
    given = ("data.rooms=3", "data.queries=1", *settings)
    return compare(Request(methods, "rooms", settings=given, limits=Limits(**limits)))


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("exit", DIED),
        ("fault", DIED),
        ("hang", LONG),
        ("spin", LONG),
        ("silence", LONG),
        ("hoard", LARGE),
        ("hoard-in-child", LARGE),
    ],
)
def test_a_query_that_ends_its_process_costs_itself(faults, how, reason):
    limit = {"memory_mb": 450.0} if reason == LARGE else {"timeout_s": 3.0}
    deadly, reader = ask(f"how={how}", **limit).rows
    assert (deadly.status, deadly.errors) == ({"ok": 2, "crashed": 1}, {"crashed": reason})
    assert deadly.accuracy.value == pytest.approx(2 / 3)
    assert (reader.accuracy.value, reader.status) == (1.0, {"ok": 3})


def test_a_limit_ends_the_children_too(faults, tmp_path):
    (row,) = ask("how=hang-in-child", methods=("deadly",), timeout_s=3.0).rows
    assert row.errors == {"crashed": LONG}
    child = int((tmp_path / "child").read_text())
    assert not psutil.pid_exists(child) or psutil.Process(child).status() == psutil.STATUS_ZOMBIE


def test_a_method_that_never_ends_its_construction_costs_its_row(faults):
    deadly, reader = ask("how=spin", "when=init", timeout_s=3.0).rows
    assert (deadly.accuracy, deadly.reason) == (None, LONG)
    assert reader.accuracy.value == 1.0


def test_a_method_that_changes_the_working_folder_harms_nobody(faults):
    wanderer, reader = ask("how=wander", "deadly.rooms=[0, 1, 2]").rows
    assert (wanderer.status, reader.status) == ({"ok": 3}, {"ok": 3})


def test_what_a_process_died_of_is_tried_once_more(faults, tmp_path):
    for when in ("init", "map", "query"):
        (row,) = ask("how=exit-once", f"when={when}", methods=("deadly",)).rows
        assert (row.accuracy.value, row.status) == (1.0, {"ok": 3})
        (tmp_path / "died").unlink()


def test_a_method_that_always_dies_is_given_up(faults):
    deadly, reader = ask("data.rooms=5", "deadly.rooms=[0, 1, 2, 3, 4]").rows
    assert (deadly.accuracy, deadly.reason) == (None, DIED)
    assert deadly.crashed
    assert reader.accuracy.value == 1.0


def test_what_a_query_was_ended_for_is_asked_again_the_next_time(faults):
    first = ask("how=hang", methods=("deadly",), timeout_s=1.0)
    again = ask("how=hang", methods=("deadly",), timeout_s=1.0)
    assert again.run == first.run
    assert again.rows[0].status == {"ok": 2, "crashed": 1}


def test_the_time_of_the_map_is_not_that_of_a_query(faults):
    (row,) = ask("describe_s=2.0", methods=("slow",), timeout_s=3.0).rows
    assert row.accuracy.value == 1.0


def test_an_engine_without_processes_can_hold_no_limit(faults):
    with pytest.raises(ConfigError, match="need worker processes, which the engine 'inline' does not have"):
        compare(Request(["reader"], "rooms", engine="inline", limits=Limits(timeout_s=1.0)))
