"""The changed settings of a method: settings that differ from the preset that its label names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from salframe.framework.component import ComponentConfig
from salframe.framework.components.auto import Choice
from salframe.framework.components.presets import SUFFIXES, configure, names, settings
from salframe.framework.components.settings import changed_settings, shorten_value
from salframe.framework.errors import SalframeError

MAX_CHANGES = 4
"""Maximum number of changed settings beside the label of a method."""


def find_changes(
    role: str,
    label: str,
    method: str,
    variant_settings: Mapping[str, Mapping[str, Any]],
    config: ComponentConfig,
    choice: Choice,
) -> tuple[str, ...]:
    """Return the settings of a method that differ from the settings that its label implies, "key=value" each.

    A label that begins with the name of a preset or component implies the settings of that preset or component. Any
    other label implies the settings of the preset or component that runs. If a YAML file runs, such a label implies
    the defaults of the component in the key `kind` of the file, and the result includes `kind`. Settings of a
    variant are left out if the label shows them as "key=value", or if a user has chosen the label.

    Args:
        role: Role of the method.
        label: Label of the method in the run.
        method: The preset, component or YAML file that runs.
        variant_settings: Settings of the variant: a nested mapping for each dotted key.
        config: Configuration of the method.
        choice: Selects the component of each setting with the value `auto`.
    """
    base = label.partition("[")[0]
    known_names = names(role)
    is_known = base in known_names
    standard = base if is_known else method
    is_chosen = not (is_known or standard.endswith(SUFFIXES))
    overrides = [one for key, one in variant_settings.items() if is_chosen or f"{key}=" in label]
    try:
        content = {"kind": config.kind} if standard.endswith(SUFFIXES) else settings(role, standard)
        unchanged: ComponentConfig | None = configure(role, standard, content, overrides, choice)
    except SalframeError:  # a slot that no component can fill
        unchanged = None
    kind = [] if type(unchanged) is type(config) and not standard.endswith(SUFFIXES) else [("kind", config.kind)]
    return tuple(f"{key}={shorten_value(value)}" for key, value in [*kind, *changed_settings(config, unchanged)])


def base_of(label: str) -> str:
    """Return the label of a method without the settings in brackets."""
    name, _, rest = label.partition("[")
    return name + rest.rpartition("]")[2]


def with_changes(label: str, changes: Sequence[str], substitution: str | None = None) -> str:
    """Return the label of a method, at most MAX_CHANGES of its changed settings in brackets, and in parentheses the
    method that it replaces, such as "loftr-compact[top_k=5] (for loftr)"."""
    more = len(changes) - MAX_CHANGES
    shown = [*changes[:MAX_CHANGES], *([f"{more} more"] if more > 0 else [])]
    settings = f"[{','.join(shown)}]" if shown else ""
    return f"{label}{settings}{f' ({substitution})' if substitution else ''}"


def hidden_in(changes: Sequence[str], shown: Mapping[str, Any]) -> list[str]:
    """Return the changed settings ("key=value") whose key is not in `shown`. A suffix ".kind" of the keys in `shown` is
    ignored."""
    keys = {key.removesuffix(".kind") for key in shown}
    return [change for change in changes if change.partition("=")[0] not in keys]
