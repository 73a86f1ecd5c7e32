"""The queries of a data set, and their ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from salframe.evaluation.runs.records import Survey
from salframe.panoramas.frames import Fold, FrameKind, QueryFrame, Truth


@dataclass(frozen=True, eq=False)
class Query:
    """A query, and the fold whose map it is localized in."""

    fold: Fold
    frame: QueryFrame


@dataclass(frozen=True, eq=False)
class LocalizationSurvey(Survey[Query]):
    """All queries of a data set to localize, each with the fold that contains its map."""

    def truths(self) -> tuple[Truth, ...]:
        """Return the ground truth of each query, in order. Only measuring code may use it."""
        return tuple(self.dataset.truth(piece.frame.id) for piece in self.pieces)

    def doorways(self) -> frozenset[str]:
        """Return the doorways among the places of the maps: places whose reference frames all show a doorway."""
        folds = {piece.fold.id: piece.fold for piece in self.pieces}.values()
        frames = [frame for fold in folds for frame in fold.references]
        scenes = {frame.place for frame in frames if frame.kind is FrameKind.SCENE}
        return frozenset(frame.place for frame in frames) - scenes

    def present(self) -> np.ndarray:
        """Return whether the map of each query contains its place, (Q,) bool."""
        folds = {piece.fold.id: piece.fold for piece in self.pieces}
        places = {id: {frame.place for frame in fold.references} for id, fold in folds.items()}
        paired = zip(self.pieces, self.truths(), strict=True)
        return np.array([truth.place in places[piece.fold.id] for piece, truth in paired], bool)
