"""What commands print where: JSON alone on stdout, progress now and then on stderr."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import run

from salframe.cli import output
from salframe.framework.components.registry import registry

TESTS = Path(__file__).parent.parent
SALFRAME = (sys.executable, "-c", "from salframe.cli import main; main()")


@pytest.fixture
def noisy(fakes, monkeypatch):
    """The fakes and noisy_plugin, which prints at import and wherever it is called."""
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,noisy_plugin,salframe_engines")
    monkeypatch.delitem(sys.modules, "noisy_plugin", raising=False)
    registry.cache_clear()


@pytest.mark.parametrize("engine", ["inline", "processes"])
def test_json_stands_alone_whatever_a_plugin_prints(noisy, engine):
    asked = ("compare", "--methods", "noisy,reader,ranger", "--data", "rooms", "--engine", engine, "--json")
    done = subprocess.run([*SALFRAME, *asked], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert [row["accuracy"] for row in content["rows"]] == [1.0, 1.0, None]
    below = ("noisy is imported, says the library", "noisy describes, says the library")
    for said in ("noisy is imported\n", "noisy describes\n", "noisy matches\n", *below):
        assert said in done.stderr


LATE = """
import atexit, ctypes, sys
import salframe
atexit.register(print, "said at exit")

@salframe.hookimpl
def salframe_provides():
    sys.__stdout__.write("said past redirection\\n")
    ctypes.CDLL(None).printf(b"said by C\\n")
    return []
"""


def test_json_stands_alone_whatever_is_printed_at_the_end(fakes, monkeypatch, tmp_path):
    (tmp_path / "late_plugin.py").write_text(LATE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,late_plugin,salframe_engines")
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    done = subprocess.run([*SALFRAME, "methods", "--json"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert any(entry["name"] == "reader" for entry in json.loads(done.stdout))
    assert set(done.stderr.splitlines()) == {"said at exit", "said past redirection", "said by C"}


def test_without_json_what_a_plugin_prints_is_left_alone(noisy):
    asked = ("compare", "--methods", "noisy", "--data", "rooms", "--engine", "inline")
    done = subprocess.run([*SALFRAME, *asked], capture_output=True, text=True)
    assert "noisy matches\n" in done.stdout
    assert "100.0 (72-100)" in done.stdout


def test_an_error_leaves_stdout_empty(noisy):
    done = subprocess.run([*SALFRAME, "show", "nosy", "--json"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert "did you mean 'noisy'?" in done.stderr


def test_json_says_what_was_asked_of_what_and_what_went_wrong(fakes):
    asked = ("--data", "rooms", "--engine", "inline", "--set", "data.broken=[query-3-1]", "--set", "reader.fail_in=2")
    done = run("compare", "--methods", "reader,weightless", *asked, "--seed", 5, "--json")
    content = done.json
    assert done.code == 1
    assert (content["format"], content["task"]) == (2, "localization")
    assert content["request"]["seed"] == 5
    assert content["request"]["data"] == {
        "kind": "rooms",
        "rooms": 5,
        "queries": 2,
        "posed": True,
        "broken": ["query-3-1"],
        "leave_one_out": False,
        "seed": 0,
        "root": "",
        "hide_query_place": False,
    }
    assert content["request"]["methods"]["reader"]["fail_in"] == 2
    assert len(content["data_fingerprint"]) >= 64
    assert content["versions"]["packages"]["salframe"]
    plugin = {"role": "localizer", "name": "reader", "version": "1", "package": "fake_plugin"}
    assert plugin in content["versions"]["plugins"]
    reader, weightless = content["rows"]
    assert reader["status"] == {"ok": 7, "crashed": 2, "error": 1}
    assert reader["errors"] == {"crashed": "ValueError: this room is too much", "error": "query-3-1.png is no image"}
    assert (reader["input"], reader["ended"], weightless["ended"]) == (["rgb"], "done", "unavailable")


@pytest.fixture
def clock(monkeypatch):
    """What time.monotonic tells, to be set."""
    now = [100.0]
    monkeypatch.setattr(output.time, "monotonic", lambda: now[0])
    return now


def test_off_a_terminal_progress_is_a_line_now_and_then(clock, capsys):
    with output.Bars() as bars:
        for second in range(1, 101):
            clock[0] = 100.0 + second
            bars.update("house", second, 100)
            bars.update("reader", 2 * second, 200)
    told = capsys.readouterr()
    assert told.out == ""
    expected = ["house 30/100, reader 58/200", "house 60/100, reader 118/200", "house 90/100, reader 178/200"]
    expected.append("house 100/100, reader 200/200")
    assert told.err.splitlines() == expected


def test_the_line_leaves_out_what_has_ended_and_what_has_not_begun(clock, capsys):
    with output.Bars() as bars:
        for what, done in (("house", 5), ("reader", 0), ("greedy", 2)):
            bars.update(what, done, 5)
        clock[0] += 31
        bars.update("ranger", 5, 5)
        assert capsys.readouterr().err.splitlines() == ["greedy 2/5, ranger 5/5"]


def test_the_last_line_has_the_final_progress_of_each_task_that_is_not_printed(clock, capsys):
    with output.Bars() as bars:
        bars.update("reader", 0, 25)
        clock[0] += 31
        bars.update("greedy", 18, 25)
        for what in ("reader", "greedy"):
            bars.update(what, 25, 25)
    assert capsys.readouterr().err.splitlines() == ["greedy 18/25", "reader 25/25, greedy 25/25"]


def test_a_short_run_off_a_terminal_prints_no_progress(clock, capsys):
    with output.Bars() as bars:
        bars.update("reader", 25, 25)
    assert capsys.readouterr().err == ""


def test_on_a_terminal_the_bars_show_the_final_progress(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with output.Bars() as bars:
        for what in ("reader", "greedy"):
            bars.update(what, 18, 25)
            bars.update(what, 25, 25)
    *_, reader, greedy = [line for line in capsys.readouterr().err.splitlines() if "/25" in line]
    assert all("25/25" in re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", line) for line in (reader, greedy))


def test_how_often_a_line_is_printed(clock, capsys, monkeypatch):
    monkeypatch.setattr(output, "LINE_SECONDS", 5.0)
    with output.Bars() as bars:
        for second in range(1, 12):
            clock[0] = 100.0 + second
            bars.update("house", second, 100)
    assert capsys.readouterr().err.splitlines() == ["house 5/100", "house 10/100", "house 11/100"]


def test_a_comparison_off_a_terminal_tells_how_far_it_is(fakes, monkeypatch):
    monkeypatch.setattr(output, "LINE_SECONDS", 0.0)
    monkeypatch.setattr("salframe.evaluation.runs.runner.POLL_SECONDS", 0.05)
    asked = ("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline", "--set", "sleep_s=0.05")
    lines = run(*asked).err.splitlines()
    assert lines[0] == "rooms 5/5"
    assert lines[-1] == "reader 25/25"
    done = [int(line.split("reader ")[1].split("/")[0]) for line in lines[1:]]
    assert done == sorted(done)
    assert len(set(done)) > 2


SLOWLY = {
    "compare": ("compare", "--methods", "slow", "--data", "rooms"),
    "compare, two workers": (
        *("compare", "--methods", "slow,other.yaml", "--data", "rooms", "--set", "engine.workers=2"),
    ),
    "compare, inline": ("compare", "--methods", "slow", "--data", "rooms", "--engine", "inline"),
    "map build": ("map", "build", "doored", "-o", "map", "--method", "slow"),
}
"""Commands that describe panoramas, one a minute after the first."""


@pytest.mark.parametrize("asked", SLOWLY.values(), ids=SLOWLY.keys())
@pytest.mark.parametrize(
    ("group", "sent", "status"),
    [(False, signal.SIGINT, 130), (True, signal.SIGINT, 130), (False, signal.SIGTERM, 143)],
    ids=["the command alone", "as by Ctrl-C, all its processes", "as by kill"],
)
def test_an_interrupt_is_one_line_within_two_seconds(fakes, tmp_path, asked, group, sent, status):
    (tmp_path / "other.yaml").write_text("kind: slow\noffset: 1\n")
    process = subprocess.Popen(
        [*SALFRAME, *asked, "--set", "describe_s=60"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ
        | {
            "SALFRAME_PLUGINS": "fake_plugin,faulty_plugin,doored_plugin,salframe_engines",
            "PYTHONPATH": os.pathsep.join([str(TESTS), str(TESTS / "topology")]),
        },
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell in the background ignores it
    )
    while process.poll() is None and not (tmp_path / "describing").exists():
        time.sleep(0.02)
    began = time.monotonic()
    if group:
        os.killpg(process.pid, sent)
    else:
        process.send_signal(sent)
    out, err = process.communicate(timeout=60)
    took_s = time.monotonic() - began
    assert (process.returncode, out) == (status, "")
    assert err == "interrupted: finished work is stored; run the same command again to resume\n"
    assert took_s < 2


@pytest.mark.parametrize("asked", [["methods"], ["plugins", "--json"], ["--help"]])
def test_a_full_standard_output_is_one_line(fakes, asked):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([*SALFRAME, *asked], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr == "error: cannot use the standard output: No space left on device\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ("evaluate", "--help"),
        ("methods",),
        ("plugins", "--json"),
        ("data", "list"),
        ("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline"),
    ],
    ids=" ".join,
)
def test_a_closed_pipe_ends_the_command_without_a_message(fakes, arguments):
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run([*SALFRAME, *arguments], stdout=writer, stderr=subprocess.PIPE, text=True)
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.parametrize("asked", [[b"evaluate", b"caf\xe9"], [b"compare", b"--data", b"rooms", b"--runs", b"caf\xe9"]])
def test_a_name_that_is_no_utf8_is_one_line_before_any_work(fakes, tmp_path, asked):
    done = subprocess.run([*map(os.fsencode, SALFRAME), *asked], capture_output=True)
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr == b"error: the argument 'caf\\udce9' is not UTF-8 text: rename the file or folder\n"
    assert not (tmp_path / "runs").exists()


def test_running_out_of_memory_is_one_line(fakes, monkeypatch):
    def build(*arguments, **options):
        raise MemoryError("Unable to allocate 7.28 TiB")

    monkeypatch.setattr("salframe.topology.building_map.build_map", build)
    done = run("build", "rooms", "-o", "map")
    assert (done.code, done.err) == (
        2,
        "error: out of memory: Unable to allocate 7.28 TiB; close other programs, or use fewer workers if the "
        "command has the option --workers\n",
    )
