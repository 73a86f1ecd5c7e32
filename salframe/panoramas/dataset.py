"""The role `dataset`: a source of panoramas."""

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
from salframe.panoramas.floors import Connection, FloorMasks
from salframe.panoramas.frames import Fold, Truth
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_view import view_queries, view_settings

MANIFEST = "manifest.json"
"""Name of the file that makes a folder of panoramas a dataset (panoramas/folder_format.py)."""


class Dataset(Role):
    """A source of reference frames with poses, of queries, and of the true places and poses of the queries."""

    role = "dataset"
    presets = "data"
    engine: Engine | None = None
    """The engine that runs the jobs of `prepare`; None: the default engine."""

    @property
    @abstractmethod
    def provides(self) -> frozenset[str]:
        """Parts that all panoramas have, a subset of {"rgb", "range", "annotations"}. Available before `prepare`."""

    @property
    @abstractmethod
    def fingerprint(self) -> str:
        """Digest of the content of all frames and truths, part of every cache key.

        It does not depend on the settings of QueryView (changes of the queries, such as a narrow field of view).
        """

    @final
    @property
    def content_key(self) -> str:
        """Cache key of the content: a digest of name, version, fingerprint and the settings of QueryView (changes of
        the queries, such as a narrow field of view).

        A new version of the component changes every key.
        """
        view = view_settings(self.config)
        return digest([self._stored_key, view]) if view else self._stored_key

    @property
    def _stored_key(self) -> str:
        return digest([self.name, self.version, self.fingerprint])

    @final
    @property
    def query_key(self) -> str:
        """Key that identifies the maps and queries of a run: a digest of the fingerprint of the dataset and of its
        changed `match_only` settings.

        These settings select reference frames and queries, or change queries when they are loaded. They do not change
        stored panoramas. Runs that differ only in these settings share the descriptions of the same panoramas.
        """
        chosen = matching_settings(self.config)
        return digest([self.fingerprint, chosen]) if chosen else self.fingerprint

    def prepare(self, progress: Callable[[int, int], None]) -> None:
        """Do the long work that can be resumed (rendering, indexing) before the first call of `folds`.

        Args:
            progress: Called as progress(done, total).
        """

    @property
    def rendered(self) -> bool:
        """Whether annotations and ranges come from a renderer and are free of errors. Available after `prepare`."""
        return False

    @abstractmethod
    def folds(self) -> Sequence[Fold]:
        """Return the folds.

        A fold has the reference frames of one map, with poses, and the queries to localize in this map, without poses.
        Most datasets have one fold. Leave-one-out evaluation has many.
        """

    @final
    def view(self, folds: Sequence[Fold]) -> list[Fold]:
        """Return the folds with the settings of QueryView (such as a narrow field of view) applied to the queries.

        If the Config of a subclass has these settings, its `folds` must call this method and return the result. The
        cache keys of reference frames do not depend on these settings.
        """
        if not view_settings(self.config):
            return list(folds)
        return view_queries(folds, self.config, self._stored_key)

    @abstractmethod
    def truth(self, query_id: str) -> Truth:
        """Return the true pose and place of a query. Only the evaluation calls it."""

    def floors(self) -> Sequence[FloorMasks]:
        """Return the floor masks, seen from above. Empty if the dataset has none."""
        return ()

    def connections(self) -> Sequence[Connection]:
        """Return the stairs and lifts between the floors, whose ends are names of places; empty if none are known."""
        return ()

    def room_types(self) -> Mapping[str, str]:
        """Return the room type of each place, such as "kitchen"; places of unknown type are missing.

        Only the evaluation calls it.
        """
        return {}

    def observe(self, T_world_pano: np.ndarray) -> Panorama:
        """Render the panorama of a query at a new pose.

        If the Config of a subclass has the settings of QueryView, the subclass must apply `as_query` to the panorama.

        Args:
            T_world_pano: (4, 4) pose of the query.

        Raises:
            InputMissing: The dataset cannot render.
        """
        raise InputMissing(
            f"the dataset {self.name} cannot render panoramas at new poses, because it has only recorded panoramas: "
            "use a dataset that renders, such as house"
        )
