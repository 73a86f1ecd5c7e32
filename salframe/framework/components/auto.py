"""Automatic choice: a slot (a setting that holds a component) with the value `auto` gets the first component that can
run on this machine and the data."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

from salframe.framework.component import Component, ComponentConfig, components_in
from salframe.framework.components.defaults import AUTO, auto_order
from salframe.framework.components.registry import registry
from salframe.framework.errors import (
    InputMissing,
    PluginFailed,
    RequirementMissing,
    UnknownName,
    failure_of,
    with_article,
)


class Choice:
    """Chooses the components of slots (settings that hold a component) with the value `auto`. Pass it to `validate`."""

    def __init__(self, data: str, provides: Callable[[], frozenset[str]]) -> None:
        """Create a choice for a dataset.

        Args:
            data: The name of the data in messages.
            provides: Returns the parts that the panoramas have, such as colour and range. It is called only if a slot
                is `auto`.
        """
        self._data, self._provides = data, provides
        self._notes: dict[str, str] = {}

    @property
    def notes(self) -> list[str]:
        """One line of text per role, with the component that was chosen for the role."""
        return list(self._notes.values())

    def choose(self, role: str, added: frozenset[str] = frozenset()) -> type[Component]:
        """Return the first component of a role that can run on this machine and on the data.

        The order of the components is in configs/defaults.yaml.

        Args:
            role: The role (kind of component, such as "detector") to choose a component for.
            added: Parts that other components add to the panoramas.

        Raises:
            InputMissing: No component can run. The message has a reason for each component.
        """
        component, remark = first_fit(role, self._provides() | added)
        if component is None:
            raise InputMissing(
                f"{AUTO!r} cannot select {with_article(role)} for {self._data}, because none can run: {remark}"
            )
        self._notes[role] = f"{AUTO!r} selected the {role} {component.name!r}" + (f" ({remark})" if remark else "")
        return component


def first_fit(role: str, provides: frozenset[str] | None) -> tuple[type[Component] | None, str]:
    """Return the first component of a role that can run, and the remark on it in configs/defaults.yaml.

    The order of the components is also in configs/defaults.yaml. Names that no plugin provides are skipped.

    Args:
        role: The role.
        provides: The parts that the panoramas have. None skips the check of the parts.

    Returns:
        The component and its remark, or None and the reasons if no component can run.
    """
    reasons = []
    for name, remark in auto_order(role).items():
        try:
            component = registry().get(role, name)
        except UnknownName:
            continue
        except PluginFailed as error:
            reasons.append(f"{name!r}: {error}")
            continue
        reason = unfit_reason(component, provides)
        if reason is None:
            return component, remark
        reasons.append(f"{name!r}: {reason}")
    return None, "; ".join(reasons) or "none is installed"


def unfit_reason(component: type[Component], provides: frozenset[str] | None) -> str | None:
    """Return why a component with default settings cannot run, or None if it can.

    `provides` are the parts that the panoramas have. None skips the check of the parts.
    """
    reason = failure_of(lambda: component.check(component.Config()))
    if reason is not None or provides is None:
        return reason
    absent = needs_of(component.Config()) - provides
    return f"needs {name_parts(absent)}, which the data does not have" if absent else None


def name_parts(parts: Iterable[str]) -> str:
    """Return parts of panoramas in words, for messages: "colour images" for "rgb", for example."""
    words = {"rgb": "colour images", "range": "range images"}
    return " and ".join(words.get(part, part) for part in sorted(parts))


def needs_of(config: ComponentConfig) -> frozenset[str]:
    """Return what a configured component needs of a panorama: its own `needs` and those of the components in its
    slots."""
    needs = getattr(config.component, "needs", None)
    parts = needs if isinstance(needs, frozenset) else frozenset()
    return parts.union(*(needs_of(inner) for _, inner in components_in(config)))


def parts_added(values: Iterable[Any]) -> frozenset[str]:
    """Return the parts, such as range, that components add to panoramas (their attribute `gives`). `values` are values
    of settings; those without a component are ignored."""
    components = (value.component for value in values if isinstance(value, ComponentConfig))
    return frozenset().union(*(getattr(component, "gives", ()) for component in components))


class Undecided(Component):
    """Placeholder of a setting with the value `auto`, until the dataset is known. It cannot be built."""

    name = AUTO
    version = "1"

    @classmethod
    def check(cls, config: ComponentConfig) -> None:
        """Raise RequirementMissing if no component of the role can run on this machine on any data."""
        component, reasons = first_fit(cls.role, None)
        if component is None:
            raise RequirementMissing(
                f"{AUTO!r} cannot select {with_article(cls.role)}, because none can run on this machine: {reasons}"
            )


@cache
def undecided(role: str) -> type[Component]:
    """Return a subclass of `Undecided` for this role."""
    return type(Undecided.__name__, (Undecided,), {"role": role, "__doc__": Undecided.__doc__})
