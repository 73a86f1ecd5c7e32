"""Measuring a detector against the annotations of whole data sets, as a sensor model."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.sensor_fit import Look, Observations, fit_sensor, observe
from salframe.evaluation.task import check_needs
from salframe.framework.cache import Cache
from salframe.framework.config import ComponentConfig, parse_override
from salframe.framework.defaults import default_of
from salframe.framework.errors import FRAME_ERRORS, ConfigError, DataError, InputMissing, InvalidAnswer
from salframe.framework.files import write_json
from salframe.framework.identity import identity
from salframe.framework.installation import installed_version
from salframe.framework.presets import configure_default, nest_for
from salframe.framework.registry import registry
from salframe.graphs.annotated import annotated_objects, as_detections
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.sensor import SensorModel
from salframe.graphs.sightings import Sightings, sightings
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import MapFrame, QueryFrame
from salframe.panoramas.opening import Progress, configure_dataset, open_dataset

VERSION = 1
"""Of what is kept of a panorama in the cache."""
APPARENT_DEG, RANGES_M, HIDDEN = (2, 4, 8, 16, 32), (2, 4, 6, 10), (0.1, 0.3, 0.6)
"""Where the lines of the tables part: diameter of the disc of an object's solid angle, range, hidden share."""
COMMONEST = 10
"""So many labels have a line of their own."""
PARTS = ("labels", "scores", "centroid_m", "size_m", "yaw_rad", "bearing", "solid_angle_sr")


@dataclass(frozen=True)
class FoundLine:
    """Objects that are alike: how many, and the shares of them that were found, that the model says, and that were
    found by a right label; None of none."""

    by: str
    objects: int
    found: float | None
    modelled: float | None
    right: float | None


@dataclass(frozen=True, eq=False)
class SensorMeasurement:
    """A sensor model, the tables that show how well it fits, and what was left out, a line each."""

    sensor: SensorModel
    lines: tuple[FoundLine, ...]
    notes: tuple[str, ...] = ()

    def write(self, path: str | Path) -> None:
        """Write the sensor model as JSON; of one measurement always the same."""
        write_json(Path(path), self.sensor.model_dump(mode="json"))

    def to_json(self) -> dict[str, Any]:
        return {
            "sensor": self.sensor.model_dump(mode="json"),
            "lines": [asdict(line) for line in self.lines],
            "notes": list(self.notes),
        }


def measure_sensor(
    detector: str,
    data: Sequence[str] = (),
    data_dir: str | Path | None = None,
    settings: Sequence[str] = (),
    seeds: Sequence[int] = (),
    *,
    progress: Progress | None = None,
) -> SensorMeasurement:
    """Run a detector on all panoramas of data sets, mapping frames and queries, and measure it by their annotations.

    data: presets, data sets, YAML files or folders, the default one where there is none; settings: "data.KEY=value"
    and "detector.KEY=value"; seeds: of the data sets, one after the other. What is measured of a panorama is kept in
    the cache. Raises SalframeError on names and settings that are wrong, InputMissing where the data lack annotations,
    range or what the detector needs, DataError where no panorama can be used.
    """
    given = nest_for(map(parse_override, settings), ("data", "detector"))
    config = configure_default("detector", detector, given["detector"])
    config.component.check(config)
    sets = _configure(data or (default_of("data"),), data_dir, given["data"], seeds)
    model: Detector = registry().build("detector", config)
    looks: list[Look] = []
    failures: list[str] = []
    for name, each in sets.items():
        dataset = open_dataset(each, progress and partial(progress, f"{name}: prepared"))
        if absent := {"annotations", "range"} - dataset.provides:
            words = " and ".join(sorted(absent))
            raise InputMissing(f"a sensor is measured by annotations and range, and {name} does not have {words}")
        check_needs(model, dataset)
        for look in _look_at(model, config, dataset, progress and partial(progress, name)):
            (failures if isinstance(look, str) else looks).append(look)  # type: ignore[arg-type]
    if not looks:
        raise DataError(f"no panorama of {', '.join(sets)} can be used; the first: {(*failures, 'there is none')[0]}")
    seen = observe(looks)
    provenance = {
        "salframe": installed_version("salframe"),
        "detector": identity(config),
        "data": {name: identity(each) for name, each in sets.items()},
    }
    sensor = fit_sensor(seen, provenance)
    notes = (f"{len(failures)} panorama(s) were left out, the first: {failures[0]}",) if failures else ()
    return SensorMeasurement(sensor, tuple(_tabulate(seen, sensor)), notes)


def _configure(
    data: Sequence[str], data_dir: str | Path | None, given: Sequence[Mapping[str, Any]], seeds: Sequence[int]
) -> dict[str, ComponentConfig]:
    """The data sets by what tables call them."""
    sets: dict[str, ComponentConfig] = {}
    for one in data:
        for seed in seeds or (None,):
            seeded = [] if seed is None else [{"seed": seed}]
            name, config = configure_dataset(one, data_dir, [*given, *seeded])
            name = name if seed is None else f"{name} seed {seed}"
            if name in sets:
                raise ConfigError(f"received the data {name!r} twice, expected each once")
            sets[name] = config
    return sets


def _look_at(detector: Detector, config: ComponentConfig, dataset: Dataset, progress: Any) -> Iterator[Look | str]:
    """What each panorama shows and what the detector finds there; in a line why it cannot be used."""
    frames: dict[str, MapFrame | QueryFrame] = {}
    for fold in dataset.folds():
        frames.update((frame.id, frame) for frame in fold.mapping)
        frames.update((query.id, query) for query in fold.queries)
    cache, known_by = Cache(), identity(config)
    for done, (name, frame) in enumerate(frames.items()):
        if progress:
            progress(done, len(frames))
        key = {"version": VERSION, "detector": known_by, "data": dataset.content_key, "frame": name}
        kept = cache.get(key)
        if kept is None:
            start = time.perf_counter()
            try:
                look = _look(detector, frame)
            except FRAME_ERRORS as error:
                yield str(error)
                continue
            kept = _pack(look), time.perf_counter() - start
            cache.put(key, *kept)
        yield _unpack(kept[0])
    if progress:
        progress(len(frames), len(frames))


def _look(detector: Detector, frame: MapFrame | QueryFrame) -> Look:
    panorama = frame.load()
    objects = annotated_objects(panorama)
    found = detector.detect(panorama)
    if not isinstance(found, Detections):
        raise InvalidAnswer(f"detect gave {type(found).__name__}, expected Detections")
    return Look(as_detections(objects), sightings(panorama, objects), found)


def _pack(look: Look) -> dict[str, np.ndarray]:
    sides = {"truth": look.truth, "found": look.found}
    arrays = {f"{side}.{part}": np.array(getattr(one, part)) for side, one in sides.items() for part in PARTS}
    return {**arrays, "range_m": look.shown.range_m, "hidden_share": look.shown.hidden_share}


def _unpack(arrays: Mapping[str, np.ndarray]) -> Look:
    def side(name: str) -> Detections:
        parts: dict[str, Any] = {part: arrays[f"{name}.{part}"] for part in PARTS}
        return Detections(**{**parts, "labels": tuple(map(str, parts["labels"]))})

    truth = side("truth")
    shown = Sightings(truth.labels, truth.solid_angle_sr, arrays["range_m"], arrays["hidden_share"])
    return Look(truth, shown, side("found"))


def _tabulate(seen: Observations, sensor: SensorModel) -> Iterator[FoundLine]:
    """How often objects of a size, a range, a hidden share were found, and how often the model says."""
    shown, found, right = seen.shown, seen.found, seen.right
    modelled = sensor.found.probability(shown.labels, shown.solid_angle_sr, shown.range_m, shown.hidden_share)
    apparent_deg = np.degrees(2 * np.sqrt(shown.solid_angle_sr / np.pi))
    splits = (
        ("{} deg across", apparent_deg, APPARENT_DEG),
        ("{} m away", shown.range_m, RANGES_M),
        ("{} of the outline hidden", shown.hidden_share, HIDDEN),
    )
    yield _line("all", np.ones(len(found), bool), found, modelled, right)
    for words, values, parts in splits:
        bins = np.digitize(values, parts)
        between = [f"{low} to {high}" for low, high in pairwise(parts)]
        for number, name in enumerate([f"under {parts[0]}", *between, f"{parts[-1]} and more"]):
            yield _line(words.format(name), (bins == number) & np.isfinite(values), found, modelled, right)
    for label, _ in Counter(shown.labels).most_common(COMMONEST):
        yield _line(label, np.array([own == label for own in shown.labels]), found, modelled, right)


def _line(by: str, chosen: np.ndarray, found: np.ndarray, modelled: np.ndarray, right: np.ndarray) -> FoundLine:
    count = int(chosen.sum())
    if not count:
        return FoundLine(by, 0, None, None, None)
    return FoundLine(by, count, *(float(values[chosen].mean()) for values in (found, modelled, right)))
