"""Config fields that hold a component: filled by name, from whatever plugins are installed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, SerializeAsAny, ValidationInfo

from salframe.framework.component import ROLE, ComponentConfig
from salframe.framework.components.auto import Choice, parts_added, undecided
from salframe.framework.components.defaults import AUTO, auto_order, default_of
from salframe.framework.components.registry import registry
from salframe.framework.errors import ConfigError
from salframe.framework.validation import validate


def slot(
    role: str,
    default: str | None = None,
    *,
    match_only: bool = False,
    optional: bool = False,
    description: str | None = None,
) -> Any:
    """The type of a config field that holds a component of `role`: `detector: slot("detector", "annotations")`.

    It accepts a name, a mapping (its `kind` may be left out: then it is `default`), or a component's Config, asks the
    registry and validates with that component's own Config. The name may be `auto` where configs/defaults.yaml has an
    order for the role; parts that components in slots declared before it add to panoramas count as there. Without a
    `default`, that of configs/defaults.yaml for the role; `match_only` as in the function of that name. `optional`: it
    may hold None too, and does unless it is set or has a `default`.
    """

    def kind() -> str:
        return default_of(role) if default is None else default

    def resolve(value: Any, info: ValidationInfo) -> ComponentConfig | None:
        if optional and value is None:
            return None
        return _fill(role, kind(), value, info)

    order = auto_order(role)
    by_data = f"{AUTO}: the first of {', '.join(order)} that can run here on the data" if order else None
    field = Field(
        default_factory=lambda: None if optional and default is None else {"kind": kind()},
        validate_default=True,
        json_schema_extra={ROLE: role, **({"match_only": True} if match_only else {})},
        description=description or by_data,
    )
    held: Any = SerializeAsAny[ComponentConfig]
    return Annotated[held | None if optional else held, BeforeValidator(resolve), field]


def slots(role: str, default: tuple[str, ...], description: str) -> Any:
    """The type of a config field that holds several components of `role`, at least one, in order:
    `of: slots("detector", ("segments", "onnx"), "the detectors to unite")`.

    It accepts a list; each entry is what a `slot` accepts, and a mapping names its `kind`.
    """

    def resolve(value: Any, info: ValidationInfo) -> tuple[ComponentConfig, ...]:
        if not isinstance(value, list | tuple) or not value:
            raise ValueError(f"received {value!r}, expected a list of at least one {role}")
        nameless = [one for one in value if isinstance(one, Mapping) and "kind" not in one]
        if nameless:
            raise ValueError(f"received {nameless[0]!r}, expected a `kind` that names a {role}, and its settings")
        return tuple(_fill(role, "", one, info) for one in value)

    field = Field(
        default_factory=lambda: tuple({"kind": name} for name in default),
        validate_default=True,
        description=description,
    )
    return Annotated[tuple[SerializeAsAny[ComponentConfig], ...], BeforeValidator(resolve), field]


def _fill(role: str, default: str, value: Any, info: ValidationInfo) -> ComponentConfig:
    """The configuration of the component that a value of a slot stands for. Raises ConfigError, UnknownName, and
    InputMissing where nothing that `auto` may become can run."""
    choice: Choice | None = info.context
    if isinstance(value, ComponentConfig):
        if value.kind != AUTO or choice is None:
            return value
        value = value.kind
    if isinstance(value, str):
        value = {"kind": value}
    if not isinstance(value, Mapping):
        raise ValueError(f"received {value!r}, expected the name of a {role} or a mapping with its settings")
    value = {"kind": default, **value}
    if value["kind"] != AUTO or not auto_order(role):
        return validate(registry().get(role, value["kind"]).Config, value, role, choice)
    if choice is None:
        if len(value) > 1:
            keys = ", ".join(f"{role}.{key}" for key in value if key != "kind")
            raise ConfigError(
                f"received {keys}, and no data is known that decides which {role} 'auto' is: "
                f"name one of {', '.join(auto_order(role))}, or give the data"
            )
        return undecided(role).Config()
    component = choice.take(role, parts_added(info.data.values()))
    try:
        return validate(component.Config, {**value, "kind": component.name}, role, choice)
    except ConfigError as error:
        raise ConfigError(f"{error}; auto took the {role} {component.name!r} here") from None
