"""The task `sensor`: a detector measured against the annotations of whole data sets, as a sensor model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.metrics import bootstrap_interval
from salframe.evaluation.request import Request, Resolved, Variant, resolve
from salframe.evaluation.rows import LookRow
from salframe.evaluation.run import MethodStatus, PieceStatus, Row, Run
from salframe.evaluation.runner import measure, run_task
from salframe.evaluation.sensor_fit import Look, Observations, fit_sensor, observe
from salframe.evaluation.task import MethodRow, Part, Record, Survey, Task, Worker, by_method, check_needs, in_common
from salframe.framework.defaults import default_of
from salframe.framework.errors import ConfigError, DataError, InputMissing, InvalidAnswer, MethodFailed
from salframe.framework.files import write_json
from salframe.framework.identity import identity
from salframe.framework.installation import installed_version
from salframe.framework.presets import short_name
from salframe.graphs.annotated import annotated_objects, as_detections
from salframe.graphs.detections import Detections
from salframe.graphs.detector import Detector
from salframe.graphs.sensor import SensorModel
from salframe.graphs.sightings import Sightings, sightings
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import MapFrame, QueryFrame
from salframe.panoramas.opening import Progress, open_dataset

Frame = MapFrame | QueryFrame
APPARENT_DEG, RANGES_M, HIDDEN = (2, 4, 8, 16, 32), (2, 4, 6, 10), (0.1, 0.3, 0.6)
"""Where the lines of the tables part: diameter of the disc of an object's solid angle, range, hidden share."""
COMMONEST = 10
"""So many labels have a line of their own."""
ALL = "all"
"""What the line of all objects is called."""
PARTS: dict[str, tuple[int, ...]] = {
    "scores": (),
    "centroid_m": (3,),
    "size_m": (3,),
    "yaw_rad": (),
    "bearing": (3,),
    "solid_angle_sr": (),
}
"""The arrays of Detections that are kept of a panorama, by the shape of an object's part."""


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


@dataclass(frozen=True, kw_only=True)
class SensorRow(MethodRow):
    """A detector's line: over all panoramas, the share of the annotated objects that was found, and found by a right
    label, with 95 % intervals, of objects clustered by place; false objects a panorama; robust standard deviations of
    the errors of what was found, as in `Errors`; lines: the same shares of objects of a size, a range, a hidden
    share, by what they are called."""

    panoramas: int
    objects: int | None = None
    found: float | None = None
    found_low: float | None = None
    found_high: float | None = None
    right: float | None = None
    right_low: float | None = None
    right_high: float | None = None
    false_per_panorama: float | None = None
    bearing_rad: float | None = None
    range_share: float | None = None
    size_log: float | None = None
    height_m: float | None = None
    lines: Mapping[str, FoundLine] = field(default_factory=dict)

    @property
    def measured(self) -> bool:
        return self.found is not None


@dataclass(frozen=True)
class SensorTask(Task[Frame, Survey[Frame]]):
    """What does a detector find in each panorama, map and queries, of what is annotated there?"""

    name = "sensor"
    role = "detector"
    prefix = "sensor-"
    counts = "panoramas"
    key_fields = ("frame",)
    row = LookRow

    @classmethod
    def from_run(cls, run: Run) -> SensorTask:
        return cls()

    def survey(self, dataset: Dataset) -> Survey[Frame]:
        if absent := {"annotations", "range"} - dataset.provides:
            lacks = f"{dataset.name} does not have {' and '.join(sorted(absent))}"
            raise InputMissing(f"a sensor is measured by annotations and range, and {lacks}")
        frames: dict[str, Frame] = {}
        for fold in dataset.folds():
            frames.update((frame.id, frame) for frame in fold.mapping)
            frames.update((query.id, query) for query in fold.queries)
        return Survey(dataset, list(frames.values()))

    def key(self, piece: Frame) -> tuple[str]:
        return (piece.id,)

    def open(
        self, label: str, method: Detector, survey: Survey[Frame], todo: Sequence[Frame], folder: Path
    ) -> Worker[Frame]:
        check_needs(method, survey.dataset)
        return _Looking(method)

    def summarize(self, parts: Sequence[Part[Survey[Frame]]], seed: int) -> tuple[SensorRow, ...]:
        panoramas = sum(len(survey.pieces) for survey, _ in parts)
        places = [
            f"{number}: {_place(survey.dataset, piece)}"
            for number, (survey, _) in enumerate(parts)
            for piece in survey.pieces
        ]
        return tuple(_summarize(records, panoramas, places, seed) for records in by_method(parts))


class _Looking(Worker[Frame]):
    """A detector that looks at panoramas."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector

    def work(self, piece: Frame) -> Row:
        panorama = piece.load()
        objects = annotated_objects(panorama)
        found = self._detector.detect(panorama)
        if not isinstance(found, Detections):
            raise InvalidAnswer(f"detect gave {type(found).__name__}, expected Detections")
        return {
            **_pack(Look(as_detections(objects), sightings(panorama, objects), found)),
            "status": PieceStatus.OK,
            "error": None,
        }


def _place(dataset: Dataset, frame: Frame) -> str:
    """The place of a panorama, or what it is called itself where that is not known."""
    if isinstance(frame, MapFrame):
        return frame.place
    try:
        return dataset.truth(frame.id).place
    except DataError:
        return frame.id


def _pack(look: Look) -> Row:
    """What is kept of a look; None is what is not known."""
    sides = {"truth": look.truth, "found": look.found}
    packed: Row = {
        name: {"labels": list(side.labels), **{part: _listed(getattr(side, part)) for part in PARTS}}
        for name, side in sides.items()
    }
    return {**packed, "range_m": _listed(look.shown.range_m), "hidden_share": _listed(look.shown.hidden_share)}


def _unpack(row: Row) -> Look:
    def side(name: str) -> Detections:
        kept = row[name]
        arrays: dict[str, Any] = {part: np.array(kept[part], float).reshape(-1, *PARTS[part]) for part in PARTS}
        return Detections(labels=tuple(kept["labels"]), **arrays)

    truth = side("truth")
    range_m, hidden_share = (np.array(row[name], float) for name in ("range_m", "hidden_share"))
    return Look(truth, Sightings(truth.labels, truth.solid_angle_sr, range_m, hidden_share), side("found"))


def _listed(values: np.ndarray) -> list[Any]:
    """An array as lists, None in the place of NaN."""
    told = values.astype(object)
    told[np.isnan(values)] = None
    listed: list[Any] = told.tolist()
    return listed


def _looks(records: Sequence[Record]) -> list[Look | None]:
    """What the rows of a detector hold, in order; None of a panorama that could not be looked at."""
    rows = [row for record in records for row in record.rows]
    return [None if row is None or row["status"] != PieceStatus.OK else _unpack(row) for row in rows]


def _summarize(records: Sequence[Record], panoramas: int, places: Sequence[str], seed: int) -> SensorRow:
    """A detector's line; places (P,): where each panorama was taken."""
    line = SensorRow(**in_common(records), panoramas=panoramas)
    if not all(record.done for record in records):
        return line
    looks = _looks(records)
    usable = [(look, place) for look, place in zip(looks, places, strict=True) if look is not None]
    if len(usable) < panoramas:
        first = next(iter(line.errors.values()), "no answer")
        line = replace(line, reason=f"{panoramas - len(usable)} panorama(s) left out, the first: {first}")
    seen = observe(look for look, _ in usable)
    if not len(seen.found):
        return line
    sensor = fit_sensor(seen, {"salframe": installed_version("salframe"), "detector": {}, "data": {}})
    whole, *_ = lines = list(_tabulate(seen, sensor))
    of_object = [place for look, place in usable for _ in look.truth.labels]
    bounds: dict[str, Any] = {}
    for name in ("found", "right"):
        low, high = bootstrap_interval(getattr(seen, name).astype(float), of_object, seed)
        bounds |= {name: getattr(whole, name), f"{name}_low": low, f"{name}_high": high}
    return replace(
        line,
        objects=whole.objects,
        **bounds,
        false_per_panorama=sensor.false_objects.per_panorama,
        **sensor.errors.model_dump(),
        lines={line.by: line for line in lines if line.objects},
    )


def measure_sensor(
    detector: str,
    data: Sequence[str] = (),
    data_dir: str | Path | None = None,
    settings: Sequence[str] = (),
    seeds: Sequence[int] = (),
    *,
    engine: str | None = None,
    runs: str | Path = "runs",
    progress: Progress | None = None,
) -> SensorMeasurement:
    """Run a detector on all panoramas of data sets, mapping frames and queries, and measure it by their annotations.

    data: presets, data sets, YAML files or folders, the default one where there is none; settings: "data.KEY=value",
    "detector.KEY=value" and "engine.KEY=value"; seeds: of the data sets, one after the other; engine, runs: as in a
    Request. What was begun is resumed. Raises SalframeError on names and settings that are wrong, InputMissing where
    the data lack annotations, range or what the detector needs, DataError where no panorama can be used.
    """
    task, method = SensorTask(), Variant(detector, name="detector", label=short_name(detector))
    asked: dict[str, tuple[Request, Resolved]] = {}
    for one in data or (default_of("data"),):
        for seed in seeds or (None,):
            given = (*settings, *([] if seed is None else [f"data.seed={seed}"]))
            request = Request([method], one, data_dir, given, engine=engine, runs=Path(runs))
            resolved = resolve(request, task.role)
            name = resolved.name if seed is None else f"{resolved.name} seed {seed}"
            if name in asked:
                raise ConfigError(f"received the data {name!r} twice, expected each once")
            asked[name] = request, resolved
    ((_, config),) = resolved.methods.items()
    config.component.check(config)
    records: list[Record] = []
    for number, (name, (request, resolved)) in enumerate(asked.items()):
        if progress and len(asked) > 1:
            progress("data sets", number, len(asked))
        records.append(_record(task, name, request, resolved, progress))
    looks = [look for look in _looks(records) if look is not None]
    failures = [str(row["error"]) for record in records for row in record.rows if row and row["error"]]
    if not looks:
        raise DataError(f"no panorama of {', '.join(asked)} can be used; the first: {(*failures, 'there is none')[0]}")
    seen = observe(looks)
    provenance = {
        "salframe": installed_version("salframe"),
        "detector": identity(config),
        "data": {name: identity(resolved.data) for name, (_, resolved) in asked.items()},
    }
    sensor = fit_sensor(seen, provenance)
    notes = (f"{len(failures)} panorama(s) were left out, the first: {failures[0]}",) if failures else ()
    return SensorMeasurement(sensor, (*_tabulate(seen, sensor), *_by_label(seen, sensor)), notes)


def _record(task: SensorTask, name: str, request: Request, resolved: Resolved, progress: Progress | None) -> Record:
    """What a detector made of a data set. Raises InputMissing or MethodFailed where it did not end its work."""
    run = Run.load(run_task(task, request, resolved, progress=progress).run)
    _, (record,) = measure(task, run, task.survey(open_dataset(run.data())))
    if not record.done:
        unavailable = record.outcome.status is MethodStatus.UNAVAILABLE
        raise (InputMissing if unavailable else MethodFailed)(f"{name}: {record.outcome.reason}")
    return record


def _tabulate(seen: Observations, sensor: SensorModel) -> Iterator[FoundLine]:
    """How often objects of a size, a range, a hidden share were found, and how often the model says."""
    shown, found, right = seen.shown, seen.found, seen.right
    modelled = _modelled(seen, sensor)
    apparent_deg = np.degrees(2 * np.sqrt(shown.solid_angle_sr / np.pi))
    splits = (
        ("{} deg across", apparent_deg, APPARENT_DEG),
        ("{} m away", shown.range_m, RANGES_M),
        ("{} of the outline hidden", shown.hidden_share, HIDDEN),
    )
    yield _line(ALL, np.ones(len(found), bool), found, modelled, right)
    for words, values, parts in splits:
        bins = np.digitize(values, parts)
        between = [f"{low} to {high}" for low, high in pairwise(parts)]
        for number, name in enumerate([f"under {parts[0]}", *between, f"{parts[-1]} and more"]):
            yield _line(words.format(name), (bins == number) & np.isfinite(values), found, modelled, right)


def _by_label(seen: Observations, sensor: SensorModel) -> Iterator[FoundLine]:
    """The same of the commonest labels."""
    modelled = _modelled(seen, sensor)
    for label, _ in Counter(seen.shown.labels).most_common(COMMONEST):
        chosen = np.array([own == label for own in seen.shown.labels])
        yield _line(label, chosen, seen.found, modelled, seen.right)


def _modelled(seen: Observations, sensor: SensorModel) -> np.ndarray:
    """(N,) how likely each object is found, as the model says."""
    shown = seen.shown
    return sensor.found.probability(shown.labels, shown.solid_angle_sr, shown.range_m, shown.hidden_share)


def _line(by: str, chosen: np.ndarray, found: np.ndarray, modelled: np.ndarray, right: np.ndarray) -> FoundLine:
    count = int(chosen.sum())
    if not count:
        return FoundLine(by, 0, None, None, None)
    return FoundLine(by, count, *(float(values[chosen].mean()) for values in (found, modelled, right)))
