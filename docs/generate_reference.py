"""Write the generated pages of docs/reference from the code: `python docs/generate_reference.py`.

A test fails when they are out of date."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import typer
from salframe_panoseg.detector import PANOSEG

from salframe.cli import app
from salframe.framework.component import Component, ComponentConfig
from salframe.framework.components.presets import names, settings
from salframe.framework.components.registry import registry
from salframe.framework.components.settings import Setting, list_settings

REFERENCE = Path(__file__).with_name("reference")
PACKAGE = "salframe"
"""What else is installed here is documented by whoever provides it."""


PYTHON = {
    "compare": "compare",
    "ablate": "ablate",
    "experiment": "run_experiment",
    "evaluate": "evaluate",
    "report": "write_report",
    "matching": "measure_matching",
    "detection": "measure_detection",
    "fit": "fit_method",
    "sensor": "measure_sensor",
    "build": "build_map",
    "localize": "open_map",
    "ask": "ask",
    "track": "track",
    "show-objects": "show_objects",
    "navigate": "navigate",
    "score": "score",
    "data render": "find_dataset",
    "data import": "import_data",
    "data labels": "list_labels",
    "map build": "build_map",
    "map add": "add_to_map",
    "map remove": "remove_from_map",
    "map merge": "merge_maps",
    "map show": "draw_topology",
    "map route": "find_route",
    "map query": "ask_map",
    "map export": "export_map",
    "weights fetch": "fetch_weights",
}
"""What a command is in Python, by the words that call it."""


def write_cli() -> str:
    """The page of the commands: what `--help` says of each."""
    pages = [
        "# The command line",
        "Generated from `salframe --help` by docs/generate_reference.py.",
        "Exit statuses:",
        "- 0: success\n"
        "- 1: the result is incomplete, for example because a method crashed. Some commands have other "
        "reasons, stated below\n"
        "- 2: an error in the input, which is printed in one line on stderr\n"
        "- 130: interrupted (Ctrl-C)\n"
        "- 143: ended by the signal SIGTERM (`salframe serve`: 0)",
        "These words have the same meaning in all commands:",
        _table(
            ("word", "meaning"),
            [
                ("query", "a panorama, photograph or sequence of views to localize"),
                ("reference frame", "a panorama of the map, with its pose and its place (room)"),
                ("dataset", "reference frames, queries, and the true places and poses of the queries"),
                ("method", "a localizer with its settings, such as `proposed`, the method of this package"),
                ("run", "one evaluation of methods on a dataset. Its results are stored in a folder, the run folder"),
                ("description", "what a method computes from a panorama, such as keypoints or a graph of objects"),
                ("topology", "a graph of positions in rooms and doorways, for routes"),
                ("floor masks", "images of the free floor and the rooms, from above"),
                ("[accepted](../how-to/running-program.md)", "an answer is accepted if its place is certain enough"),
                ("out-of-map", "a query is out-of-map if it was taken at a place that the map does not contain"),
                ("repeatable", "the option can be given several times. `--set` is always repeatable"),
            ],
        ),
    ]
    for path, command in _commands("salframe", typer.main.get_command(app)):
        required = [_usage(parameter) for parameter in command.params if parameter.required]
        optional = [f"[{_usage(part)}]" for part in command.params if _is_argument(part) and not part.required]
        end = "COMMAND ..." if hasattr(command, "commands") else "[OPTIONS]"
        usage = " ".join([path, *required, *optional, end])
        pages += [f"## {path}", _plain(command.help), f"```\n{usage}\n```"]
        if name := PYTHON.get(path.partition(" ")[2]):
            pages.append(f"In Python: [`salframe.{name}`](api.md).")
        if command.params:
            pages.append(
                _table(
                    ("argument or option", "meaning", "default"), [_option(parameter) for parameter in command.params]
                )
            )
    return "\n\n".join(pages) + "\n"


def _commands(path: str, command: Any) -> Iterator[tuple[str, Any]]:
    """A command and those below it, each with the words that call it."""
    yield path, command
    for name, child in getattr(command, "commands", {}).items():
        yield from _commands(f"{path} {name}", child)


def _option(parameter: Any) -> tuple[str, str, str]:
    default = "" if parameter.default in (None, "") or parameter.default is False else f"`{parameter.default}`"
    return (
        ", ".join(f"`{name}`" for name in _spelling(parameter)),
        _plain(parameter.help) + _values(parameter),
        "required" if parameter.required else default,
    )


def _values(parameter: Any) -> str:
    """The values of an option that has a list of them, as a sentence."""
    annotation = parameter.type_descriptor.annotation
    parts = [annotation, *get_args(annotation)]
    values = [f"`{value}`" for part in parts if get_origin(part) is Literal for value in get_args(part)]
    return f". Values: {', '.join(values)}" if values else ""


def _spelling(parameter: Any) -> list[str]:
    """How an argument or option is written, an option's short form or the flag that turns it off last."""
    if _is_argument(parameter):
        return [(parameter.metavar or parameter.name.upper()) + ("..." if parameter.nargs == -1 else "")]
    names = [*parameter.opts, *parameter.secondary_opts]
    return [f"{name} {parameter.metavar}" if parameter.metavar else name for name in names]


def _is_argument(parameter: Any) -> bool:
    return bool(parameter.param_type_name == "argument")


def _usage(parameter: Any) -> str:
    """How an argument or a required option is written in the line of the usage, with a name for its value."""
    spelling = _spelling(parameter)[-1]
    has_value = _is_argument(parameter) or parameter.metavar
    return spelling if has_value else f"{spelling} {parameter.name.upper()}"


def write_component_index() -> str:
    """Return the page that lists the roles and their components."""
    rows: list[tuple[str, ...]] = [
        (f"[{role}]({role}.md)", _summary(role), ", ".join(f"[{c.name}]({role}.md#{c.name})" for c in components))
        for role, components in _components()
    ]
    page = [
        "# Components",
        "A *component* is a class that does one step of the processing, such as a detector. A *role* is the interface "
        "of all components that do the same step. A *preset* is a component with other default settings, under another "
        "name.",
        "`salframe show NAME` prints the settings of a component or preset. `salframe plugins` lists what each "
        "component still requires on your machine, such as a package.",
        "The page of each role states how to choose its components and how to change their settings. The most "
        "important components are the localizers, which are called *methods* on the command line. Most other "
        "components are settings of a localizer:",
        "- If the type of a setting is a role, its value is the name of a component, as in `--set matcher=triplet`. "
        "`--set matcher.kind=triplet` means the same.\n"
        "- The settings of this component follow after a dot, as in `--set matcher.rarity=false`.\n"
        "- A value of the type Noise (simulated errors of a detector) or Posterior (parameters that convert scores to "
        "probabilities) is a mapping, such as {missed: 0.3}.\n"
        "- A value of the type HubName names a model of the Hugging Face Hub: hf:ORG/MODEL[@REVISION].\n"
        "- A value of a type such as tuple[float, ...] is a list in brackets, as in "
        "`--set matcher.ring_edges_m=[1,2,4]`.\n"
        "- If the type ends in null, the value can be null, as in `--set matcher.height_scale_m=null`.",
        _definitions("\n".join(purpose for _, purpose, _ in rows), TERMS, "Terms on this page:"),
        _table(("role", "purpose", "components"), rows),
    ]
    return "\n\n".join(page) + "\n"


def write_role(role: str, components: list[type[Component]]) -> str:
    """Return the page of a role: the summary and the settings of each of its components."""
    rows = {component: _setting_rows(component) for component in components}
    first, *others = rows.values()
    common = [row for row in first if others and all(row in other for other in others)]
    introduction = [
        f"# Components: {role}",
        _summary(role),
        f"Each section describes a *component*, a class for this task. {_usage_of(role)} [Components](index.md) "
        "explains the types of settings.",
    ]
    sections = []
    if common:
        heading = ["## Settings of all components", "All components on this page have these settings."]
        sections.append((heading, _settings(common)))
    for component in components:
        sections.append(_component(component, [row for row in rows[component] if row not in common], bool(common)))
    texts = ["\n".join([*paragraphs, table]) for paragraphs, table in sections]
    page = [*introduction, _definitions("\n".join([_summary(role), *texts]), TERMS, "Terms on this page:")]
    for text, (paragraphs, table) in zip(texts, sections, strict=True):
        page += [*paragraphs, _definitions(text, TABLE_TERMS, "Terms in this table:"), table]
    return "\n\n".join(filter(None, page)) + "\n"


CHOICES = {
    "dataset": "Choose a dataset with `--data NAME`, and change its settings with `--set data.KEY=VALUE`.",
    "importer": "Choose an importer with `salframe data import NAME`, and change its settings with `--set KEY=VALUE`.",
    "localizer": "On the command line, a localizer is called a method. Choose methods with `--methods NAME,NAME`, and "
    "change a setting with `--set KEY=VALUE`.",
    "evidence": "Choose the evidence of the method `proposed` with `--set evidence=[NAME,NAME]`.",
    "range-model": "Choose the range model of a localizer with `--set range.kind=NAME`, and change its settings with "
    "`--set range.KEY=VALUE`.",
    "scene-index": "`--set scene_index.kind=NAME` chooses the index with which `proposed` selects places. "
    "`--set matcher.scene_index.kind=NAME` chooses the index of the matcher, which compares the query with "
    "single panoramas. `saliency-graph` and its variants, such as `usg`, have only the index of the matcher. "
    "`proposed` has both, because it also uses the matcher: the matcher computes the "
    "[evidence](../../explanation/place-evidence.md) `panorama`, which is one part of the score of a place.",
    "feature-matcher": "Choose the feature matcher of the localizer `keypoints` with `--set features.kind=NAME`, and "
    "change its settings with `--set features.KEY=VALUE`.",
    "image-network": "Choose the image network of the localizer `image` with `--set network.kind=NAME`, and change its "
    "settings with `--set network.KEY=VALUE`.",
    "detection-decoder": "Choose the decoder of the detector `onnx` with `--set detector.decoder=NAME`.",
    "planner": "Choose a planner with `--planner NAME`.",
    "tracker": "Choose a tracker with `salframe track --tracker NAME`.",
    "scorer": "Choose a scorer with `salframe score NAME`.",
    "engine": "Choose an engine with `--engine NAME`, and change its settings with `--set engine.KEY=VALUE`.",
}
"""How to choose a component on the command line, by role. Other roles are settings of a localizer."""


def _usage_of(role: str) -> str:
    """Return a sentence on how to choose a component of a role, and how to change its settings."""
    return CHOICES.get(
        role,
        f"Choose the {role} of a localizer with `--set {role}.kind=NAME`, and change its settings with "
        f"`--set {role}.KEY=VALUE`.",
    )


TERMS = {
    r"\bquer(y|ies)\b": "*query*: what is to be localized: a panorama, or images of an ordinary camera (*views*)",
    r"reference frame": "*reference frame*: a panorama of the map, with its pose and its place",
    r"\bplaces?\b": "*place*: a room or a doorway",
    r"out-of-map": "*out-of-map*: the query was taken at a place that the map does not contain",
    r"graphs? of (a|the) (map|query)|saliency graph": "*graph*, or *saliency graph*: the objects of a panorama, as "
    "nodes. Edges connect objects that are close to each other",
    r"floor mask": "*floor masks*: images of the free floor and the rooms, from above",
    r"the paper\b": "*the paper*: the [paper](../../explanation/paper.md#the-preset-paper) that introduced 360-degree "
    "saliency graphs",
    r"saliency": "*saliency* of an object: how much the object stands out. By default, its volume divided by the "
    "volume of all objects of the panorama",
    r"viewpoint": "*viewpoint*: a recorded camera position",
    r"\bregion": "*region*: a room in the annotations of a building",
    r"topological map": "*topological map*: a graph of positions in rooms and doorways",
    r"\branges?\b(?! image)": "*range* of a point or an object: its distance from the camera",
    r"odometry": "*odometry*: a measurement of the motion of the camera",
    r"\bbearings?\b": "*bearing* of an object: its direction from the camera",
    r"outline": "*outline* of free space: the horizontal distance from the camera to the walls, in 72 directions",
    r"log likelihood ratio": "*log likelihood ratio* of an observation: ln(p / q). p is the probability of the "
    "observation in the candidate place, and q is its probability elsewhere",
}
"""Definitions of terms, by a regular expression for the texts that need them. A page of components begins with those
that it needs."""
CONSTANTS = ("`rates.", "`weights.", "`likelihood.", "`posterior.temperature", "`posterior.head.")
"""How the names of settings begin that are constants of a method. They have a table of their own."""
TABLE_TERMS = {
    r"log-odds of detection": "*log-odds of detection*: ln(p / (1 - p)). p is the probability that the query shows an "
    "object of the map",
    r"clutter": "*clutter*: objects of a query that are not in the map",
    r"contrast": "*contrast* of an answer: the score of the first place minus the mean score of the next five places, "
    "divided by `posterior.temperature`",
    r"posterior\.head\.": "*head* (`posterior.head`): the model that converts the contrast of an answer to the "
    "probability that the query is in the map",
}
"""As TERMS, for terms in the table of a single component. The definitions are in front of this table."""


def _definitions(text: str, terms: Mapping[str, str], heading: str) -> str:
    """Return a list of definitions for those of the terms that a text uses; "" if it uses none."""
    used = [f"- {definition}." for term, definition in terms.items() if re.search(term, text, re.IGNORECASE)]
    return "\n".join([f"{heading}\n", *used]) if used else ""


def _components() -> Iterator[tuple[str, list[type[Component]]]]:
    """Yield each role that has components in this package, with these components."""
    for role in registry().roles:
        if components := [c for c, package in registry() if c.role == role and package == PACKAGE]:
            yield role, components


def _summary(role: str) -> str:
    return (registry().roles[role].__doc__ or "").strip().partition("\n")[0]


def _component(component: type[Component], rows: list[tuple[str, ...]], has_common: bool) -> tuple[list[str], str]:
    """Return the paragraphs of a component, and the table of its settings without those of all components (`rows`)."""
    paragraphs = [f"## {component.name}", *_paragraphs(component)]
    presets = [
        name
        for name in names(component.role)
        if name != component.name and settings(component.role, name)["kind"] == component.name
    ]
    if presets:
        paragraphs.append(
            f"Presets (this component with other settings): {', '.join(f'`{name}`' for name in presets)}."
        )
    constants = [row for row in rows if row[0].startswith(CONSTANTS)]
    if constants:
        rows = [row for row in rows if row not in constants]
        paragraphs += [_settings(rows), "The remaining settings are constants, which you rarely need to change."]
    nothing = "No other settings." if has_common else "No settings."
    return paragraphs, _settings(constants or rows) if rows else nothing


def _paragraphs(component: type[Component]) -> list[str]:
    """Return the paragraphs of a docstring, with one line per paragraph. Code blocks (indented) and lists do not
    change."""
    paragraphs = inspect.cleandoc(component.__doc__ or "").split("\n\n")
    return [text if text.startswith(("    ", "- ")) else " ".join(text.split()) for text in paragraphs]


def _settings(rows: list[tuple[str, ...]]) -> str:
    return _table(("setting", "meaning", "default", "type"), rows)


def _setting_rows(component: type[Component]) -> list[tuple[str, ...]]:
    return [(f"`{s.key}`", s.help, _value(s.value), s.type) for s in _component_settings(component.Config())]


def _component_settings(config: ComponentConfig) -> Iterator[Setting]:
    """The settings of a component without those of the components in its slots."""
    settings = list(list_settings(config))
    roles = {s.key: s.type.partition(",")[0].removesuffix(" | null") for s in settings}
    slots = tuple(f"{key}{end}" for key, role in roles.items() for end in ".[" if role in registry().roles)
    return (setting for setting in settings if not setting.key.startswith(slots))


def _value(value: Any) -> str:
    """Return a value as in YAML. A number is rounded to 4 significant digits."""
    value = float(f"{value:.4g}") if isinstance(value, float) else value
    return f"`{value if isinstance(value, str) else json.dumps(value)}`"


def _plain(text: str | None) -> str:
    return " ".join((text or "").split())


def _table(headings: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [headings, ("---",) * len(headings), *(tuple(cell.replace("|", "\\|") for cell in row) for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def write_credits() -> str:
    """Return the page that credits the furniture models in the training pictures of `panoseg`."""
    credits = json.loads(PANOSEG.paths()[1].read_text())["credits"]
    page = [
        "# Furniture models",
        "The [detector `panoseg`](../how-to/panoseg.md) was trained on pictures of rendered rooms. The furniture in "
        f"these rooms comes from {len(credits)} models of the furniture libraries of "
        "[Sweet Home 3D](https://www.sweethome3d.com). The models were stretched before they were rendered. They are "
        "not part of salframe. docs/generate_reference.py generates this page from the model card of `panoseg`. The "
        "name of a model is LIBRARY#MODEL.",
        _table(
            ("model", "made by", "licence"),
            [(credit["name"], credit["creator"], credit["licence"]) for credit in credits],
        ),
    ]
    return "\n\n".join(page) + "\n"


PAGES: dict[str, Callable[[], str]] = {
    "cli.md": write_cli,
    "components/index.md": write_component_index,
    **{f"components/{role}.md": partial(write_role, role, components) for role, components in _components()},
    "furniture-credits.md": write_credits,
}

if __name__ == "__main__":
    for name, write in PAGES.items():
        page = REFERENCE / name
        page.parent.mkdir(exist_ok=True)
        page.write_text(write())
