"""The command line as a whole: what it loads, its help, and errors in one line."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
import typer
from command_line import run

from salframe.cli import app
from salframe.framework.components.registry import registry


def modules_after(*arguments: str) -> set[str]:
    """The modules a fresh interpreter has loaded after `salframe` ran with these arguments."""
    code = (
        "import sys; from salframe.cli import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        "print('\\n' + ' '.join(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_help_loads_nothing_heavy():
    loaded = modules_after("--help")
    assert "typer" in loaded
    assert not loaded & {"numpy", "scipy", "networkx", "torch", "cv2", "pydantic", "plotly"}


def test_plugins_does_not_load_torch():
    loaded = modules_after("plugins")
    assert "salframe_keypoints" in loaded
    assert not loaded & {"torch", "kornia"}


def test_every_command_has_help():
    listed = run("--help").out
    for command in (
        "compare",
        "ablate",
        "evaluate",
        "build",
        "localize",
        "plugins",
        "show",
        "doctor",
        "data",
        "weights",
    ):
        assert command in listed
        assert run(command, "--help").code == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["compare", "--methods", "raeder", "--data", "rooms"], "unknown method 'raeder', did you mean 'reader'?"),
        (["compare", "--methods", "reader", "--data", "roms"], "unknown dataset 'roms', did you mean 'rooms'?"),
        (
            ["compare", "--methods", "reader", "--data", "rooms", "--engine", "inlin"],
            "unknown engine 'inlin', did you mean 'inline'?",
        ),
        (
            ["compare", "--methods", "reader", "--data", "rooms", "--set", "offset"],
            "received --set 'offset', expected KEY=VALUE, such as",
        ),
        (
            ["compare", "--methods", "reader", "--data", "rooms", "--set", "offset=far"],
            "setting offset: received 'far', expected",
        ),
        (
            ["compare", "--methods", "reader", "--data", "rooms", "--set", "data.size=1"],
            "unknown setting data.size (known settings: rooms,",
        ),
        (
            ["compare", "--methods", "reader", "--data", "rooms", "--set", "data.rooms=0"],
            "rooms has no query (panorama to localize), expected at least one",
        ),
        (["ablate", "absent.yaml"], "cannot read the file absent.yaml"),
        (
            ["navigate", "--episodes=-5", "--data", "rooms"],
            "received -5 as the number of episodes, expected 1 to 100000",
        ),
        (["navigate", "--episodes=--5", "--data", "rooms", "--methods", "reader"], "cannot read --5"),
        (["evaluate", "."], "is not a run folder"),
        (["show", "raeder"], "unknown preset, component or role 'raeder', did you mean 'reader'?"),
        (
            ["localize", ".", "query-0-0", "--data", "rooms"],
            ". contains no map: build one with salframe build DATA -o .",
        ),
        (["build", "rooms", "-o", "map", "--method", "weightless"], "weightless.pth is not at hand"),
        (["weights", "where", "nothing"], "unknown weights 'nothing'"),
    ],
)
def test_what_a_user_gets_wrong_is_one_line(fakes, arguments, message):
    done = run(*arguments)
    assert done.code == 2
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1
    assert message in done.err


def test_debug_shows_the_traceback(fakes):
    from salframe.framework.errors import UnknownName

    with pytest.raises(UnknownName):
        run("--debug", "show", "raeder")


def test_a_plugin_that_fails_to_import_is_told_and_stops_nothing(fakes, monkeypatch):
    monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,salframe_engines,no_such_plugin")
    registry.cache_clear()
    listed = run("plugins")
    assert listed.code == 0
    assert "the plugin no_such_plugin (package no_such_plugin) failed to load: ModuleNotFoundError" in listed.out
    assert run("compare", "--methods", "reader", "--data", "rooms", "--engine", "inline").code == 0
    done = run("compare", "--methods", "no_such_plugin", "--data", "rooms")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "failed to load (ModuleNotFoundError: No module named 'no_such_plugin')" in done.err
    checked = run("doctor")
    assert checked.code == 1
    assert re.search(r"\d+ components, 1 plugin failed to load\n", checked.out)
    assert "no_such_plugin: ModuleNotFoundError" in checked.out


ENDING = """
import salframe
from fake_plugin import Reader

class Ending(Reader):
    \"\"\"Ends the process.\"\"\"
    name = "ending"

    @classmethod
    def {}(cls, config):
        raise {}

def leave():
    \"\"\"A command that ends with a status of its own.\"\"\"
    raise SystemExit(7)

@salframe.hookimpl
def salframe_provides():
    return [Ending]

@salframe.hookimpl
def salframe_commands():
    return {{"leave": leave}}
"""
COMPARE = ("compare", "--methods", "ending", "--data", "rooms", "--engine", "inline")


@pytest.fixture
def ending(fakes, monkeypatch, tmp_path):
    """Makes a plugin with a localizer that raises something in one of its methods."""

    def make(method: str, error: str) -> None:
        (tmp_path / "ending_plugin.py").write_text(ENDING.format(method, error))
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "ending_plugin", raising=False)
        monkeypatch.setenv("SALFRAME_PLUGINS", "fake_plugin,ending_plugin,salframe_engines")
        registry.cache_clear()

    return make


@pytest.mark.parametrize("method", ["check", "weights_in_use"])
@pytest.mark.parametrize("error", ["SystemExit", "SystemExit(0)"])
def test_a_component_that_ends_the_process_is_an_error(ending, method, error):
    ending(method, error)
    done = run(*COMPARE, "--json")
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert "ended the process (SystemExit" in done.err
    assert "ending_plugin.py, line 11" in done.err
    assert run("methods").code == run("plugins").code == 0


def test_a_command_ends_as_it_likes(ending):
    ending("check", "SystemExit")
    assert run("leave").code == 7
    wrong = run("compare", "--sed", "1")
    assert (wrong.code, wrong.out) == (2, "")
    assert "No such option" in wrong.err
    assert run("compare", "--help").code == 0


@pytest.mark.parametrize("command", [COMPARE, ("methods",), ("plugins",)], ids=lambda command: command[0])
def test_every_command_says_that_it_was_interrupted(ending, command):
    ending("check", "KeyboardInterrupt")
    done = run(*command)
    assert (done.code, done.out) == (130, "")
    assert done.err == "interrupted: finished work is stored; run the same command again to resume\n"


def test_the_summaries_of_subcommands_fit_one_line_of_80_columns():
    group = typer.main.get_command(app)
    commands = [group.get_command(None, name) for name in group.list_commands(None)]
    groups = [command.commands for command in commands if hasattr(command, "commands")]
    assert len(groups) == 4
    for subcommands in groups:
        frame = max(map(len, subcommands)) + 6  # the names, a gap of 2, and the frame with its margin on both sides
        long = [name for name, one in subcommands.items() if frame + len(one.help.partition("\n")[0]) > 79]
        assert long == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["data", "lst"], "No such command 'lst', did you mean 'list'; see salframe data --help"),
        (["comprae"], "No such command 'comprae', did you mean 'compare'; see salframe --help"),
        (["qqq"], "No such command 'qqq'; see salframe --help"),
        (["compare", "--metod"], "No such option: --metod, did you mean '--methods'; see salframe compare --help"),
    ],
)
def test_a_usage_error_is_one_sentence_with_the_closest_name(words, message):
    done = run(*words)
    start, _, end = message.partition("; see salframe")
    assert done.code == 2
    assert re.fullmatch(rf"error: {re.escape(start)}; see \S.*{re.escape(end)}\n", done.err)


@pytest.mark.parametrize("command", [(), ("compare",), ("docs",), ("map",), ("map", "build"), ("localize",)])
def test_help_shows_types_of_values_but_not_of_flags(command):
    lines = run(*command, "--help").out.splitlines()
    flags = [line for line in lines if re.search(r"--(debug|version|json|help)\b", line)]
    assert flags
    assert not [line for line in flags if re.search("bool", line, re.IGNORECASE)]
    if command == ("compare",):
        assert [line for line in lines if re.search(r"--seed +N ", line)]


def test_the_paragraphs_of_help_have_no_line_breaks_of_their_own():
    """Typer prints a line break inside a paragraph, and terminals have other widths than the source."""
    group = typer.main.get_command(app)
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        for one in (command, *getattr(command, "commands", {}).values()):
            assert "\n" not in one.help.replace("\n\n", ""), f"{name} {one.name}"
