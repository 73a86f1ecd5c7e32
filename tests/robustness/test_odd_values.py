"""Odd values of every option of every command, and of every setting of every component, get one clear line."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run
from tiny_folder import write_tiny_folder

sys.path.insert(0, str(Path(__file__).parent))

from commands import UNFORESEEN, write_place
from odd_values import ODD, list_keys, list_parameters
from readers import write_reverie

from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.config import nest, parse_override
from salframe.framework.errors import SalframeError

MAX_LINE = 12_000
RUN = {"data": "./data", "engine": "inline"}
MAP = {"map": "map"}
WAYS = {"map": "ways"}
ROUTE = WAYS | {"start": "a", "goal": "c"}
BASE: dict[str, dict[str, str]] = {
    "compare": RUN | {"methods": "objects"},
    "ablate": RUN | {"file": "study.yaml"},
    "evaluate": {"run": "RUN"},
    "report": {"runs": "RUN", "output": "page.html"},
    "experiment": {},
    "matching": RUN | {"methods": "proposed"},
    "detection": RUN | {"detectors": "annotations"},
    "navigate": RUN | {"methods": "objects", "episodes": "1"},
    "score": {"task": "reverie", "file": "reverie/answers.json", "data": "reverie"},
    "build": RUN | {"output": "built", "method": "objects"},
    "localize": MAP | {"range_image": "data/frames/kitchen-query.range.png"},
    "show-objects": {"images": "data/frames/kitchen-map.rgb.png", "detector": "annotations", "output": "shown"},
    "sensor": RUN | {"detector": "annotations"},
    "fit": {"method": "objects", "output": "fitted.yaml", "data": "./data"},
    "methods": {},
    "plugins": {},
    "show": {"name": "objects"},
    "doctor": {},
    "docs": {"page": "maps"},
    "map build": RUN | {"output": "built", "method": "objects"},
    "map add": RUN | MAP,
    "map remove": MAP | {"places": "kitchen"},
    "map merge": MAP | {"others": "map"},
    "map show": WAYS | {"output": "ways.png"},
    "map route": ROUTE,
    "map query": MAP | {"frame": "kitchen-query", "data": "./data"},
    "map export": WAYS | {"file": "ways.geojson"},
    "data list": {},
    "data info": {"data": "./data"},
    "data render": {"data": "./data", "engine": "inline"},
    "cache info": {},
    "cache clear": {},
    "weights list": {},
    "weights fetch": {"name": "no-such"},
    "weights where": {"name": "no-such"},
}
"""Sound values of the parameters of each command."""


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Iterator[Path]:
    root = tmp_path_factory.mktemp("odd")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SALFRAME_CACHE", str(root / "cache"))
        write_place(root / "place", write_tiny_folder(root / "data"))
        write_reverie(root / "place" / "reverie")
        yield root


def list_calls() -> Iterator[tuple[str, ...]]:
    """Yield the words of a command for each of its parameters with each odd value; a setting gets it as data.seed."""
    for command, parameters in list_parameters():
        for parameter in parameters:
            values = [f"data.query_fov_deg={value}" for value in ODD] if parameter.name == "overrides" else ODD
            for value in values:
                given = BASE[command] | {parameter.name: value}
                options = [one for one in parameters if one.param_type_name == "option" and one.name in given]
                arguments = [one for one in parameters if one.param_type_name == "argument" and one.name in given]
                words = [word for one in options for word in (one.opts[0], given[one.name])]
                yield (*command.split(), *words, *(given[one.name] for one in arguments))


def check_call(place: Path, words: tuple[str, ...]) -> str | None:
    """Return what is wrong with what a command says in a fresh place; None where nothing is."""
    fresh = place / "fresh"
    shutil.rmtree(fresh, ignore_errors=True)
    shutil.copytree(place / "place", fresh)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(fresh)
        try:
            done = run(*(str(next(fresh.glob("runs/sound-*"))) if word == "RUN" else word for word in words))
        except BaseException as error:
            return f"{words}: {type(error).__name__}: {error}"
    said = done.out + done.err
    *notes, last = done.err.splitlines() or [""]
    one_line = done.code != 2 or (last.startswith("error: ") and len(notes) < 3 and len(last) < MAX_LINE)
    told_in_table = done.code != 1 or bool(done.out) or last.startswith("error: ")  # show-objects has a line per image
    if done.code in (0, 1, 2) and one_line and told_in_table and not re.search("Traceback", said):
        return None if not UNFORESEEN.search(said) else f"{words}: {said[-600:]}"
    return f"{words}: exit status {done.code}: {said[-600:]}"


def check_options(place: Path, calls: list[tuple[str, ...]]) -> None:
    faults = [fault for words in calls if (fault := check_call(place, words)) is not None]
    assert not faults, f"{len(faults)} of {len(calls)}:\n" + "\n".join(faults[:60])


def list_settings() -> list[tuple[Any, str, str]]:
    """Return a component, a key and an odd value of it, for each of them."""
    return [
        (component, key, value) for component, _ in registry() for key in list_keys(component.Config) for value in ODD
    ]


def check_settings(settings: list[tuple[Any, str, str]]) -> None:
    faults = []
    for component, key, value in settings:
        case = f"{component.role} {component.name}: {key}={value[:60]!r}"
        try:
            path, content = parse_override(f"{key}={value}")
            config = configure(component.role, component.name, {"kind": component.name}, [nest(path, content)])
            config.model_dump(mode="json")
        except SalframeError as error:
            if "\n" in str(error) or len(str(error)) > MAX_LINE:
                faults.append(f"{case}: {error}")
        except BaseException as error:
            faults.append(f"{case}: {type(error).__name__}: {error}")
    assert not faults, f"{len(faults)} of {len(settings)}:\n" + "\n".join(faults[:60])


def sample(cases: list[Any], number: int) -> list[Any]:
    return [cases[index] for index in np.random.default_rng(39).permutation(len(cases))[:number]]


def test_every_command_has_sound_values():
    assert BASE.keys() == {command for command, _ in list_parameters()}


def test_odd_values_of_options(place):
    check_options(place, sample(list(list_calls()), 100))


def test_odd_values_of_settings():
    check_settings(sample(list_settings(), 200))


@pytest.mark.slow
def test_all_odd_values_of_options(place):
    check_options(place, list(list_calls()))


@pytest.mark.slow
def test_all_odd_values_of_settings():
    check_settings(list_settings())
