"""A plugin that brings two roles of its own, one with a function that checks its promises."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

import salframe
from salframe.framework.component import Role
from salframe.testing.expectations import call_twice, expect


class Greeter(Role):
    """Says hello."""

    role = "greeter"
    conformance = "role_plugin:check_greeter"

    @abstractmethod
    def greet(self) -> str:
        """Hello."""


class Mute(Role):
    """Says nothing."""

    role = "mute"


class Polite(Greeter):
    """Says hello."""

    name = "polite"
    version = "1"

    def greet(self) -> str:
        return "hello"


class Rude(Greeter):
    """Broken."""

    name = "rude"
    version = "1"

    def greet(self) -> str:
        return "what"


class Silent(Mute):
    """Says nothing."""

    name = "silent"
    version = "1"


def check_greeter(make: Callable[[], Greeter]) -> None:
    said = call_twice("greet", make().greet)
    expect(said == "hello", "greet", repr(said), "a greeting")


@salframe.hookimpl
def salframe_provides() -> list[type]:
    return [Greeter, Mute, Polite, Rude, Silent]
