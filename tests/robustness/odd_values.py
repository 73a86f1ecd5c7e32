"""Odd values as a user may type them, and the keys and options that receive them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

import typer
from pydantic import BaseModel

from salframe.cli import app

ODD = (
    *("0", "-1", "1", "-0.0", "0.5", "1.0", "1e18", "1e308", "-1e308", "1e-320", "1e400", "nan", "inf", "-inf"),
    *(".nan", ".inf", "-.inf", "9223372036854775807", "9223372036854775808", "18446744073709551615"),
    *("18446744073709551616", "-9223372036854775808", "9" * 5000, "0xff", "0o17", "1_000", "1,5", "12:30:45", "٣"),
    *("", " ", "''", "x" * 3000, "a\0b", "日本", "\u202e", "a\nb", "~", "*", ",", ",,", "a,b", "null", "true", "false"),
    *("auto", "yes", "2020-01-01", "--help", "-", "=", "a=b", "[]", "{}", "[[]]", "[null]", "[1, [2, [3]]]", "[.nan]"),
    *("[1e308, 1e308]", "[0, 0]", "[2, 1]", "[a, a]", "{a: 1}", "{1: 2}", "{x: .inf}", "{kind: null}", "{kind: 1}"),
    *("{kind: [a]}", "{kind: x}", "!!binary aGk=", "&a [*a]", "[" * 100, "1/0", "%s", "$HOME", "\ud800"),
)  # fmt: skip
"""Numbers, texts and YAML that stand where something else is expected."""


def list_keys(model: type[BaseModel], above: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield the dotted keys of a model and of the models in it."""
    for name, field in model.model_fields.items():
        yield ".".join((*above, name))
        for part in (field.annotation, *get_args(field.annotation)):
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from list_keys(part, (*above, name))


def list_parameters() -> Iterator[tuple[str, list[Any]]]:
    """Yield every command of the command line, such as "map route", with its parameters that take a value."""

    def below(command: Any, words: tuple[str, ...]) -> Iterator[tuple[str, list[Any]]]:
        if hasattr(command, "commands"):
            for name, inner in command.commands.items():
                yield from below(inner, (*words, name))
        else:
            yield " ".join(words), [one for one in command.params if not getattr(one, "is_flag", False)]

    yield from below(typer.main.get_command(app), ())
