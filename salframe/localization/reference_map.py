"""The class `ReferenceMap`: the reference frames of a map and their descriptions, which can be changed and saved."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

import numpy as np

from salframe.framework.components.installation import folder_bytes
from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError, SalframeError, UnknownName, shorten
from salframe.framework.files.array_files import FileStamp
from salframe.framework.files.cache import Cache
from salframe.graphs.scene_index import scene_index_notes
from salframe.localization.calibration import MapCalibration, calibrate_posterior, is_calibrated
from salframe.localization.canonical_order import in_canonical_order
from salframe.localization.level_frames import split_level, upright_frame
from salframe.localization.localizer import Description, Localizer
from salframe.localization.map_files import MapParts, find_not_finite, read_map, write_map
from salframe.localization.preparing import Tell, silent
from salframe.localization.references import complete_references, describe_references
from salframe.localization.unusable_frames import check_unusable, unusable_note
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import ReferenceFrame

MAX_HEIGHTS = 200
"""Maximum number of reference frames whose camera heights are used to check queries."""


class ReferenceMap:
    """The reference frames of a map (panoramas with known places and poses), their descriptions (features) in packed
    form, and floor masks (images of the free floor and the rooms from above).

    It can be built, changed, calibrated, saved and opened. `LocalizationMap` localizes queries with it.

    Attributes:
        localizer: The localizer.
        frames: The reference frames.
        floors: The floor masks.
        calibration: The calibration of the probabilities; None: the map is not calibrated.
    """

    calibration: MapCalibration | None = None

    def __init__(
        self,
        localizer: Localizer,
        packed: Sequence[Description],
        frames: Sequence[ReferenceFrame],
        floors: Sequence[FloorMasks] = (),
    ) -> None:
        """Create a map without indexing it. Such a map can be changed, merged and saved, but it cannot localize.

        Args:
            localizer: The localizer.
            packed: The packed description of each reference frame.
            frames: The reference frames.
            floors: Floors of the map.
        """
        self.localizer = localizer
        self._mapped_files: tuple[FileStamp, ...] = ()
        self._folder: Path | None = None
        self._is_checked = False
        self._has_other_calibration = False
        self._set_frames(packed, frames, floors)

    @classmethod
    def build(
        cls,
        localizer: Localizer,
        frames: Sequence[ReferenceFrame],
        cache: Cache | None = None,
        dataset: str = "",
        *,
        floors: Sequence[FloorMasks] = (),
        calibrate: bool = True,
        progress: Callable[[int, int], None] | None = None,
        tell: Tell = silent,
    ) -> Self:
        """Describe reference frames, calibrate the probabilities of the localizer, and index the frames.

        Frames that the localizer cannot use are left out, up to MAX_UNUSABLE_SHARE of them.

        Args:
            localizer: The localizer.
            frames: The reference frames.
            cache: As in `describe_frame`.
            dataset: As in `describe_frame`.
            floors: Floors of the map.
            calibrate: Whether to calibrate the posterior of the localizer, if it has one, and if its setting
                `calibrate` allows it.
            progress: Called as progress(done, total) with numbers of frames.
            tell: Called with each note of the localizer on a description, and with a note on frames that were left out.

        Raises:
            DataError: There are no frames, or too many frames cannot be read.
            InputMissing: The localizer cannot use too many of the frames.
        """
        packed, usable = describe_references(localizer, frames, cache, dataset, progress, tell)
        built = cls(localizer, *in_canonical_order(packed, usable), floors)
        built._index(calibrate and is_calibrated(localizer))
        for note in scene_index_notes(localizer.config, len(frames)):
            tell(note)
        return built

    @classmethod
    def from_descriptions(
        cls,
        localizer: Localizer,
        descriptions: Sequence[Description],
        frames: Sequence[ReferenceFrame],
        floors: Sequence[FloorMasks] = (),
        *,
        calibrate: bool = False,
        tell: Tell = silent,
    ) -> Self:
        """Create a map from descriptions of reference frames, and index it.

        The descriptions are packed and unpacked, so that the map answers like a map that was saved and opened.
        `calibrate` is as in `build`. `tell` is called with notes on objects and frames that are left out. Raises
        InputMissing as `build`.
        """
        completed = complete_references(localizer, descriptions, frames)
        check_unusable(completed.unusable_frames, len(frames))
        packed = [localizer.pack(split_level(description)[0]) for description in completed.descriptions]
        upright = [upright_frame(localizer, frame) for frame in completed.frames]
        built = cls(localizer, *in_canonical_order(packed, upright), floors)
        for note in [*completed.notes, *filter(None, [unusable_note(completed.unusable_frames)])]:
            tell(note)
        built._index(calibrate and is_calibrated(localizer))
        return built

    @classmethod
    def open(cls, directory: str | Path, localizer: Localizer | None = None) -> Self:
        """Open a saved map. If the folder has no index for the settings of the localizer, the map is indexed again.

        The map is calibrated if it was saved with a calibration for these settings.

        Args:
            directory: The folder of the map.
            localizer: A localizer with other settings for matching; None: the localizer that the map was saved with.

        Raises:
            DataError: `directory` contains no map, the map was edited or truncated, or the localizer describes
                panoramas in another way than the localizer of the map.
            UnknownName: The localizer is not installed.
        """
        return read_map(Path(directory), partial(cls.read, localizer=localizer))

    @classmethod
    def read(cls, parts: MapParts, *, localizer: Localizer | None = None, indexed: bool = True) -> Self:
        """Read a map from its parts. Raises as `open`.

        Args:
            parts: The parts of the map.
            localizer: As in `open`.
            indexed: Whether the map must be able to localize; False only to change, merge or save it.
        """
        localizer = localizer or registry().build(Localizer.role, parts.read_config())
        parts.check_method(localizer)
        packed, frames = parts.read_scenes()
        opened = cls(localizer, packed, frames, parts.read_floors() if localizer.uses_floors else ())
        opened._mapped_files, opened._folder = parts.mapped_files(), parts.folder
        opened.calibration = parts.read_calibration(localizer.config)
        opened._has_other_calibration = is_calibrated(localizer) and parts.has_other_calibration(localizer.config)
        if not indexed:
            return opened
        with convert_array_errors(parts.folder, localizer), warnings.catch_warnings():
            warnings.simplefilter("error", np.exceptions.ComplexWarning)  # raised for complex saved arrays
            if parts.has_index(localizer):
                localizer.open_index(parts.index_folder(localizer), packed, frames)
            else:
                opened._index()
        return opened

    def save(self, directory: str | Path, *, with_index: bool = True) -> None:
        """Write the map to a folder in one step. It replaces a map in the folder, including its topology.

        Args:
            directory: The folder.
            with_index: Whether to write the index too.

        Raises:
            ConfigError: The folder contains something other than a map.
        """
        with write_map(Path(directory)) as parts:
            self.write(parts, with_index=with_index)

    def write(self, parts: MapParts, *, with_index: bool = True) -> None:
        """Write the parts of this map: the method, frames, descriptions, floors, the calibration and the index."""
        parts.write_method(self.localizer)
        parts.write_scenes(self._packed, self.frames)
        if self.floors:
            parts.write_floors(self.floors)
        if self.calibration is not None:
            parts.write_calibration(self.localizer.config, self.calibration)
        if with_index:
            self.localizer.write_index(parts.index_folder(self.localizer))

    def calibrate(self) -> MapCalibration:
        """Calibrate the probabilities with the reference frames, and index the map.

        A map that was calibrated is calibrated again whenever it is changed.

        Raises:
            DataError: The localizer has no posterior.
        """
        descriptions = self.descriptions()
        frames = list(self.frames)
        self.calibration = calibrate_posterior(self.localizer, descriptions, frames, self.floors)
        self.localizer.index(descriptions, frames)
        return self.calibration

    def num_bytes(self) -> int:
        """Return the size of the saved map in bytes, without its index. The index can be computed from the other
        parts."""
        with TemporaryDirectory() as folder:
            self.save(Path(folder) / "map", with_index=False)
            return folder_bytes(Path(folder))

    def extend(
        self,
        frames: Sequence[ReferenceFrame],
        cache: Cache | None = None,
        dataset: str = "",
        *,
        floors: Sequence[FloorMasks] = (),
        progress: Callable[[int, int], None] | None = None,
        tell: Tell = silent,
    ) -> None:
        """Describe more reference frames, add them to the map, and index the map.

        If the map has frames of the same places, the new frames replace them. `floors` are the floors of the map after
        the change. The other arguments are as in `build`. Raises as `build`.
        """
        packed, usable = describe_references(self.localizer, frames, cache, dataset, progress, tell)
        self._replace({frame.place for frame in frames}, packed, usable, floors)
        for note in scene_index_notes(self.localizer.config, len(self.frames)):
            tell(note)

    def remove(self, places: Collection[str], floors: Sequence[FloorMasks] = ()) -> None:
        """Remove the frames of some places, and index the map. `floors` are the floors of the map after the change."""
        self._replace(places, [], [], floors)

    def merge(self, others: Sequence[ReferenceMap], floors: Sequence[FloorMasks] = ()) -> None:
        """Add the frames of other maps, and index the map.

        The other maps must have descriptions of the same method and settings. `floors` are the floors of the map after
        the change.
        """
        packed = [row for other in others for row in other._packed]
        self._replace((), packed, [frame for other in others for frame in other.frames], floors)

    def reference(self, frame_id: str) -> tuple[ReferenceFrame, Description]:
        """Return a reference frame and its description (features), unpacked.

        Raises:
            UnknownName: The map has no such frame.
        """
        number = self._frame_numbers.get(frame_id)
        if number is None:
            raise UnknownName(
                f"the map has no reference frame {shorten(repr(frame_id))}, expected the id of one of its `frames`"
            )
        return self.frames[number], self.localizer.unpack(self._packed[number])

    def descriptions(self) -> list[Description]:
        """Return the descriptions of all reference frames, unpacked."""
        return [self.localizer.unpack(packed) for packed in self._packed]

    def _set_frames(
        self, packed: Sequence[Description], frames: Sequence[ReferenceFrame], floors: Sequence[FloorMasks]
    ) -> None:
        self._packed, self.frames = packed, frames
        self.__dict__.pop("_frame_numbers", None)  # computed again for the new frames
        self._camera_z_m = np.array([frame.T_world_pano[2, 3] for frame in frames[:MAX_HEIGHTS]])
        self.floors = self.localizer.floors = tuple(floors) if self.localizer.uses_floors else ()

    @cached_property
    def _frame_numbers(self) -> dict[str, int]:
        return {frame.id: number for number, frame in enumerate(self.frames)}

    def _index(self, calibrate: bool = False) -> None:
        """Index the map, after its calibration if `calibrate` is set. Raises as `calibrate_posterior`."""
        descriptions, frames = self.descriptions(), list(self.frames)
        if calibrate:
            self.calibration = calibrate_posterior(self.localizer, descriptions, frames, self.floors)
        self.localizer.index(descriptions, frames)

    def _replace(
        self,
        places: Collection[str],
        packed: Sequence[Description],
        frames: Sequence[ReferenceFrame],
        floors: Sequence[FloorMasks],
    ) -> None:
        """Remove the frames of some places, add others, and index the map."""
        rows = [i for i, frame in enumerate(self.frames) if frame.place not in places]
        remaining = [*(self._packed[i] for i in rows), *packed], [*(self.frames[i] for i in rows), *frames]
        self._set_frames(*in_canonical_order(*remaining), floors)
        with convert_array_errors(self._folder, self.localizer):
            self._index(calibrate=self.calibration is not None)


@contextmanager
def convert_array_errors(folder: Path | None, localizer: Localizer) -> Iterator[None]:
    """Raise DataError if the localizer fails in the `with` block, because it cannot index the saved arrays in `folder`,
    or match with them.

    Only the localizer knows which arrays it requires. Therefore any exception that it raises is treated as a sign of
    unsuitable arrays. The message of the DataError names the arrays that are not finite.
    """
    try:
        yield
    except (SalframeError, OSError, MemoryError):
        raise
    except Exception as error:  # libraries raise exceptions of many types
        where = "the map" if folder is None else str(folder)
        names = [] if folder is None else find_not_finite(folder)
        hint = f" (not finite: {', '.join(names)})" if names else ""
        raise DataError(
            f"{where} is damaged: the method {localizer.name!r} cannot read the arrays{hint}; build the map again"
        ) from error
