"""`folder`: panoramas in the open folder format."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial
from pathlib import Path

from pydantic import Field

from salframe.config import ComponentConfig
from salframe.errors import DataError
from salframe.roles import Dataset
from salframe.types import FloorMasks, Fold, Frame, Truth
from salframe_folder.format import Folder, pose_matrix


class FolderDataset(Dataset):
    """Your own panoramas: a folder with a manifest.json (docs/reference/folder-format.md)."""

    name = "folder"
    version = "1"

    class Config(ComponentConfig):
        root: Path | None = Field(None, description="the folder with the manifest.json")

    @property
    def root(self) -> Path:
        """The folder that is read."""
        if self.config.root is None:
            raise DataError(f"{self.name} needs the folder of a dataset: name it instead of '{self.name}', or give --data-dir DIR")
        return self.config.root

    @cached_property
    def _folder(self) -> Folder:
        return Folder(self.root)

    @property
    def provides(self) -> frozenset[str]:
        return self._folder.provides

    @property
    def fingerprint(self) -> str:
        return self._folder.fingerprint

    def folds(self) -> Sequence[Fold]:
        frames = [
            (entry.role, Frame(entry.id, partial(self._folder.load, entry), pose_matrix(entry.pose), entry.place))
            for entry in self._folder.manifest.frames
        ]
        mapping = tuple(frame for role, frame in frames if role != "query")
        return [Fold(self.root.name, mapping, tuple(frame for role, frame in frames if role == "query"))]

    def truth(self, query_id: str) -> Truth:
        return self._folder.truth(query_id)

    def floors(self) -> Sequence[FloorMasks]:
        return self._folder.floors()
