"""Floor masks of an imported recording. They determine the places of panoramas, and allow a map to plan routes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import Field

from salframe.framework.config import read_yaml
from salframe.framework.errors import ConfigError, DataError
from salframe.framework.validation import Settings, validate
from salframe.panoramas.floors import FloorMasks, Regions, check_heights
from salframe.panoramas.folder_format import FloorEntry, read_floor
from salframe.panoramas.importer import PanoramaRecord, PlaceSource, Recording


class FloorsFile(Settings):
    """A YAML file with the floors of a recording. The paths of the masks are relative to the file."""

    floors: tuple[FloorEntry, ...] = Field(min_length=1)


def read_floors(path: Path) -> list[FloorMasks]:
    """Read the floors that a YAML file lists under `floors`, with the keys of the manifest. A floor without `z_m` is at
    z = 0.

    Raises:
        DataError: The file or a mask cannot be read, or masks of a floor differ in size.
    """
    try:
        content: FloorsFile = validate(FloorsFile, read_yaml(path), f"{path}:")
    except ConfigError as error:
        raise DataError(str(error)) from None
    floors = [read_floor(path.parent, entry, entry.z_m or 0.0) for entry in content.floors]
    check_heights(floors)
    return floors


def with_regions(recording: Recording, floors: Sequence[FloorMasks]) -> Recording:
    """Return a recording whose panoramas have the place of the floor region where they stand, as PlaceSource.REGION.

    Panoramas without a pose or outside the masks are unchanged.
    """
    posed = [record for record in recording.records if record.T_world_pano is not None]
    if not floors or not posed:
        return recording
    regions = Regions(floors)
    positions_m = np.array([np.asarray(record.T_world_pano)[:3, 3] for record in posed])
    numbers = regions.at(positions_m[:, :2], positions_m[:, 2])
    places = {record.id: regions.places[i] for record, i in zip(posed, numbers.tolist(), strict=True) if i >= 0}

    def in_region(record: PanoramaRecord) -> PanoramaRecord:
        if record.id not in places:
            return record
        return replace(record, places={**record.places, PlaceSource.REGION: places[record.id]})

    return replace(recording, records=tuple(map(in_region, recording.records)))
