"""The options that commands share."""

from __future__ import annotations

import inspect
from typing import Annotated

import typer
from typer.testing import CliRunner

from salframe.cli.options import CommonOptions, with_common_options


def call(command, *arguments: str) -> str:
    app = typer.Typer()
    app.command()(command)
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return done.output


def test_a_command_has_an_option_for_each_field_and_receives_them_together():
    @with_common_options()
    def command(methods: str = "all", *, options: CommonOptions) -> None:
        request = options.request(methods)
        print(request.methods, request.data, request.settings, request.seed, request.limits.timeout_s, options.style)

    given = ["--methods", "a,b", "--data", "rooms", "--set", "x=1", "--workers", "2", "--seed", "3", "--timeout", "4"]
    told = call(command, *given, "--format", "md")
    assert told == "('a', 'b') rooms ('x=1', 'engine.workers=2') 3 4.0 md\n"


def test_fields_are_left_out_or_have_another_default():
    @with_common_options(without=["seed"], data=(Annotated[str | None, typer.Option()], None))
    def command(*, options: CommonOptions) -> None:
        print(options.data, options.seed)

    assert "seed" not in inspect.signature(command).parameters
    assert call(command) == "None 0\n"
