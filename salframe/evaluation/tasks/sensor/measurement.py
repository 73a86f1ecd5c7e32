"""Calibrate a sensor model of a detector against the annotations of datasets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from salframe.evaluation.runs.records import Record
from salframe.evaluation.runs.request import Request, Resolved, Variant, resolve
from salframe.evaluation.runs.rows import PieceStatus
from salframe.evaluation.runs.run_folder import MethodStatus, Run
from salframe.evaluation.runs.runner import records_of, run_task
from salframe.evaluation.tables.table import Table
from salframe.evaluation.tables.text import percent
from salframe.evaluation.tasks.sensor.detection_lines import DetectionLine, by_label, by_sight
from salframe.evaluation.tasks.sensor.fitting import fit_sensor, observe
from salframe.evaluation.tasks.sensor.looks import failures_of, looks_of
from salframe.evaluation.tasks.sensor.rows import LookRow
from salframe.evaluation.tasks.sensor.task import SensorTask
from salframe.framework.components.defaults import default_of
from salframe.framework.components.identity import identity
from salframe.framework.components.installation import installed_version
from salframe.framework.components.presets import short_name
from salframe.framework.errors import ConfigError, DataError, InputMissing, MethodFailed
from salframe.framework.files.writing import write_json
from salframe.graphs.sensor import SensorModel
from salframe.panoramas.opening import Progress


@dataclass(frozen=True, eq=False)
class SensorMeasurement:
    """A calibrated sensor model.

    Attributes:
        sensor: The sensor model.
        lines: Measured and modelled detection rates of groups of objects.
        notes: Notes on the measurement.
        crashed: Whether the detector raised an exception on a panorama, or its process died.
    """

    sensor: SensorModel
    lines: tuple[DetectionLine, ...]
    notes: tuple[str, ...] = ()
    crashed: bool = False

    def write(self, path: str | Path) -> None:
        """Write the sensor model (model of the errors of the detector) as JSON. Equal measurements give files with
        equal bytes."""
        write_json(Path(path), self.sensor.model_dump(mode="json"))

    def table(self) -> Table:
        """Return the measured and the modelled detection rates as a table."""
        headings = ("objects", "annotated", "detected %", "model %", "detected with\nright label %")
        cells = [
            [line.by, str(line.objects), *map(percent, (line.detection_rate, line.modelled, line.right))]
            for line in self.lines
            if line.objects
        ]
        return Table(headings, cells)

    def summary(self) -> list[str]:
        """Return a summary of labels, false positives and errors of the model, one line each."""
        sensor = self.sensor
        false, errors = sensor.false_objects, sensor.errors
        renamed = {
            f"{label} as {detected}": count
            for label, row in sensor.confusion.items()
            for detected, count in row.items()
            if detected != label
        }
        return [
            f"confused labels: {_commonest(renamed)}",
            f"false positives: {false.per_panorama:.1f} per panorama: {_commonest(false.labels)}",
            f"errors, robust standard deviation: bearing {math.degrees(errors.bearing_rad):.2f} deg, "
            f"range {errors.range_share * 100:.1f} %, size {errors.size_log * 100:.0f} %, "
            f"height {errors.height_m * 100:.1f} cm",
            f"{sensor.provenance.panoramas} panoramas of {', '.join(sensor.provenance.data)}; "
            "model %: mean probability of detection of the same objects by the fitted model",
        ]

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
    name: str | None = None,
    engine: str | None = None,
    runs: str | Path = "runs",
    progress: Progress | None = None,
) -> SensorMeasurement:
    """Run a detector on all panoramas of datasets, reference frames and queries, and calibrate a sensor model.

    An interrupted run is resumed.

    Args:
        detector: The detector.
        data: Presets, datasets, YAML files or folders; the default dataset if there are none.
        data_dir: The `root` of the datasets.
        settings: Settings as "data.KEY=value", "detector.KEY=value" and "engine.KEY=value".
        seeds: Seeds of the datasets; each is a separate run.
        name: Name of the run folder, as in Request.
        engine: The engine, as in Request.
        runs: The folder of run folders.
        progress: Reports the progress.

    Raises:
        SalframeError: A name or a setting is wrong.
        InputMissing: The data lack annotations, range or other input of the detector.
        DataError: No panorama can be used.
    """
    task, method = SensorTask(), Variant(detector, name="detector", label=short_name(detector))
    requests: dict[str, tuple[Request, Resolved]] = {}
    for one in data or (default_of("data"),):
        for seed in seeds or (None,):
            data_settings = (*settings, *([] if seed is None else [f"data.seed={seed}"]))
            request = Request([method], one, data_dir, data_settings, name, engine=engine, runs=Path(runs))
            resolved = resolve(request, task.role)
            data_name = resolved.name if seed is None else f"{resolved.name} seed {seed}"
            if data_name in requests:
                raise ConfigError(f"received the dataset {data_name!r} twice, expected each dataset once")
            requests[data_name] = request, resolved
    ((_, config),) = resolved.methods.items()
    config.component.check(config)
    records: list[Record[LookRow]] = []
    notes: dict[str, None] = {}
    for number, (data_name, (request, resolved)) in enumerate(requests.items()):
        if progress and len(requests) > 1:
            progress("datasets", number, len(requests))
        try:
            record, record_notes = _look_at(task, request, resolved, progress)
        except InputMissing as error:
            raise InputMissing(f"{data_name}: {error}") from None
        records.append(record)
        notes |= dict.fromkeys(record_notes)
    looks = [look for look in looks_of(records) if look is not None]
    failures = failures_of(records)
    if not looks:
        raise DataError(
            f"no panorama of {', '.join(requests)} can be used: {(*failures, 'the data have no panorama')[0]}"
        )
    observations = observe(looks)
    provenance = {
        "salframe": installed_version("salframe"),
        "detector": identity(config),
        "data": {data_name: identity(resolved.data) for data_name, (_, resolved) in requests.items()},
    }
    sensor = fit_sensor(observations, provenance)
    crashed = any(row.status == PieceStatus.CRASHED for record in records for row in record.rows if row is not None)
    lines = (*by_sight(observations, sensor), *by_label(observations, sensor))
    return SensorMeasurement(sensor, lines, (*notes, *failures), crashed)


def _look_at(
    task: SensorTask, request: Request, resolved: Resolved, progress: Progress | None
) -> tuple[Record[LookRow], Sequence[str]]:
    """Run a detector on a dataset, and return its record and notes.

    Raises InputMissing or MethodFailed if the detector did not complete its work.
    """
    result = run_task(task, request, resolved, progress=progress)
    run = Run.load(result.run)
    ((_, (record,)),) = records_of(task, [run.directory])
    if not record.done:
        unavailable = record.outcome.status is MethodStatus.UNAVAILABLE
        raise (InputMissing if unavailable else MethodFailed)(str(record.outcome.reason))
    return record, result.notes


def _commonest(counts: Mapping[str, int]) -> str:
    """Return the eight most frequent names with their counts."""
    order = sorted(counts.items(), key=lambda entry: (-entry[1], entry[0]))
    return ", ".join(f"{name} {count}" for name, count in order[:8]) or "none"
