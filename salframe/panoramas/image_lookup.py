"""Find the frame of a dataset folder that an image file belongs to."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from salframe.framework.errors import DataError
from salframe.panoramas.dataset import MANIFEST
from salframe.panoramas.folder_format import IMAGE_KEYS, Folder, FrameEntry

_NUM_NEIGHBOURS = 2
"""Number of folders above an image whose subfolders may have a manifest that names it with "..": folder/../image."""


class FrameImage(NamedTuple):
    """An image of a frame: the dataset folder, the frame, and the key of the image, such as "rgb"."""

    folder: Folder
    frame: FrameEntry
    key: str


def find_frame_image(path: Path) -> FrameImage | None:
    """Return the frame whose image is at a path; None where no manifest.json names it.

    The manifests are those in the folders above the image, with and without following links, and in their subfolders
    where a manifest names images outside of its folder. An image is compared by its path, in any Unicode normalization,
    and then by its file, so that links to the file are found too.

    Raises:
        DataError: A manifest is malformed, or several frames have this file under other names.
    """
    for root in _roots(path):
        folder = Folder(root)
        named = [
            FrameImage(folder, frame, key)
            for frame in folder.manifest.frames
            for key in IMAGE_KEYS
            if getattr(frame, key)
        ]
        for spell in (_lexical, os.path.realpath):
            target = spell(path)
            matches = [image for image in named if spell(root / getattr(image.frame, image.key)) == target]
            if len({image.frame.id for image in matches}) > 1:
                frames = ", ".join(image.frame.id for image in matches[:3])
                raise DataError(
                    f"{path} is an image of {len(matches)} frames of {root / MANIFEST} ({frames}), expected one: "
                    "pass the id of the frame and --data"
                )
            if matches:
                return matches[0]
    return None


def first_root(path: Path) -> Path | None:
    """Return the dataset folder that most likely contains an image; None where no folder near it has a manifest."""
    return next(_roots(path), None)


def _lexical(path: Path) -> str:
    """Return the absolute path without "." and "..", in Unicode normalization form C; links are not followed."""
    return unicodedata.normalize("NFC", os.path.abspath(path))


def _roots(path: Path) -> Iterator[Path]:
    """Yield the folders whose manifest may name an image, the most likely first, each once."""
    spellings = [Path(os.path.abspath(path)), path.absolute(), Path(os.path.realpath(path))]
    above = [parent for spelling in spellings for parent in spelling.parents]
    beside = [
        manifest.parent
        for spelling in spellings
        for parent in list(spelling.parents)[:_NUM_NEIGHBOURS]
        for manifest in sorted(parent.glob(f"*/{MANIFEST}"))
    ]
    seen = set()
    for folder in (*above, *beside):
        if (folder / MANIFEST).exists() and (real := os.path.realpath(folder)) not in seen:
            seen.add(real)
            yield folder
