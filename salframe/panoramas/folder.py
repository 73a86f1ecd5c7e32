"""`folder`: panoramas in the open folder format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field

from salframe.framework.errors import DataError
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import Connection, FloorMasks
from salframe.panoramas.frames import Fold, Truth
from salframe.panoramas.hidden_places import add_hidden_places, hide_query_place_setting
from salframe.panoramas.query_view import QueryView

if TYPE_CHECKING:
    from salframe.panoramas.folder_reader import Folder


class FolderDataset(Dataset):
    """Panoramas in a folder with a manifest.json. `salframe docs folder-format` describes the format."""

    name = "folder"
    version = "3"

    class Config(QueryView):
        root: Path | None = Field(
            None, description="path of the folder that contains manifest.json; required (`--data FOLDER` sets it)"
        )
        hide_query_place: bool = hide_query_place_setting()

    @property
    def root(self) -> Path:
        """The folder of the dataset."""
        if self.config.root is None:
            raise DataError(
                f"received the dataset {self.name!r} without a folder: pass the path of a folder of panoramas instead "
                f"of the name {self.name!r}, or pass the path as --data-dir"
            )
        return self.config.root

    @cached_property
    def _folder(self) -> Folder:
        from salframe.panoramas.folder_reader import Folder

        return Folder(self.root)

    @property
    def contents(self) -> Mapping[str, str]:
        """Mapping from the id of a frame to the cache key of its panorama (`ReferenceFrame.content`). The `content_key`
        of the dataset is used for frames without an entry."""
        return {}

    @property
    def provides(self) -> frozenset[str]:
        """Parts that every frame has."""
        return self._folder.provides

    @property
    def rendered(self) -> bool:
        return self._folder.manifest.rendered

    @property
    def fingerprint(self) -> str:
        return self._folder.fingerprint

    def folds(self) -> Sequence[Fold]:
        entries = self._folder.manifest.frames
        contents = self.contents
        references = tuple(
            self._folder.reference_frame(entry, contents.get(entry.id, ""))
            for entry in entries
            if entry.role != "query"
        )
        queries = tuple(self._folder.query_frames(contents))
        folds = self.view([Fold("all", references, queries)])
        hidden = getattr(self.config, "hide_query_place", False)  # datasets that render may lack this setting
        return add_hidden_places(folds, self.truth, self.floors()) if hidden else folds

    def truth(self, query_id: str) -> Truth:
        return self._folder.truth(query_id)

    def floors(self) -> Sequence[FloorMasks]:
        return self._folder.floors()

    def connections(self) -> Sequence[Connection]:
        return self._folder.connections()
