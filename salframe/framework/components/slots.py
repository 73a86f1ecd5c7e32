"""Slots: config fields that hold a component, which is named by the user and provided by any installed plugin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, SerializeAsAny, ValidationInfo

from salframe.framework.component import ROLE, ComponentConfig
from salframe.framework.components.auto import Choice, parts_added, undecided
from salframe.framework.components.defaults import AUTO, auto_order, default_of
from salframe.framework.components.registry import registry
from salframe.framework.errors import with_article
from salframe.framework.validation import validate_component


def slot(
    role: str,
    default: str | None = None,
    *,
    match_only: bool = False,
    optional: bool = False,
    description: str | None = None,
) -> Any:
    """Return the type of a config field that holds a component of a role.

    Example: `detector: slot("detector", "annotations")`.

    The field accepts the name of a component, a mapping with its settings, or its Config. A mapping without `kind`
    holds settings of the default component. The value is validated with the Config of the component. The name `auto`
    is allowed if configs/defaults.yaml has an order for the role. The automatic choice assumes that panoramas also have
    the parts that components in earlier slots add.

    Args:
        role: The role.
        default: The name of the default component. None for the default of the role in configs/defaults.yaml.
        match_only: Whether the component affects only matching, see the function `match_only`.
        optional: Whether the field may be None. It is None by default if there is no `default`.
        description: The help text.
    """

    def kind() -> str:
        return default_of(role) if default is None else default

    def resolve(value: Any, info: ValidationInfo) -> ComponentConfig | None:
        if optional and value is None:
            return None
        return _fill(role, kind(), value, info)

    order = auto_order(role)
    names = ", ".join(f"`{name}`" for name in order)
    auto_description = (
        f"{role}. {AUTO}: the first of {names} that can run on this machine and on the data" if order else None
    )
    field = Field(
        default_factory=lambda: None if optional and default is None else {"kind": kind()},
        validate_default=True,
        json_schema_extra={ROLE: role, **({"match_only": True} if match_only else {})},
        description=description or auto_description,
    )
    config: Any = SerializeAsAny[ComponentConfig]
    return Annotated[config | None if optional else config, BeforeValidator(resolve), field]


def slots(role: str, default: tuple[str, ...], description: str) -> Any:
    """Return the type of a config field that holds an ordered list of at least one component of a role.

    Example: `of: slots("detector", ("segments", "onnx"), "detectors to combine")`.

    The field accepts a list. Each entry has a form that `slot` accepts. A mapping must have a `kind`.
    """

    def resolve(value: Any, info: ValidationInfo) -> tuple[ComponentConfig, ...]:
        if not isinstance(value, list | tuple) or not value:
            raise ValueError(f"received {value!r}, expected a list with at least one {role}")
        unnamed = [entry for entry in value if isinstance(entry, Mapping) and "kind" not in entry]
        if unnamed:
            raise ValueError(
                f"the list entry {unnamed[0]!r} has no key `kind`, expected `kind` with the name of "
                f"{with_article(role)}"
            )
        return tuple(_fill(role, "", entry, info, (str(number),)) for number, entry in enumerate(value))

    field = Field(
        default_factory=lambda: tuple({"kind": name} for name in default),
        validate_default=True,
        description=description,
    )
    return Annotated[tuple[SerializeAsAny[ComponentConfig], ...], BeforeValidator(resolve), field]


def _fill(role: str, default: str, value: Any, info: ValidationInfo, keys: tuple[str, ...] = ()) -> ComponentConfig:
    """Return the configuration of the component that the value of a slot names.

    `keys` are the keys of the value below the slot, see InvalidComponent.

    Raises:
        ValueError: A setting is invalid.
        UnknownName: There is no such component.
        InputMissing: No component can fill a slot with the value `auto`.
    """
    choice: Choice | None = info.context
    if isinstance(value, ComponentConfig):
        if value.kind != AUTO or choice is None:
            return value
        value = value.kind
    if isinstance(value, str):
        value = {"kind": value}
    if not isinstance(value, Mapping):
        raise ValueError(f"received {value!r}, expected the name of {with_article(role)}, or a mapping of settings")
    value = {"kind": default, **value}
    if value["kind"] != AUTO or not auto_order(role):
        return validate_component(registry().get(role, value["kind"]).Config, value, choice, keys)
    if choice is None:
        if len(value) > 1:
            names = ", ".join(f"{info.field_name}.{key}" for key in value if key != "kind")
            raise ValueError(
                f"{names} cannot be set, because the {role} is 'auto': 'auto' selects {with_article(role)} only when "
                f"the dataset is known. Select one of {', '.join(auto_order(role))}, or specify the dataset"
            )
        return undecided(role).Config()
    component = choice.choose(role, parts_added(info.data.values()))
    note = f"'auto' selected the {role} {component.name!r}"
    return validate_component(component.Config, {**value, "kind": component.name}, choice, keys, note)
