"""The open map of the service. It is replaced when the files of the map change."""

from __future__ import annotations

import json
import logging
import threading
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError, SalframeError, describe_error
from salframe.framework.files.array_files import FileStamp
from salframe.localization.map import LocalizationMap
from salframe.localization.map_files import MAP, MapParts, read_map
from salframe.localization.preparing import silent
from salframe.panoramas.panorama import Annotations, ObjectBoxes, Panorama
from salframe.topology.geojson import map_geojson
from salframe.topology.store import TOPOLOGY, read_topology
from salframe.topology.topological_map import TopologicalMap

MAX_PLACES_WITH_OBJECTS = 500
"""Maximum number of places whose objects are listed in the GeoJSON of the map."""
WARM_HEIGHT = 256
"""Height in pixels of the panorama that is localized once before the service starts."""
_log = logging.getLogger("salframe.serving")


@dataclass(frozen=True, eq=False)
class ServedMap:
    """One version of the map.

    A request uses the same version from start to end, even if a newer version is opened meanwhile. If the request fails
    because the files were replaced, it is repeated with the newer version.

    Attributes:
        name: Name of the map folder.
        localization: The localization map.
        topology: The topological map; None if the map has none.
        stamp: Stamp (size and modification time) of map.json. It is different for every version.
    """

    name: str
    localization: LocalizationMap
    topology: TopologicalMap | None
    stamp: FileStamp

    @classmethod
    def open(cls, folder: Path) -> ServedMap:
        """Open a map, and localize one query in it, so that the first request is as fast as later requests.

        Raises:
            DataError: The folder contains no map that can localize.
            UnknownName: The localizer is not installed.
        """
        stamp = _stamp(folder)
        localization, topology = read_map(folder, _read_parts)
        served = cls(folder.name, localization, topology, stamp)
        served._warm()
        return served

    @property
    def version(self) -> str:
        """Identifier of this version of the map: modification time (in nanoseconds) and size of map.json."""
        return f"{self.stamp.modified_ns}-{self.stamp.size}"

    @cached_property
    def json(self) -> bytes:
        """The map as GeoJSON."""
        collection = map_geojson(
            self.name, self.localization, self.topology, max_places_with_objects=MAX_PLACES_WITH_OBJECTS
        )
        return json.dumps(collection, allow_nan=False, separators=(",", ":")).encode()

    def _warm(self) -> None:
        """Load everything that the first query needs: localize an image without objects, and a reference frame."""
        try:
            self.localization.localize(_gray_panorama(), warn=silent)
            if len(self.localization.frames):
                self.localization.answer(self.localization.reference(self.localization.frames[0].id)[1])
        except SalframeError as error:
            raise DataError(f"the map cannot localize: {describe_error(error)}") from error
        self.json  # noqa: B018 - computed before the first request needs it


def _gray_panorama() -> Panorama:
    """Return a panorama with a uniform colour image, a uniform range image and an empty list of annotated objects."""
    shape = WARM_HEIGHT, 2 * WARM_HEIGHT
    return Panorama(
        "warm-up",
        np.full((*shape, 3), 128, np.uint8),
        np.full(shape, 2.0, np.float32),
        annotations=Annotations(objects=ObjectBoxes.empty()),
    )


class MapHolder:
    """Holds the current version of a map, and opens the next version when the files have changed.

    Attributes:
        current: The current version.
        num_reloads: Number of versions that were opened after the first version.
        failure: The reason why the changed map could not be opened, in one line; None: there was no failure. After a
            failure, the previous version remains current.
    """

    def __init__(self, folder: Path) -> None:
        """Open a map. Raises as `ServedMap.open`."""
        self._folder, self._lock = folder, threading.Lock()
        self.current = ServedMap.open(folder)
        self._failed_stamp: FileStamp | None = None
        self.num_reloads, self.failure = 0, None

    failure: str | None

    def has_changed(self, served: ServedMap) -> bool:
        """Return whether the files of the map were replaced after this version was opened."""
        try:
            return _stamp(self._folder) != served.stamp
        except DataError:
            return True

    def refresh(self) -> ServedMap:
        """Return the current version of the map. If the files have changed, open the new version first.

        If the new version cannot be opened, the previous version is returned. Opening a map is slow: call this method
        in a thread.
        """
        with self._lock:
            try:
                stamp = _stamp(self._folder)
            except DataError as error:  # the map is being replaced, or was removed
                self.failure = str(error)
                return self.current
            if stamp in (self.current.stamp, self._failed_stamp):
                return self.current
            try:
                start = time.perf_counter()
                self.current = ServedMap.open(self._folder)
                self.num_reloads += 1
                self.failure, self._failed_stamp = None, None
                _log.info("opened the changed map in %.1f s", time.perf_counter() - start)
            except Exception as error:
                self.failure, self._failed_stamp = describe_error(error), stamp
                _log.warning(
                    "the changed map cannot be opened, and the server continues with the previous version: %s",
                    self.failure,
                )
            return self.current


def _read_parts(parts: MapParts) -> tuple[LocalizationMap, TopologicalMap | None]:
    topology = read_topology(parts) if parts.has(TOPOLOGY) else None
    return LocalizationMap.read(parts), topology


def _stamp(folder: Path) -> FileStamp:
    """Return the stamp of map.json. Raises DataError if the file is missing."""
    try:
        return FileStamp.of(folder / MAP)
    except OSError as error:
        raise DataError(f"{folder} contains no map ({error.strerror}): build a map with `salframe build`") from None
