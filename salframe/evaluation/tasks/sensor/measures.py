"""Compute the table row of each detector from its rows per panorama."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from salframe.evaluation.runs.records import Record, in_common
from salframe.evaluation.statistics import estimate_mean
from salframe.evaluation.tasks.sensor.detection_lines import by_sight
from salframe.evaluation.tasks.sensor.fitting import fit_sensor, observe
from salframe.evaluation.tasks.sensor.looks import failures_of, looks_of
from salframe.evaluation.tasks.sensor.rows import LookRow
from salframe.evaluation.tasks.sensor.table import SensorRow
from salframe.framework.components.installation import installed_version


def summarize_detector(records: Sequence[Record[LookRow]], places: Sequence[str], seed: int) -> SensorRow:
    """Return the row of a detector in the table. `places` (P,) are the places of the panoramas."""
    line = SensorRow(**in_common(records))
    if not all(record.done for record in records):
        return line
    line = replace(line, reason="; ".join([*([line.reason] if line.reason else []), *failures_of(records)]) or None)
    usable = [(look, place) for look, place in zip(looks_of(records), places, strict=True) if look is not None]
    observations = observe(look for look, _ in usable)
    if not len(observations.is_detected):
        return replace(line, reason=line.reason or "no annotated object is visible, expected at least one")
    sensor = fit_sensor(observations, {"salframe": installed_version("salframe"), "detector": {}, "data": {}})
    whole, *parts = by_sight(observations, sensor)
    of_object = [place for look, place in usable for _ in look.truth.labels]
    return replace(
        line,
        panoramas=len(usable),
        objects=whole.objects,
        detection_rate=estimate_mean(observations.is_detected.astype(float), of_object, seed),
        right=estimate_mean(observations.right.astype(float), of_object, seed),
        false_per_panorama=sensor.false_objects.per_panorama,
        **sensor.errors.model_dump(),
        lines={part.by: part for part in (whole, *parts) if part.objects},
    )
