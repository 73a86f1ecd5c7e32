"""The class `LocalizationMap`: a localizer and the reference frames that it localizes queries with."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from salframe.framework.components.installation import folder_bytes
from salframe.framework.components.registry import registry
from salframe.framework.errors import DataError, InputMissing, InvalidAnswer, SalframeError, UnknownName, shorten
from salframe.framework.files.array_files import FileStamp
from salframe.framework.files.cache import Cache
from salframe.framework.files.columns import Columns, check_kinds
from salframe.framework.validation import validate
from salframe.graphs.detections import Detections
from salframe.graphs.scene_index import scene_index_notes
from salframe.graphs.vocabulary import unknown_labels_note
from salframe.localization.answers import Localization
from salframe.localization.calibration import (
    OTHER_CALIBRATION,
    MapCalibration,
    acceptance_limit,
    add_probabilities,
    calibrate_posterior,
    is_calibrated,
)
from salframe.localization.canonical_order import in_canonical_order
from salframe.localization.described_query import DescribedQuery, DescribedView, describe_query, describe_view
from salframe.localization.describing import describe_ahead
from salframe.localization.detecting import DetectingLocalizer
from salframe.localization.fusing import FUSED, Fusion, choose_surest, fuse_answers
from salframe.localization.level_frames import better_answer, level_motions, split_level, unlevel_answer, upright_frame
from salframe.localization.localizer import Description, Localizer
from salframe.localization.map_files import MapParts, find_not_finite, read_map, write_map
from salframe.localization.next_view import next_view_of
from salframe.localization.posterior import Posterior
from salframe.localization.preparing import Tell, python_warning, silent
from salframe.localization.query_input import query_frame
from salframe.localization.references import complete_references, describe_references
from salframe.localization.unusable_frames import check_unusable, unusable_note
from salframe.panoramas.camera_height import LevelSurfaces
from salframe.panoramas.data_checks import query_notes
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.opening import reference_frames
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.panoramas.view import View, motions

MAX_HEIGHTS = 200
"""Maximum number of reference frames whose camera heights are used to check queries."""


class LocalizationMap:
    """A map in which a localizer localizes queries.

    It consists of reference frames (panoramas with known places and poses), their descriptions (features) in packed
    form, and floor masks (images of the free floor and the rooms from above).

    Create one with `build`, `from_descriptions` or `open`. Use a new localizer for each map: a localizer holds the
    index of one map at a time.

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
    ) -> LocalizationMap:
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
    ) -> LocalizationMap:
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
    def open(cls, directory: str | Path, localizer: Localizer | None = None) -> LocalizationMap:
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
    def read(cls, parts: MapParts, *, localizer: Localizer | None = None, indexed: bool = True) -> LocalizationMap:
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
        with _convert_array_errors(parts.folder, localizer), warnings.catch_warnings():
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

    def require_false_accept(self, max_false_accept: float) -> None:
        """Accept only answers that pass the conformal test with this maximum false accept rate.

        See `MapCalibration.max_out_of_map_probability`.

        Raises:
            DataError: The localizer computes no probabilities, the map is not calibrated, or the calibration has too
                few out-of-map answers.
            ConfigError: `max_false_accept` is not between 0 and 1.
        """
        posterior = self.localizer.posterior
        if posterior is None:
            raise DataError(
                f"max_false_accept is {max_false_accept:g}, but the answers of the method {self.localizer.name!r} have "
                "no probabilities: build the map with another method, such as 'proposed', or omit max_false_accept"
            )
        settings = {**posterior.model_dump(), "max_false_accept": max_false_accept}
        posterior = validate(Posterior, settings, "posterior")
        acceptance_limit(posterior, self.calibration)
        self.localizer.posterior = posterior

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

    def merge(self, others: Sequence[LocalizationMap], floors: Sequence[FloorMasks] = ()) -> None:
        """Add the frames of other maps, and index the map.

        The other maps must have descriptions of the same method and settings. `floors` are the floors of the map after
        the change.
        """
        packed = [row for other in others for row in other._packed]
        self._replace((), packed, [frame for other in others for frame in other.frames], floors)

    def localize(
        self,
        query: ReferenceFrame | QueryFrame | Panorama | None = None,
        *,
        rgb: np.ndarray | None = None,
        range_m: np.ndarray | None = None,
        annotations: Annotations | None = None,
        views: Sequence[View] | None = None,
        warn: Callable[[str], object] = python_warning,
    ) -> Localization:
        """Localize a frame, a panorama, the images of a panorama, or several views with the motion between them.

        Pass one of: a query, the images of a panorama, or views. For several views, the pose of the answer is the pose
        of the last view. If the last view has a `position_m`, it is the pose of the body (such as a robot) on which the
        camera has this position. If the localizer cannot join views, or their motion is unknown, each view is localized
        alone, and the probabilities are multiplied. A note in the answer states this.

        Args:
            query: The frame or panorama.
            rgb: (H, 2H, 3) uint8, equirectangular, as in Panorama.
            range_m: (H, 2H) float32, metres along the ray, NaN where unknown, as in Panorama.
            annotations: Annotated objects.
            views: Views of one query in the order in which they were taken, instead of the other inputs.
            warn: Called with each warning on the panorama: ranges that seem to be in a wrong unit, and objects without
                a label. The default issues a Python warning.

        Raises:
            InputMissing: The query lacks a part that the localizer requires, such as range. The error suggests
                components that do not need this part.
            DataError: In any of these cases: both a query and images were passed; the query has a wrong type; an image
                is malformed; there are no views; the views have a wrong motion.
        """
        if views is not None:
            if any(part is not None for part in (query, rgb, range_m, annotations)):
                raise DataError(
                    "received both `views` and a query (a frame, a panorama or arrays), expected only one of them"
                )
            T_last_view = motions(views)
            frames = [query_frame(self.localizer, view.panorama) for view in views]
            return self._localize(frames, T_last_view, warn).moved(views[-1].position_m)
        if isinstance(query, QueryFrame) and query.earlier:
            frames = [query_frame(self.localizer, view) for view in query.views]
            return self._localize(frames, query.T_last_view, warn)
        return self._localize([query_frame(self.localizer, query, rgb, range_m, annotations)], None, warn)

    def _localize(
        self, frames: Sequence[QueryFrame], T_last_view: np.ndarray | None, warn: Callable[[str], object]
    ) -> Localization:
        """Localize the views of one query. The views are joined if possible. Raises as `localize`."""
        views = [self._describe_frame(frame, warn) for frame in frames]
        answer = self.answer_query(self.describe_query(views, T_last_view, warn=warn))
        return replace(answer, floors=self.floors)

    def _describe_frame(self, frame: QueryFrame, warn: Callable[[str], object]) -> DescribedView:
        for note in query_notes(frame.load(), self._camera_z_m):
            warn(note)
        return describe_view(self.localizer, frame)

    def describe_panorama(self, panorama: Panorama, *, warn: Callable[[str], object] = python_warning) -> DescribedView:
        """Compute the description (features) of a panorama, and return it as a view for `describe_query`. Raises as
        `localize`."""
        return self._describe_frame(query_frame(self.localizer, panorama), warn)

    def describe_query(
        self,
        views: Sequence[DescribedView],
        T_last_view: np.ndarray | None = None,
        *,
        warn: Callable[[str], object] = silent,
    ) -> DescribedQuery:
        """Combine described views (panoramas with their features) to a query. Arguments and errors are those of the
        function `describe_query`."""
        return describe_query(self.localizer, views, T_last_view, self._camera_z_m, warn)

    def describe_detections(self, detections: Detections) -> DescribedView:
        """Compute the description (features) of a panorama from its detections, for example from a detector outside of
        salframe.

        Args:
            detections: The detections, in the panorama frame. Its z axis points up.

        Raises:
            InputMissing: The localizer of the map does not use detections.
        """
        if not isinstance(self.localizer, DetectingLocalizer):
            raise InputMissing(
                f"received detections, which the method {self.localizer.name!r} does not use: pass a panorama, or "
                "build the map with a method that uses detections, such as 'proposed'"
            )
        panorama = Panorama("the detections")
        description = self.localizer.describe_detections(detections, panorama)
        unknown = LevelSurfaces(np.nan, np.nan)  # the query is then not treated as upside down
        return DescribedView(panorama.id, description, unknown, 0.0, lambda: (description, 0.0))

    def answer_query(self, query: DescribedQuery, fusion: Fusion = Fusion.JOINED) -> Localization:
        """Localize a described query.

        If all views seem to be upside down, the query is localized twice: with the original views and with the turned
        views. The better answer is returned.

        Args:
            query: The query.
            fusion: How to combine several views. If views should be joined but cannot be, their answers are fused, and
                a note of the answer states the reason.

        Raises:
            InvalidAnswer: As `answer`.
            DataError: As `answer`.
        """
        answer = self._answer_views(query.descriptions, query.T_last_view, fusion)
        if not query.turned:
            return answer
        return better_answer(answer, self._answer_views(query.turned, query.T_last_view, fusion))

    def _answer_views(
        self, descriptions: Sequence[Description], T_last_view: np.ndarray | None, fusion: Fusion
    ) -> Localization:
        if len(descriptions) == 1:
            return self.answer(descriptions[0])
        reason = ""
        if fusion is Fusion.JOINED:
            joined = None
            if T_last_view is not None:
                flat, rotations = zip(*map(split_level, descriptions), strict=True)
                joined = self.localizer.join(flat, level_motions(T_last_view, rotations), self.localizer.odometry)
                if joined is not None:
                    return self._answer_level(joined, rotations[-1])
            reason = f"the method {self.localizer.name!r} cannot localize several views together"
            if T_last_view is None:
                reason = "the motion between the views is unknown"
        answers = [self.answer(description) for description in descriptions]
        notes = dict.fromkeys(remark for answer in answers for remark in answer.notes)
        if reason:
            notes = {f"{len(answers)} {FUSED}, because {reason}": None, **notes}
        fused = choose_surest(answers, T_last_view) if fusion is Fusion.SUREST else fuse_answers(answers, T_last_view)
        return replace(fused, notes=tuple(notes))

    def answer(self, description: Description) -> Localization:
        """Localize a query from its description.

        If the localizer has a posterior, the answer gets probabilities. A note of the answer names the labels of the
        query that no object of the map has.

        Raises:
            InvalidAnswer: `match` did not return a Localization.
            DataError: A memory-mapped file of the map was changed after the map was opened, or the localizer cannot
                match with the arrays of an opened map.
        """
        return self._answer_level(*split_level(description))

    def _answer_level(self, description: Description, rotation: np.ndarray | None) -> Localization:
        """Localize a query from the description of its levelled panorama. `rotation` is R_level_pano (3, 3); None if it
        was not levelled. Raises as `answer`."""
        if changed := [stamp.path for stamp in self._mapped_files if not stamp.is_current()]:
            raise DataError(f"{changed[0]} was changed while the map was open: open the map again")
        with nullcontext() if self._folder is None else _convert_array_errors(self._folder, self.localizer):
            if not self._is_checked and isinstance(self._packed, Columns):
                check_kinds(self._packed, self.localizer.pack(description))
                self._is_checked = True
            answer = self.localizer.match(description)
        if not isinstance(answer, Localization):
            raise InvalidAnswer(
                f"the function `match` of the method returned {type(answer).__name__}, expected a Localization"
            )
        if labels := self.localizer.unknown_labels(description):
            answer = replace(answer, notes=(*answer.notes, unknown_labels_note(labels)))
        shown = self.localizer.shown_directions(description)
        answer = replace(unlevel_answer(answer, rotation), next_view=None if shown is None else next_view_of(shown))
        posterior = self.localizer.posterior
        if posterior is None or answer.out_of_map_probability is not None:
            return answer
        if self._has_other_calibration and self.calibration is None:
            answer = replace(answer, notes=(*answer.notes, OTHER_CALIBRATION))
        return add_probabilities(answer, posterior, self.calibration, self.localizer.count_objects(description))

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
        with _convert_array_errors(self._folder, self.localizer):
            self._index(calibrate=self.calibration is not None)


def build_localization(
    localizer: Localizer,
    dataset: Dataset,
    progress: Callable[[int, int], None] | None,
    tell: Tell,
    frames: Sequence[ReferenceFrame] | None = None,
    floors: Sequence[FloorMasks] | None = None,
    *,
    calibrate: bool = True,
) -> LocalizationMap:
    """Build the map of a prepared dataset. Raises as `LocalizationMap.build`.

    If the engine has a number of workers, the workers describe the frames first.

    Args:
        localizer: The localizer.
        dataset: The dataset.
        progress: As in `LocalizationMap.build`.
        tell: As in `LocalizationMap.build`.
        frames: Frames that replace the reference frames of the dataset, for example with other place names; None: the
            reference frames of the dataset.
        floors: Floors that replace the floors of the dataset; None: the floors of the dataset.
        calibrate: As in `LocalizationMap.build`.
    """
    describe_ahead(localizer.config, dataset, progress)
    frames = reference_frames(dataset) if frames is None else frames
    floors = dataset.floors() if floors is None else floors
    return LocalizationMap.build(
        localizer,
        frames,
        Cache(),
        dataset.content_key,
        floors=floors,
        calibrate=calibrate,
        progress=progress,
        tell=tell,
    )


def open_map(directory: str | Path, *, max_false_accept: float | None = None) -> LocalizationMap:
    """Open a saved map, ready to localize any number of panoramas.

    Args:
        directory: The folder of the map.
        max_false_accept: Maximum false accept rate, see `LocalizationMap.require_false_accept`; None: the setting of
            the map.

    Raises:
        DataError: `directory` contains no map, or the map was edited or is incomplete.
        UnknownName: The localizer of the map is not installed.
    """
    opened = LocalizationMap.open(directory)
    if max_false_accept is not None:
        opened.require_false_accept(max_false_accept)
    return opened


@contextmanager
def _convert_array_errors(folder: Path | None, localizer: Localizer) -> Iterator[None]:
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
