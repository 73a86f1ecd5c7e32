"""Problem details without paths of the host."""

from __future__ import annotations

from http import HTTPStatus

import pytest

from salframe.framework.errors import ConfigError, DataError, InputMissing, NoRoute, UnknownName
from salframe.serving.problems import MAX_DETAIL, Problem, hide_folders, problem_json, problem_of


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/tmp/salframe-x1/image is 12 x 12", "image is 12 x 12"),
        ("cannot read /home/anna/maps/flat.map/map.json: gone", "cannot read map.json: gone"),
        ("'/srv/a/b.npy', expected", "'b.npy', expected"),
        ("~/maps/flat.map was changed", "flat.map was changed"),
        ("../maps/flat.map was changed", "flat.map was changed"),
        (r"C:\Users\anna\map.json is cut", "map.json is cut"),
        ("unknown node 'corridor-01/bedroom-01'", "unknown node 'corridor-01/bedroom-01'"),
        ("received 3 m/s and 1/2 of it", "received 3 m/s and 1/2 of it"),
        ("see https://example.org/a/b", "see https://example.org/a/b"),
        ("two\nlines\tand \x07", "two lines and \\x07"),
    ],
)
def test_folders_are_hidden(text, expected):
    assert hide_folders(text) == expected


def test_details_have_a_limited_length():
    assert len(hide_folders("a" * 10_000)) < MAX_DETAIL


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (DataError("x"), 422),
        (InputMissing("x"), 422),
        (ConfigError("x"), 422),
        (UnknownName("x"), 422),
        (NoRoute("x"), 409),
        (MemoryError(), 503),
        (ValueError("secret"), 500),
        (Problem(HTTPStatus.NOT_FOUND, "x"), 404),
    ],
)
def test_status_of_an_error(error, status):
    problem = problem_json(problem_of(error))
    assert problem["status"] == status
    assert problem["title"] == HTTPStatus(status).phrase
    assert "secret" not in problem["detail"]
