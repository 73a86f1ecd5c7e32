"""Choose the places, the queries and the spacing of the panoramas of a recording."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from salframe.framework.errors import ConfigError, DataError, UnknownName, unknown
from salframe.framework.files.reading import read_text
from salframe.panoramas.importer import ImageFiles, PanoramaRecord, PlaceSource, Recording

_NUMBER = r"(\d+\.?\d*|\.\d+)"


@dataclass(frozen=True, eq=False)
class SelectedPanorama:
    """A panorama to write.

    Attributes:
        record: The panorama.
        is_query: Whether it is a query.
        place: Its place; None if it is unknown.
    """

    record: PanoramaRecord
    is_query: bool
    place: str | None


def select(
    recording: Recording, place_from: str | None = None, queries: str | Path | None = None, every: str | None = None
) -> tuple[PlaceSource, list[SelectedPanorama]]:
    """Return the source of the places, and the panoramas to write.

    Args:
        recording: The recording.
        place_from: A PlaceSource. None: the first source that names the place of every reference panorama.
        queries: "every:N": every Nth panorama with a pose is a query. Otherwise a text file with the ids of queries,
            one a line. Panoramas without a pose are queries in any case.
        every: Minimum distance between panoramas with poses, such as "0.5m", or minimum time, such as "2s".

    Raises:
        ConfigError: An argument is invalid.
        UnknownName: The file of queries has an id that the recording does not have.
        DataError: No reference panorama is left, or one has no place or no time.
    """
    records = list(recording.records) if every is None else _thinned(recording.records, every)
    ids = _query_ids(records, recording.records, queries)
    references = [record for record in records if record.is_reference and record.id not in ids]
    if not references:
        num_posed = sum(record.is_reference for record in records)
        raise DataError(
            f"none of the {len(records)} panoramas of the recording can be in a map ({num_posed} have poses), expected "
            "at least one that has a pose and is not a query (option --queries)"
        )
    source = _place_source(references, place_from)
    reference_ids = {record.id for record in references}
    selected = []
    for record in records:
        place = record.places.get(source)
        if source is PlaceSource.NONE:
            place = record.id if record.id in reference_ids else _nearest_id(record, references)
        selected.append(SelectedPanorama(record, record.id not in reference_ids, place))
    return source, selected


def _place_source(references: Sequence[PanoramaRecord], place_from: str | None) -> PlaceSource:
    """Return the source of the places of reference panoramas."""
    if place_from is None:
        full = (source for source in PlaceSource if all(source in record.places for record in references))
        return next(full, PlaceSource.NONE)
    try:
        source = PlaceSource(place_from)
    except ValueError:
        raise ConfigError(
            f"the option --place-from is {place_from!r}, expected one of {', '.join(PlaceSource)}"
        ) from None
    without = [record.id for record in references if source not in record.places]
    if without and source is not PlaceSource.NONE:
        known = [s for s in PlaceSource if s is PlaceSource.NONE or all(s in record.places for record in references)]
        raise DataError(
            f"--place-from {source} gives no place for {len(without)} of {len(references)} reference frames (panoramas "
            f"of the map), such as {without[0]}, expected a place for each: choose {' or '.join(known)}"
        )
    return source


def _nearest_id(record: PanoramaRecord, references: Sequence[PanoramaRecord]) -> str | None:
    """Return the id of the reference panorama that is nearest to a panorama; None if its pose is unknown."""
    if record.T_world_pano is None:
        return None
    positions_m = np.array([np.asarray(reference.T_world_pano)[:3, 3] for reference in references])
    return references[int(np.linalg.norm(positions_m - record.T_world_pano[:3, 3], axis=1).argmin())].id


def _query_ids(
    records: Sequence[PanoramaRecord], recorded: Sequence[PanoramaRecord], queries: str | Path | None
) -> set[str]:
    """Return the ids of panoramas with poses that are queries."""
    if queries is None:
        return set()
    if isinstance(queries, str) and queries.startswith("every:"):
        number = queries.removeprefix("every:")
        if not (number.isascii() and number.isdecimal() and 2 <= int(number) <= 10**6):
            raise ConfigError(
                f"the option --queries is {queries!r}, expected every:N with N from 2 to 1000000, or a text file with "
                "the id of a query in each line"
            )
        posed = [record.id for record in records if record.is_reference]
        return set(posed[int(number) - 1 :: int(number)])
    lines = read_text(Path(queries), "a text file with the id of a query in each line").splitlines()
    names = {record.id: record.id for record in recorded}
    for record in recorded:
        if isinstance(record.images, ImageFiles) and record.images.rgb is not None:
            names[record.id + record.images.rgb.suffix] = record.id
    listed = [line.strip() for line in lines if line.strip()]
    for name in listed:
        if name not in names:
            raise UnknownName(f"{queries}: {unknown('panorama', name, [record.id for record in recorded])}")
    return {names[name] for name in listed}


def _thinned(records: Sequence[PanoramaRecord], every: str) -> list[PanoramaRecord]:
    """Return the records, without records with a pose that are too close to the previously selected record."""
    match = re.fullmatch(rf"{_NUMBER}\s*(m|s)", every.strip())
    if not match or not 0 < float(match[1]) < 1e9:
        raise ConfigError(f"the option --every is {every!r}, expected a distance such as 0.5m or a time such as 2s")
    step, unit = float(match[1]), match[2]
    thinned: list[PanoramaRecord] = []
    previous: PanoramaRecord | None = None
    for record in records:
        if record.is_reference:
            if previous is not None and _apart(previous, record, unit) < step:
                continue
            previous = record
        thinned.append(record)
    return thinned


def _apart(first: PanoramaRecord, second: PanoramaRecord, unit: str) -> float:
    """Return the distance of two records in metres (unit "m"), or their difference of time in seconds ("s")."""
    if unit == "m":
        return float(np.linalg.norm(np.subtract(second.T_world_pano, first.T_world_pano)[:3, 3]))  # type: ignore[arg-type]
    if first.t_s is None or second.t_s is None:
        without = first if first.t_s is None else second
        raise DataError(
            f"the panorama {without.id} has no time, which --every with seconds needs: use a distance, such as --every "
            "0.5m"
        )
    return abs(second.t_s - first.t_s)
