"""The rules of the role `engine`."""

from __future__ import annotations

from collections.abc import Callable

from salframe.evaluation.engine import Engine
from salframe.testing.asking import attempt, expect


def check_engine(make: Callable[[], Engine]) -> None:
    """Every item is answered, in order; one that raises costs only itself."""
    engine = make()
    received = attempt("map", lambda: list(engine.map(_halve, [2, 3, 8])))
    expect(len(received) == 3, "map of 3 items", f"{len(received)} answers", "an answer for each item")
    expect(
        isinstance(received[1], ValueError),
        "map over an item that raises ValueError",
        repr(received[1]),
        "that exception as its answer",
    )
    expect(
        (received[0], received[2]) == (1, 4), "map over items beside one that raises", received[::2], "[1, 4], in order"
    )
    expect(attempt("map of no item", lambda: list(engine.map(_halve, []))) == [], "map of no item", "an answer", "none")


def _halve(number: int) -> int:
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number // 2
