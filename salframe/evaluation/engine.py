"""The role `engine`: how independent pieces of work are run."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar

from salframe.framework.component import Role


class Engine(Role):
    """Runs independent pieces of work: in this process, in a pool, on many machines."""

    role = "engine"
    isolates: ClassVar[bool] = False
    """Whether each item has a process of its own, whose end is the item's alone."""

    @abstractmethod
    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """function(item) for each item, in order; function and items must be picklable. An item whose worker raises,
        exits or dies costs itself only: the value yielded for it is the exception."""
