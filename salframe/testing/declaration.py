"""What every component class declares: name, version, summary, settings."""

from __future__ import annotations

import json
import re

from pydantic import ValidationError

from salframe.framework.component import Component
from salframe.framework.config import ComponentConfig
from salframe.framework.identity import digest, identity
from salframe.framework.registry import registry
from salframe.testing.asking import attempt, expect


def check_declaration(component: type[Component]) -> None:
    """Role, name, version and summary are there."""
    roles = registry().roles
    is_component = isinstance(component, type) and issubclass(component, Component)
    expect(
        is_component,
        "check_component",
        repr(component),
        f"a subclass of {', '.join(role.__name__ for role in roles.values())}",
    )
    where = component.__qualname__
    expect(
        getattr(component, "role", None) in roles,
        f"role of {where}",
        getattr(component, "role", None),
        f"one of {', '.join(roles)}",
    )
    name, version = getattr(component, "name", None), getattr(component, "version", None)
    is_kebab = isinstance(name, str) and re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", name) is not None
    expect(is_kebab, f"name of {where}", repr(name), "words of small letters and digits, joined by hyphens")
    expect(
        isinstance(version, str) and version,
        f"version of {where}",
        repr(version),
        "text that changes whenever the output does",
    )
    abstract = sorted(getattr(component, "__abstractmethods__", ()))
    expect(not abstract, f"methods of {where}", f"no {', no '.join(abstract)}", f"all that a {component.role} has")
    summary = (component.__dict__.get("__doc__") or "").strip()
    expect(summary, f"docstring of {where}", "none", "one whose first line says what the component does")


def check_config(component: type[Component], config: ComponentConfig | None) -> ComponentConfig:
    """The defaults are valid; settings are frozen, strict, survive JSON and have a stable identity. Returns `config` or
    the defaults."""
    expect(issubclass(component.Config, ComponentConfig), "Config", component.Config, "a subclass of ComponentConfig")
    defaults = attempt("Config()", component.Config)
    used = defaults if config is None else config
    expect(isinstance(used, component.Config), "config", type(used).__qualname__, component.Config.__qualname__)
    expect(
        used.model_config.get("frozen"),
        "Config",
        "settings that can be changed",
        "frozen ones: leave model_config as it is",
    )
    try:
        component.Config.model_validate({"no-such-key": 0})
    except ValidationError:
        pass
    else:
        expect(
            False, "Config", "a key that it does not have, and took it", 'extra="forbid": leave model_config as it is'
        )
    again = attempt(
        "Config read from its own JSON", component.Config.model_validate, json.loads(used.model_dump_json())
    )
    expect(again == used, "Config read from its own JSON", again, repr(used))
    known_by = attempt("identity of the settings as JSON", lambda: digest(identity(used)))
    expect(digest(identity(again)) == known_by, "identity of the settings read from JSON", "another one", "the same")
    return used
