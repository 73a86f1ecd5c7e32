"""Config fields that hold a component: filled by name, from whatever plugins are installed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, SerializeAsAny

from salframe.framework.config import ROLE, ComponentConfig, validate
from salframe.framework.defaults import default_of
from salframe.framework.registry import registry


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
    registry and validates with that component's own Config. Without a `default`, that of configs/defaults.yaml for the
    role; `match_only` as in the function of that name. `optional`: it may hold None too, and does unless it is set.
    """

    def kind() -> str:
        return default_of(role) if default is None else default

    def resolve(value: Any) -> ComponentConfig | None:
        if isinstance(value, ComponentConfig) or (optional and value is None):
            return value
        if isinstance(value, str):
            value = {"kind": value}
        if not isinstance(value, Mapping):
            raise ValueError(f"received {value!r}, expected the name of a {role} or a mapping with its settings")
        return validate(registry().get(role, value.get("kind", kind())).Config, value, role)

    extra: Any = {ROLE: role, **({"match_only": True} if match_only else {})}
    field = Field(
        default_factory=lambda: None if optional else {"kind": kind()},
        validate_default=True,
        description=description,
        json_schema_extra=extra,
    )
    held: Any = SerializeAsAny[ComponentConfig]
    return Annotated[held | None if optional else held, BeforeValidator(resolve), field]
