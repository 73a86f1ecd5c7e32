"""Exceptions as one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from salframe.framework.errors import DataError, describe_error, suggest


def missing_file(name: str) -> OSError:
    try:
        Path(name).read_text(encoding="utf-8")
    except OSError as error:
        return error
    raise AssertionError(f"{name} was read")


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (DataError("a is 1, expected 2"), "a is 1, expected 2"),
        (ValueError("a\nb"), "ValueError: a b"),
        (ValueError(), "ValueError"),
        (missing_file("no/file"), "cannot use the file or folder no/file: No such file or directory"),
        (missing_file("no/a\x07"), r"cannot use the file or folder no/a\x07: No such file or directory"),
        (
            missing_file("9" * 5000),
            f"cannot use the file or folder {'9' * 100}... (5000 characters): File name too long",
        ),
        (OSError("without a file"), "OSError: without a file"),
    ],
)
def test_an_exception_is_one_line(error, line):
    assert describe_error(error) == line


@pytest.mark.parametrize(
    ("name", "known", "suggestion"),
    [
        ("nothing", ["matching", "rooms"], ""),
        ("features", ["rates"], ""),
        ("how-to/map", ["out-of-map", "how-to/maps"], ", did you mean 'how-to/maps'"),
        ("sitf", ["sift", "size"], ", did you mean 'sift'"),
        ("work", ["workers"], ", did you mean 'workers'"),
    ],
)
def test_only_similar_names_are_suggested(name, known, suggestion):
    assert suggest(name, known) == suggestion
