"""The task `sensor`: a detector measured against the annotations of whole data sets, as a sensor model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from salframe.evaluation.runs.request import Request, Resolved, Variant, resolve
from salframe.evaluation.runs.rows import LookRow
from salframe.evaluation.runs.run_folder import MethodStatus, PieceStatus, Row, Run
from salframe.evaluation.runs.runner import records_of, run_task
from salframe.evaluation.runs.task import (
    MethodRow,
    Part,
    Record,
    Survey,
    Task,
    Worker,
    by_method,
    check_needs,
    in_common,
)
from salframe.evaluation.statistics import bootstrap_interval
from salframe.evaluation.tasks.detection.task import place_of
from salframe.evaluation.tasks.sensor.fitting import Look, fit_sensor, observe
from salframe.evaluation.tasks.sensor.found_lines import FoundLine, by_label, by_sight
from salframe.framework.defaults import default_of
from salframe.framework.errors import FRAME_ERRORS, ConfigError, DataError, InputMissing, InvalidAnswer, MethodFailed
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
from salframe.panoramas.opening import Progress
from salframe.panoramas.panorama import Panorama

Frame = MapFrame | QueryFrame
PARTS: dict[str, tuple[int, ...]] = {
    "scores": (),
    "centroid_m": (3,),
    "size_m": (3,),
    "yaw_rad": (),
    "bearing": (3,),
    "solid_angle_sr": (),
}
"""The arrays of Detections that are kept of a panorama, by the shape of an object's part."""


@dataclass(frozen=True, eq=False)
class SensorMeasurement:
    """A sensor model, the lines that show how well it fits, and what must be said of it, a note each; crashed: whether
    the detector raised on some panorama, or its process died."""

    sensor: SensorModel
    lines: tuple[FoundLine, ...]
    notes: tuple[str, ...] = ()
    crashed: bool = False

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
    """A detector's line: over the panoramas that could be read, how many, the share of the annotated objects that was
    found, and found by a right label, with 95 % intervals, of objects clustered by place; false objects a panorama;
    robust standard deviations of the errors of what was found, as in `Errors`; lines: the same shares of objects of a
    size, a range, a hidden share, by what they are called."""

    panoramas: int | None = None
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

    def failed(self, piece: Frame) -> Row:
        """That nothing of it was found, where the panorama can be read at all."""
        try:
            truth, shown = _shown(piece.load())
        except FRAME_ERRORS:
            return {}
        return _pack(Look(truth, shown, Detections.empty()))

    def summarize(self, parts: Sequence[Part[Survey[Frame]]], seed: int) -> tuple[SensorRow, ...]:
        places = [
            f"{number}: {place_of(survey.dataset, piece)}"
            for number, (survey, _) in enumerate(parts)
            for piece in survey.pieces
        ]
        return tuple(_summarize(records, places, seed) for records in by_method(parts))


class _Looking(Worker[Frame]):
    """A detector that looks at panoramas."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector

    def work(self, piece: Frame) -> Row:
        panorama = piece.load()
        truth, shown = _shown(panorama)
        found = self._detector.detect(panorama)
        if not isinstance(found, Detections):
            raise InvalidAnswer(f"detect gave {type(found).__name__}, expected Detections")
        return {**_pack(Look(truth, shown, found)), "status": PieceStatus.OK, "error": None}


def _shown(panorama: Panorama) -> tuple[Detections, Sightings]:
    """The annotated objects of a panorama, and how each shows."""
    objects = annotated_objects(panorama)
    return as_detections(objects), sightings(panorama, objects)


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
    objects = values.astype(object)
    objects[np.isnan(values)] = None
    as_list: list[Any] = objects.tolist()
    return as_list


def _looks(records: Sequence[Record]) -> list[Look | None]:
    """What the rows of a detector hold, in order; None of a panorama that could not be read."""
    rows = [row for record in records for row in record.rows]
    return [None if row is None or row.get("truth") is None else _unpack(row) for row in rows]


def _failures(records: Sequence[Record]) -> list[str]:
    """In a line each, how many panoramas were left out, and on how many the detector failed."""
    failed = [row for record in records for row in record.rows if row is not None and row["status"] != PieceStatus.OK]
    unread, blind = ([row for row in failed if (row.get("truth") is None) == lacking] for lacking in (True, False))
    words = {"were left out": unread, "count as not found, where the detector failed": blind}
    return [f"{len(rows)} panorama(s) {what}, the first: {rows[0]['error']}" for what, rows in words.items() if rows]


def _summarize(records: Sequence[Record], places: Sequence[str], seed: int) -> SensorRow:
    """A detector's line; places (P,): where each panorama was taken."""
    line = SensorRow(**in_common(records))
    if not all(record.done for record in records):
        return line
    line = replace(line, reason="; ".join([*([line.reason] if line.reason else []), *_failures(records)]) or None)
    usable = [(look, place) for look, place in zip(_looks(records), places, strict=True) if look is not None]
    seen = observe(look for look, _ in usable)
    if not len(seen.found):
        return replace(line, reason=line.reason or "no annotated object is in sight, expected at least one")
    sensor = fit_sensor(seen, {"salframe": installed_version("salframe"), "detector": {}, "data": {}})
    whole, *parts = by_sight(seen, sensor)
    of_object = [place for look, place in usable for _ in look.truth.labels]
    bounds: dict[str, Any] = {}
    for name in ("found", "right"):
        low, high = bootstrap_interval(getattr(seen, name).astype(float), of_object, seed)
        bounds |= {name: getattr(whole, name), f"{name}_low": low, f"{name}_high": high}
    return replace(
        line,
        panoramas=len(usable),
        objects=whole.objects,
        **bounds,
        false_per_panorama=sensor.false_objects.per_panorama,
        **sensor.errors.model_dump(),
        lines={part.by: part for part in (whole, *parts) if part.objects},
    )


def measure_sensor(
    detector: str,
    data: Sequence[str] = (),
    data_dir: str | Path | None = None,
    settings: Sequence[str] = (),
    seeds: Sequence[int] = (),
    *,
    name: str | None = None,
    engine: str | None = None,
    runs: str | Path = "runs",
    progress: Progress | None = None,
) -> SensorMeasurement:
    """Run a detector on all panoramas of data sets, mapping frames and queries, and measure it by their annotations.

    data: presets, data sets, YAML files or folders, the default one where there is none; settings: "data.KEY=value",
    "detector.KEY=value" and "engine.KEY=value"; seeds: of the data sets, one after the other; name, engine, runs: as in
    a Request. What was begun is resumed. Raises SalframeError on names and settings that are wrong, InputMissing where
    the data lack annotations, range or what the detector needs, DataError where no panorama can be used.
    """
    task, method = SensorTask(), Variant(detector, name="detector", label=short_name(detector))
    requests: dict[str, tuple[Request, Resolved]] = {}
    for one in data or (default_of("data"),):
        for seed in seeds or (None,):
            given = (*settings, *([] if seed is None else [f"data.seed={seed}"]))
            request = Request([method], one, data_dir, given, name, engine=engine, runs=Path(runs))
            resolved = resolve(request, task.role)
            called = resolved.name if seed is None else f"{resolved.name} seed {seed}"
            if called in requests:
                raise ConfigError(f"received the data {called!r} twice, expected each once")
            requests[called] = request, resolved
    ((_, config),) = resolved.methods.items()
    config.component.check(config)
    records: list[Record] = []
    notes: dict[str, None] = {}
    for number, (called, (request, resolved)) in enumerate(requests.items()):
        if progress and len(requests) > 1:
            progress("data sets", number, len(requests))
        try:
            record, told = _look_at(task, request, resolved, progress)
        except InputMissing as error:
            raise InputMissing(f"{called}: {error}") from None
        records.append(record)
        notes |= dict.fromkeys(told)
    looks = [look for look in _looks(records) if look is not None]
    failures = _failures(records)
    if not looks:
        raise DataError(f"no panorama of {', '.join(requests)} can be used; {(*failures, 'there is none')[0]}")
    seen = observe(looks)
    provenance = {
        "salframe": installed_version("salframe"),
        "detector": identity(config),
        "data": {called: identity(resolved.data) for called, (_, resolved) in requests.items()},
    }
    sensor = fit_sensor(seen, provenance)
    crashed = any(row["status"] == PieceStatus.CRASHED for record in records for row in record.rows if row is not None)
    lines = (*by_sight(seen, sensor), *by_label(seen, sensor))
    return SensorMeasurement(sensor, lines, (*notes, *failures), crashed)


def _look_at(
    task: SensorTask, request: Request, resolved: Resolved, progress: Progress | None
) -> tuple[Record, Sequence[str]]:
    """What a detector made of a data set, and notes. Raises InputMissing or MethodFailed where it did not end its
    work."""
    result = run_task(task, request, resolved, progress=progress)
    run = Run.load(result.run)
    ((_, (record,)),) = records_of(task, [run.directory])
    if not record.done:
        unavailable = record.outcome.status is MethodStatus.UNAVAILABLE
        raise (InputMissing if unavailable else MethodFailed)(str(record.outcome.reason))
    return record, result.notes
