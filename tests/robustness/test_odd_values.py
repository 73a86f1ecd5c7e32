"""Odd values of every option of every command, and of every setting of every component, get one clear line."""

from __future__ import annotations

import multiprocessing
import os
import re
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run
from tiny_folder import write_tiny_folder

sys.path.insert(0, str(Path(__file__).parent))

from commands import UNFORESEEN, compute_once, write_place
from odd_values import ODD, list_keys, list_parameters
from sound_copy import restore

from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.config import parse_override
from salframe.framework.errors import SalframeError
from salframe.framework.overrides import nest

MAX_LINE = 12_000
RUN = {"data": "./data", "engine": "inline"}
MAP = {"map": "map"}
WAYS = {"map": "ways"}
VIEWPOINTS = {"data": "matterport-annotations", "data_dir": "viewpoints"}
ROUTE = WAYS | {"start": "a", "goal": "c"}
BASE: dict[str, dict[str, str]] = {
    "compare": RUN | {"methods": "objects"},
    "ablate": RUN | {"file": "study.yaml"},
    "evaluate": {"run": "RUN"},
    "report": {"runs": "RUN", "output": "page.html"},
    "experiment": {"name": "experiment.yaml", "engine": "inline"},
    "matching": RUN | {"methods": "proposed"},
    "detection": RUN | {"detectors": "annotations"},
    "navigate": VIEWPOINTS | {"methods": "proposed", "episodes": "1", "engine": "inline"},
    "score": {"task": "reverie", "file": "reverie/answers.json", "data": "reverie"},
    "build": RUN | {"output": "built", "method": "objects"},
    "localize": MAP | {"range_image": "data/frames/kitchen-query.range.png"},
    "ask": MAP | {"text": "two beds left of a lamp"},
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
    "map calibrate": MAP,
    "map remove": MAP | {"places": "kitchen"},
    "map merge": MAP | {"others": "map"},
    "map connect": WAYS | {"start": "a", "end": "c", "kind": "lift", "length": "4"},
    "map show": WAYS | {"output": "ways.png"},
    "map route": ROUTE,
    "map query": {"map": "building", "frame": "kitchen-query", "data": "./data", "goal": "bedroom"},
    "map export": WAYS | {"file": "ways.geojson"},
    "track": MAP | {"recording": "./data"},
    "serve": MAP | {"host": "192.0.2.1", "port": "65536"},  # whichever is replaced, the other prevents the start
    "data list": {},
    "data import": {"format": "pictures", "source": "data/frames", "output": "imported"},
    "data labels": {"data": "./data"},
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
        patch.setattr("salframe.testing.rooms.HEIGHT_PX", 48)  # the calls are many, and about options
        patch.setenv("SALFRAME_CACHE", str(root / "cache"))
        write_place(root / "place", write_tiny_folder(root / "data"))
        yield root


def list_calls() -> Iterator[tuple[str, ...]]:
    """Yield the words of a command for each of its parameters with each odd value; a setting gets it as data.seed."""
    for command, parameters in list_parameters():
        for parameter in parameters:
            values = [f"data.query_fov_deg={value}" for value in ODD] if parameter.name == "overrides" else ODD
            for value in values:
                values = BASE[command] | {parameter.name: value}
                options = [one for one in parameters if one.param_type_name == "option" and one.name in values]
                arguments = [one for one in parameters if one.param_type_name == "argument" and one.name in values]
                words = [word for one in options for word in (one.opts[0], values[one.name])]
                yield (*command.split(), *words, *(values[one.name] for one in arguments))


def check_call(place: Path, words: tuple[str, ...]) -> str | None:
    """Return what is wrong with the output of a command in a copy of the sound files; None where nothing is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(restore(place / "place", place / f"walk-{os.getpid()}"))
        try:
            result = run(*(str(next(Path().glob("runs/sound-*"))) if word == "RUN" else word for word in words))
        except BaseException as error:
            return f"{words}: {type(error).__name__}: {error}"
    text = result.out + result.err
    *notes, last = result.err.splitlines() or [""]
    one_line = result.code != 2 or (last.startswith("error: ") and len(notes) < 3 and len(last) < MAX_LINE)
    in_table = result.code != 1 or bool(result.out) or last.startswith("error: ")  # show-objects has a line per image
    if result.code in (0, 1, 2) and one_line and in_table and not re.search("Traceback", text):
        return None if not UNFORESEEN.search(text) else f"{words}: {text[-600:]}"
    return f"{words}: exit status {result.code}: {text[-600:]}"


def walk(place: Path, calls: list[tuple[str, ...]]) -> list[str]:
    """Return the faults of calls, made with a cache of their own."""
    os.environ["SALFRAME_CACHE"] = str(place / f"cache-{os.getpid()}")
    compute_once()
    return [fault for words in calls if (fault := check_call(place, words)) is not None]


def check_options(place: Path, calls: list[tuple[str, ...]]) -> None:
    """Make the calls in a process per core."""
    count = os.cpu_count() or 1
    with ProcessPoolExecutor(count, multiprocessing.get_context("fork")) as pool:
        parts = [sorted(calls)[number::count] for number in range(count)]
        faults = [fault for part in pool.map(partial(walk, place), parts) for fault in part]
    print(f"{len(calls)} calls of {len(BASE)} commands: {len(faults)} faults")
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
    print(f"{len(settings)} settings of {len(list(registry()))} components: {len(faults)} faults")
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
