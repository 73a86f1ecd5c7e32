"""Rules of the declaration of a component class: name, version, summary, settings."""

from __future__ import annotations

import json

from pydantic import ValidationError

from salframe.framework.component import Component, ComponentConfig
from salframe.framework.components import registry
from salframe.framework.components.identity import identity
from salframe.framework.errors import SalframeError
from salframe.framework.files.hashes import digest
from salframe.testing.expectations import ConformanceError, attempt, expect


def check_declaration(component: type[Component]) -> None:
    """Check that a class can be registered, and has a version, all methods of its role and a summary."""
    try:
        registry.check_declaration(component, registry.registry().roles)
    except SalframeError as error:
        raise ConformanceError(str(error)) from None
    where = component.__qualname__
    expect(component.version, f"version of {where}", "none", "a string that changes whenever the output changes")
    abstract = sorted(getattr(component, "__abstractmethods__", ()))
    expect(
        not abstract,
        f"methods of {where}",
        f"no {', no '.join(abstract)}",
        f"all abstract methods of the role {component.role}",
    )
    summary = (component.__dict__.get("__doc__") or "").strip()
    expect(summary, f"docstring of {where}", "none", "a docstring whose first line says what the component does")


def check_config(component: type[Component], config: ComponentConfig | None) -> ComponentConfig:
    """Check that the defaults are valid and that settings are frozen, strict and serializable, with a stable identity.

    Returns:
        `config`, or the defaults if it is None.
    """
    defaults = attempt("Config()", component.Config)
    used = defaults if config is None else config
    expect(isinstance(used, component.Config), "config", type(used).__qualname__, component.Config.__qualname__)
    expect(
        used.model_config.get("frozen"),
        "Config",
        "settings that can be changed",
        "frozen settings: do not override model_config",
    )
    try:
        component.Config.model_validate({"no-such-key": 0})
    except ValidationError:
        pass
    else:
        expect(False, "Config", "no error for an unknown key", 'extra="forbid": do not override model_config')
    again = attempt(
        "Config read from its own JSON", component.Config.model_validate, json.loads(used.model_dump_json())
    )
    expect(again == used, "Config read from its own JSON", again, repr(used))
    cache_key = attempt("identity of the settings as JSON", lambda: digest(identity(used)))
    expect(
        digest(identity(again)) == cache_key,
        "identity of the settings read from JSON",
        "another identity",
        "the same identity",
    )
    return used
