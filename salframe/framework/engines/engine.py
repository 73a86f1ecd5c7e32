"""The role `engine`, which runs independent work items."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar

from salframe.framework.component import Role
from salframe.framework.components.defaults import default_of
from salframe.framework.components.presets import configure_default
from salframe.framework.components.registry import registry
from salframe.framework.errors import WorkerDied


class Engine(Role):
    """Runs independent jobs (work items) in this process, in worker processes, or on several machines.

    A work item is a frame to render, a frame to describe (compute features of), or a group of queries of a method. The
    setting `workers`, if an engine has it, is the number of worker processes.

    Attributes:
        isolates: Whether items run in other processes, where a crash affects only the current item.
    """

    role = "engine"
    isolates: ClassVar[bool] = False

    @property
    def workers(self) -> int | None:
        """Number of worker processes; 1 for engines without the setting `workers`. None (not set): runs that measure
        times use one worker, and all other work uses as many as the engine chooses."""
        return getattr(self.config, "workers", 1)

    @abstractmethod
    def map(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """Yield function(item) for each item, in order.

        The worker processes end when all items are done.

        Args:
            function: A picklable function.
            items: Picklable items.

        Yields:
            The result of each item. If an item raises, its result is the exception, and the other items are not
            affected. If its process ended, the result is WorkerDied.
        """

    def try_all(self, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
        """Yield the results of `map`. If the worker of an item died, retry the item once, after all other items.

        The results of the retried items come last.
        """
        retries = []
        for item, result in zip(items, self.map(function, items), strict=True):
            if isinstance(result, WorkerDied):
                retries.append(item)
            else:
                yield result
        yield from self.map(function, retries)


def open_engine(name: str | None = None, overrides: Sequence[Mapping[str, Any]] = ()) -> Engine:
    """Return an engine.

    Args:
        name: The name of the engine. None for the default engine.
        overrides: Settings of the engine.

    Raises:
        UnknownName: There is no such engine.
        ConfigError: A setting is invalid.
        RequirementMissing: A package is not installed.
    """
    engine: Engine = registry().build(Engine.role, configure_default("engine", name or default_of("engine"), overrides))
    return engine
