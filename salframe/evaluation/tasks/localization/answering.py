"""The worker of the task `localization`: answers of a localizer to queries, and their costs, one fold (a map and its
queries) after the other."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from salframe.evaluation.runs.memory import peak_memory_mb
from salframe.evaluation.runs.rows import DescriptionLine, MapLine, Row, RowWriter, read_rows
from salframe.evaluation.runs.run_folder import DESCRIPTIONS, MAPS
from salframe.evaluation.runs.task import Worker
from salframe.evaluation.tasks.localization.survey import Query
from salframe.framework.errors import (
    FRAME_ERRORS,
    DataError,
    InputMissing,
    InvalidAnswer,
    MethodFailed,
    MethodUnavailable,
    describe_error,
)
from salframe.framework.files.cache import Cache
from salframe.localization.answers import Localization
from salframe.localization.described_query import DescribedView, describe_view
from salframe.localization.describing import describe_frame
from salframe.localization.fusing import FUSED, Fusion
from salframe.localization.level_frames import level_key
from salframe.localization.localizer import Description, Localizer
from salframe.localization.map import LocalizationMap
from salframe.localization.unusable_frames import check_unusable, unusable_note
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import Fold, QueryFrame, ReferenceFrame

TOP_PLACES = 10
"""Maximum number of places of an answer that a row holds."""


class Answering(Worker[Query]):
    """Runs a localizer on queries, fold by fold. A fold is a map and its queries."""

    _map: LocalizationMap
    """The map of the fold that was prepared."""

    def __init__(
        self, localizer: Localizer, dataset: Dataset, todo: Sequence[Query], folder: Path, fusion: Fusion
    ) -> None:
        folds = {piece.fold.id: piece.fold for piece in todo}
        frames: list[ReferenceFrame | QueryFrame] = []
        for fold in folds.values():
            frames += fold.references
        frames += [view for piece in todo for view in piece.frame.views]
        self._fusion, self._fused = fusion, list[str]()
        self._localizer, self._floors, self._fold = localizer, dataset.floors(), ""
        self._places: dict[str, str] = {}
        self._descriptions = _Descriptions(localizer, dataset.content_key, frames, folder / DESCRIPTIONS)
        self._measured = {row.fold for row in read_rows(folder / MAPS, MapLine)}
        self._maps = RowWriter(folder / MAPS)
        self._completed: dict[str, str] = {}
        self._unusable_frames: dict[str, DataError | InputMissing] = {}
        self._unusable_queries: list[str] = []

    def prepare(self, piece: Query) -> None:
        if piece.fold.id == self._fold:
            return
        try:
            self._map = self._index(piece.fold)
        except MethodFailed:
            raise
        except InputMissing as error:
            raise MethodUnavailable(str(error)) from error
        except Exception as error:  # without a map a method cannot answer any query
            raise MethodFailed(describe_error(error)) from error
        self._fold = piece.fold.id

    def work(self, piece: Query) -> Row:
        try:
            views = [self._descriptions.take_view(view) for view in piece.frame.views]
            query = self._map.describe_query(views, piece.frame.T_last_view)
        except FRAME_ERRORS as error:
            self._unusable_queries.append(str(error))
            raise
        start = time.perf_counter()
        answer = self._map.answer_query(query, self._fusion)
        query_ms = (time.perf_counter() - start) * 1e3
        self._fused += [note for note in answer.notes if FUSED in note]
        for ranked in answer.places:
            if self._places.get(ranked.frame) != ranked.place:
                raise InvalidAnswer(
                    f"the function `match` of the method returned the frame {ranked.frame!r} with the place "
                    f"{ranked.place!r}, but the map has no reference frame with this id and place"
                )
        return {**answer_row(answer, query.seconds * 1e3, query_ms), "status": answer.status, "error": None}

    def _index(self, fold: Fold) -> LocalizationMap:
        """Index the reference frames of a fold.

        Frames that cannot be used are left out, and `warning` reports them. Raises InputMissing or DataError if there
        are too many of them.
        """
        descriptions, frames = [], []
        unusable_frames: dict[str, DataError | InputMissing] = {}
        for frame in fold.references:
            try:
                description, _ = self._descriptions.take(frame)
            except FRAME_ERRORS as error:
                unusable_frames[frame.id] = error
            else:
                descriptions.append(description)
                frames.append(frame)
        check_unusable(unusable_frames, len(fold.references))
        self._unusable_frames |= unusable_frames
        indexed = LocalizationMap.from_descriptions(
            self._localizer,
            descriptions,
            frames,
            self._floors,
            calibrate=True,
            tell=lambda note: self._completed.update({fold.id: note}),
        )
        self._places = {frame.id: frame.place for frame in frames}
        if fold.id not in self._measured:
            self._measured.add(fold.id)
            self._maps.append({"fold": fold.id, "frames": len(frames), "bytes": indexed.num_bytes()})
        return indexed

    def close(self) -> None:
        self._descriptions.close()
        self._maps.close()

    @property
    def warning(self) -> str | None:
        problems = {
            "of maps that have objects without position": list(self._completed.values()),
            "of query panoramas that cannot be used": self._unusable_queries,
            "of queries with several views that were localized view by view": self._fused,
            "of panoramas that the method used only in part": list(self._descriptions.notes.values()),
        }
        parts = [
            f"number {what}: {len(reasons)}, the first: {reasons[0]}" for what, reasons in problems.items() if reasons
        ]
        return "; ".join([*filter(None, [unusable_note(self._unusable_frames)]), *parts]) or None


class _Descriptions:
    """Describes each frame once, caches the description until its last use, and records the time."""

    def __init__(
        self, localizer: Localizer, dataset: str, frames: Sequence[ReferenceFrame | QueryFrame], path: Path
    ) -> None:
        """Prepare to describe `frames`. A frame that is listed n times can be taken n times."""
        self._localizer, self._dataset, self._cache = localizer, dataset, Cache()
        self._uses = Counter(map(self._key, frames))
        self._recorded = {row.frame for row in read_rows(path, DescriptionLine)}
        self._costs = RowWriter(path)
        self._results: dict[str, tuple[Description, float] | Exception] = {}
        self.notes: dict[str, str] = {}

    def take(self, frame: ReferenceFrame | QueryFrame) -> tuple[Description, float]:
        """Return the description of a frame, and the seconds that computing it took.

        Raises one of FRAME_ERRORS on a frame that cannot be used.
        """
        key = self._key(frame)
        if key not in self._results:
            try:
                self._results[key] = self._describe(frame)
            except FRAME_ERRORS as error:
                self._results[key] = error
        self._uses[key] -= 1
        result = self._results[key] if self._uses[key] else self._results.pop(key)
        if isinstance(result, Exception):
            raise result
        return result

    def take_view(self, frame: QueryFrame) -> DescribedView:
        """Return the description of a view of a query. Raises as `take`."""
        return describe_view(self._localizer, frame, self._cache, self._dataset, self.take(frame))

    def _key(self, frame: ReferenceFrame | QueryFrame) -> str:
        """Return the id of a frame and the key of its levelling, which differs between reference frames and queries."""
        return f"{frame.id} {level_key(self._localizer, frame)}"

    def _describe(self, frame: ReferenceFrame | QueryFrame) -> tuple[Description, float]:
        description, seconds = describe_frame(self._localizer, frame, self._cache, self._dataset)
        if note := self._localizer.note(description):
            self.notes[frame.id] = f"{frame.id}: {note}"
        if frame.id not in self._recorded:
            self._recorded.add(frame.id)
            self._costs.append({"frame": frame.id, "ms": seconds * 1e3})
        return description, seconds

    def close(self) -> None:
        self._costs.close()


def answer_row(answer: Localization | None, describe_ms: float | None = None, query_ms: float | None = None) -> Row:
    """Return the result row of an answer; the row of a query without an answer if `answer` is None.

    `pose` holds the 16 numbers of T_world_query row by row, `heading` is heading_rad, and `probabilities` has one
    probability for each of `places`.
    """
    places = answer.places[:TOP_PLACES] if answer else ()
    pose = answer.T_world_query if answer else None
    covariance = answer.covariance if answer else None
    probabilities = [float(place.probability) for place in places if place.probability is not None]
    return {
        "places": [[place.frame, place.place, float(place.score)] for place in places],
        "pose": None if pose is None else np.asarray(pose, float).ravel().tolist(),
        "heading": answer.heading_rad if answer else None,
        "probabilities": probabilities or None,
        "out_of_map_probability": None
        if answer is None or answer.out_of_map_probability is None
        else float(answer.out_of_map_probability),
        "accepted": answer.accepted if answer else False,
        "covariance": None if covariance is None else np.asarray(covariance, float).tolist(),
        "query_ms": query_ms,
        "describe_ms": describe_ms,
        "peak_memory_mb": peak_memory_mb(),
    }
