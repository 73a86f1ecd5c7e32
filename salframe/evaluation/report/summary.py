"""The summary at the top of an HTML page: the requests, versions and notes of its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from salframe.evaluation.report.arms import Arm
from salframe.evaluation.report.view import RunView
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import changed_settings, flatten, shorten_value, spell_value
from salframe.framework.errors import SalframeError
from salframe.framework.validation import validate


def describe_run(view: RunView[Any, Any]) -> dict[str, Any]:
    """Return a description of a run for JSON. Its keys are "name", "task", "folder", "data" (the dataset with its
    changed settings), "methods" (pairs of a label and the changed settings), "more" (pairs of a task parameter and its
    value) and "versions" (pairs of a package and its version)."""
    request, environment = view.result.request, view.result.environment
    parameters = {
        key: value for key, value in request["task"].items() if key not in ("name", "version", "identity", "seed")
    }
    role = view.result.kind.role
    versions = {
        "python": environment["python"],
        **environment["packages"],
        "data fingerprint": environment["dataset_fingerprint"],
        **{key: str(value) for key, value in environment.get("machine", {}).items()},
    }
    return {
        "name": view.name,
        "task": view.result.task,
        "folder": str(view.result.run),
        "data": describe_component("dataset", view.data),
        "methods": [[label, describe_component(role, settings)] for label, settings in request["methods"].items()],
        "more": [[key, spell_value(value)] for key, value in {**parameters, "seed": request["seed"]}.items()],
        "versions": list(versions.items()),
    }


def describe_component(role: str, settings: Mapping[str, Any]) -> str:
    """Return the name of a component and its changed settings. If the component is unknown, return all settings."""
    try:
        changed = dict(changed_settings(validate(registry().get(role, settings["kind"]).Config, settings, role)))
    except (SalframeError, KeyError):
        changed = flatten({key: value for key, value in settings.items() if key != "kind"})
    parts = [f"{key}={shorten_value(value)}" for key, value in changed.items()]
    return f"{settings.get('kind')}: {', '.join(parts)}" if parts else str(settings.get("kind"))


def list_notes(views: Sequence[RunView[Any, Any]], arms: Sequence[Arm]) -> list[str]:
    """Return notes for an HTML page, each once: the notes of the runs and, for each arm (a method with its settings),
    the remark in its table row and the number of its failures of each kind."""
    notes = [note for view in views for note in view.result.notes]
    for arm in arms:
        failures = ", ".join(f"{count} {status}" for status, count in arm.row.status.items() if status != "ok")
        if remarks := "; ".join(part for part in (arm.row.remark, failures) if part):
            notes.append(f"{arm.name}: {remarks}")
    return list(dict.fromkeys(notes))
