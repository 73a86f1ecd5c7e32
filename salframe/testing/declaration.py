"""What every component class declares: name, version, summary, settings."""

from __future__ import annotations

import json

from pydantic import ValidationError

from salframe.framework.component import Component, ComponentConfig
from salframe.framework.components import registry
from salframe.framework.components.identity import identity
from salframe.framework.errors import SalframeError
from salframe.framework.files.hashes import digest
from salframe.testing.asking import ConformanceError, attempt, expect


def check_declaration(component: type[Component]) -> None:
    """What the registry asks of a class, a version that says something, all methods of its role, and a summary."""
    try:
        registry.check_declaration(component, registry.registry().roles)
    except SalframeError as error:
        raise ConformanceError(str(error)) from None
    where = component.__qualname__
    expect(component.version, f"version of {where}", "none", "text that changes whenever the output does")
    abstract = sorted(getattr(component, "__abstractmethods__", ()))
    expect(not abstract, f"methods of {where}", f"no {', no '.join(abstract)}", f"all that a {component.role} has")
    summary = (component.__dict__.get("__doc__") or "").strip()
    expect(summary, f"docstring of {where}", "none", "one whose first line says what the component does")


def check_config(component: type[Component], config: ComponentConfig | None) -> ComponentConfig:
    """The defaults are valid; settings are frozen, strict, survive JSON and have a stable identity. Returns `config` or
    the defaults."""
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
    cache_key = attempt("identity of the settings as JSON", lambda: digest(identity(used)))
    expect(digest(identity(again)) == cache_key, "identity of the settings read from JSON", "another one", "the same")
    return used
