"""The role `dataset`: where panoramas come from."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import final

import numpy as np

from salframe.framework.component import Role
from salframe.framework.components.identity import matching_settings
from salframe.framework.engines.engine import Engine
from salframe.framework.errors import InputMissing
from salframe.framework.files.hashes import digest
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import Fold, Truth
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_view import view_queries, view_settings

MANIFEST = "manifest.json"
"""What makes a folder of panoramas a data set (panoramas/folder_format.py)."""


class Dataset(Role):
    """Panoramas with poses for mapping, panoramas without for queries, and the truth that only evaluation asks for."""

    role = "dataset"
    presets = "data"
    engine: Engine | None = None
    """What does the pieces of `prepare`; the default one where it is None."""

    @property
    @abstractmethod
    def provides(self) -> frozenset[str]:
        """Which of "rgb", "range", "annotations" its panoramas have. Known before `prepare`."""

    @property
    @abstractmethod
    def fingerprint(self) -> str:
        """Changes whenever any frame's content or any truth does, before queries are seen as QueryView says; part of
        every cache key."""

    @final
    @property
    def content_key(self) -> str:
        """What caches know the content by: name, version and fingerprint, so that a new version changes every key, and
        how queries are seen."""
        view = view_settings(self.config)
        return digest([self._stored_key, view]) if view else self._stored_key

    @property
    def _stored_key(self) -> str:
        return digest([self.name, self.version, self.fingerprint])

    @final
    @property
    def question_key(self) -> str:
        """What runs know their questions by: the fingerprint, and with it the settings declared `match_only` where they
        are not the defaults. These choose what maps hold and what is asked of them, and no panorama depends on them, so
        that descriptions are shared between such runs."""
        chosen = matching_settings(self.config)
        return digest([self.fingerprint, chosen]) if chosen else self.fingerprint

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Do what takes long and can be resumed (render, index) before the first fold; `progress(done, total)`."""

    @property
    def rendered(self) -> bool:
        """Whether its annotations and ranges come from a renderer and hold no error of their own. Known after
        `prepare`."""
        return False

    @abstractmethod
    def folds(self) -> Sequence[Fold]:
        """Each fold: reference frames with poses and query frames without. Most sets have one, leave-one-out has many."""

    @final
    def view(self, folds: Sequence[Fold]) -> list[Fold]:
        """The folds with queries seen as the settings of QueryView say: what `folds` of a data set gives whose Config
        has these. Caches know its reference frames as if there were none."""
        if not view_settings(self.config):
            return list(folds)
        return view_queries(folds, self.config, self._stored_key)

    @abstractmethod
    def truth(self, query_id: str) -> Truth:
        """The pose and place of a query. Only the evaluator calls it."""

    def floors(self) -> Sequence[FloorMasks]:
        """The floors seen from above; none where the set has no masks."""
        return ()

    def room_types(self) -> Mapping[str, str]:
        """What kind of room each place is, "kitchen", by the place; places that are missing have no kind that is known.
        For evaluation, like `truth`."""
        return {}

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        """The panorama that a query would show at this pose (4, 4), for data sets that can render; `as_query` where
        the Config has the settings of QueryView.

        Raises InputMissing in those that cannot.
        """
        raise InputMissing(f"{self.name} cannot render: it has panoramas at its own frames only")
