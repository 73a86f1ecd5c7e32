"""Conformance rules for components of the role `engine`."""

from __future__ import annotations

import os
from functools import cached_property
from typing import Any

from salframe.framework.engines.engine import Engine
from salframe.framework.errors import WorkerDied
from salframe.testing.expectations import DoesNotApply, attempt, expect
from salframe.testing.rules import Rules


class EngineRules(Rules[Engine]):
    """Every item has an answer, in order. An item that raises affects no other item."""

    @cached_property
    def _answers(self) -> list[Any]:
        return attempt("map", lambda: list(self.make().map(_halve, [2, 3, 8])))

    def every_item_has_an_answer(self) -> None:
        expect(len(self._answers) == 3, "map of 3 items", f"{len(self._answers)} answers", "an answer for each item")

    def an_exception_affects_only_its_item(self) -> None:
        raised = self._answers[1]
        checked = "map over an item that raises ValueError"
        expect(isinstance(raised, ValueError), checked, repr(raised), "the exception as the answer of this item")

    def answers_come_in_order(self) -> None:
        received = self._answers[::2]
        expect(received == [1, 4], "map over items next to one that raises", received, "[1, 4], in order")

    def a_process_that_ends_affects_only_its_item(self) -> None:
        engine = self.make()
        if not engine.isolates:
            raise DoesNotApply("the engine does not run items in separate processes")
        died, answered = attempt(
            "map over an item that ends its process", lambda: list(engine.map(_end_or_halve, [1, 4]))
        )
        checked = "map over an item that ends its process"
        expect(isinstance(died, WorkerDied), checked, repr(died), "WorkerDied as the answer of this item")
        expect(answered == 2, checked, f"{answered} for the next item", "2")

    def no_items_have_no_answers(self) -> None:
        received = attempt("map of no items", lambda: list(self.make().map(_halve, [])))
        expect(received == [], "map of no items", f"{len(received)} answers", "an empty list")


def _halve(number: int) -> int:
    if number % 2:
        raise ValueError(f"the item {number} is odd, expected an even number (the check raises this error on purpose)")
    return number // 2


def _end_or_halve(number: int) -> int:
    if number % 2:
        os._exit(1)
    return number // 2
