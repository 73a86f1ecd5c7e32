"""The class `LocalizationMap`: a localizer and the reference frames that it localizes queries with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError, InputMissing, InvalidAnswer
from salframe.framework.files.cache import Cache
from salframe.framework.files.columns import Columns, check_kinds
from salframe.framework.validation import validate
from salframe.graphs.detections import Detections
from salframe.graphs.vocabulary import unknown_labels_note
from salframe.localization.answers import Localization
from salframe.localization.calibration import OTHER_CALIBRATION, acceptance_limit, add_probabilities
from salframe.localization.described_query import DescribedQuery, DescribedView, describe_query, describe_view
from salframe.localization.describing import describe_ahead
from salframe.localization.detecting import DetectingLocalizer
from salframe.localization.fusing import FUSED, Fusion, choose_surest, fuse_answers
from salframe.localization.level_frames import better_answer, level_motions, split_level, unlevel_answer
from salframe.localization.localizer import Description, Localizer
from salframe.localization.next_view import next_view_of
from salframe.localization.posterior import Posterior
from salframe.localization.preparing import Tell, python_warning, silent
from salframe.localization.query_input import query_frame
from salframe.localization.reference_map import ReferenceMap, convert_array_errors
from salframe.panoramas.camera_height import LevelSurfaces
from salframe.panoramas.data_checks import query_notes
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.opening import reference_frames
from salframe.panoramas.panorama import Annotations, Panorama
from salframe.panoramas.view import View, motions


class LocalizationMap(ReferenceMap):
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
        with nullcontext() if self._folder is None else convert_array_errors(self._folder, self.localizer):
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

    If the number of workers of the engine is set, the workers first compute the descriptions of the frames.

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
