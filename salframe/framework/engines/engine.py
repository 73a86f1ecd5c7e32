"""The role `engine`: how independent pieces of work are run."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, ClassVar

from salframe.framework.component import Role
from salframe.framework.components.defaults import default_of
from salframe.framework.components.presets import configure_default
from salframe.framework.components.registry import registry
from salframe.framework.errors import WorkerDied


class Engine(Role):
    """Runs independent pieces of work: in this process, in others, on many machines.

    All that is many pieces goes through one: frames to render or to describe, and shares of a method's questions. Its
    setting `workers`, where it has one, is how many are worked on at a time.
    """

    role = "engine"
    isolates: ClassVar[bool] = False
    """Whether items are worked on in other processes, where the end of one costs the item at hand alone."""

    @property
    def workers(self) -> int | None:
        """How many items are worked on at a time, where that is set; None: as many as it sees fit, one of those whose
        time is measured."""
        return getattr(self.config, "workers", 1)

    @abstractmethod
    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """function(item) for each item, in order; function and items must be picklable.

        An item that raises costs itself only: the value yielded for it is the exception, WorkerDied where its process
        ended. Processes are of this call alone: what is kept in one from item to item ends with the call.
        """

    def try_all(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """The answers of `map`, where an item whose worker died is tried once more, after all others."""
        died = []
        for item, answer in zip(items, self.map(function, items), strict=True):
            if isinstance(answer, WorkerDied):
                died.append(item)
            else:
                yield answer
        yield from self.map(function, died)


def open_engine(name: str | None = None, overrides: Iterable[Mapping[str, Any]] = ()) -> Engine:
    """The engine of this name, the default one where it is None, with settings laid on top. Raises UnknownName,
    ConfigError, RequirementMissing."""
    engine: Engine = registry().build(Engine.role, configure_default("engine", name or default_of("engine"), overrides))
    return engine
