"""Find the frame of a dataset folder that an image file belongs to."""

from __future__ import annotations

import os
import unicodedata
from pathlib import Path
from typing import NamedTuple

from salframe.framework.errors import DataError
from salframe.panoramas.dataset import MANIFEST
from salframe.panoramas.folder_format import IMAGE_KEYS, FrameEntry
from salframe.panoramas.folder_reader import Folder

_NUM_NEIGHBOURS = 2
"""Number of folders above an image whose subfolders may have a manifest that names it, as ../images/a.png."""


class FrameImage(NamedTuple):
    """An image of a frame: the dataset folder, the frame, and the key of the image, such as "rgb"."""

    folder: Folder
    frame: FrameEntry
    key: str


def find_frame_image(path: Path) -> FrameImage | None:
    """Return the frame whose image is at a path; None if no manifest.json names it.

    The search starts with the manifests in the folders above the image (`dataset_folders`). If none of them names the
    image, it continues in the subfolders of the nearest two folders above the image, because a manifest may name images
    outside of its folder. Malformed manifests in these subfolders are ignored. An image is compared by its path, in any
    Unicode normalization, and then by the file that its symbolic links lead to.

    Raises:
        DataError: A manifest in a folder above the image is malformed, or several of its frames name the image.
    """
    for root in dataset_folders(path):
        if image := _find_in(Folder(root), path):
            return image
    above = list(Path(os.path.abspath(path)).parents)[:_NUM_NEIGHBOURS]
    for manifest in sorted(file for parent in above for file in parent.glob(f"*/{MANIFEST}")):
        try:
            image = _find_in(Folder(manifest.parent), path)
        except DataError:
            continue
        if image:
            return image
    return None


def dataset_folders(path: Path) -> list[Path]:
    """Return the folders above a path that have a manifest, the nearest first.

    A path with symbolic links has two chains of parent folders: those of the path as written, and those of the file
    that the links lead to. Both chains are searched. A folder that is in both chains is returned once.
    """
    spellings = [Path(os.path.abspath(path)), path.absolute(), Path(os.path.realpath(path))]
    folders = [parent for spelling in spellings for parent in spelling.parents if (parent / MANIFEST).exists()]
    return list({os.path.realpath(folder): folder for folder in reversed(folders)}.values())[::-1]


def _find_in(folder: Folder, path: Path) -> FrameImage | None:
    frames = folder.manifest.frames
    named = [FrameImage(folder, frame, key) for frame in frames for key in IMAGE_KEYS if getattr(frame, key)]
    for spell in (_lexical, os.path.realpath):
        target = spell(path)
        matches = [image for image in named if spell(folder.root / getattr(image.frame, image.key)) == target]
        ids = list(dict.fromkeys(image.frame.id for image in matches))
        if len(ids) > 1:
            raise DataError(
                f"{path} is the image of {len(ids)} frames of {folder.root / MANIFEST} ({', '.join(ids[:3])}), "
                "expected the image of one frame: pass the id of one frame instead of the path, and the dataset with "
                "--data"
            )
        if matches:
            return matches[0]
    return None


def _lexical(path: Path) -> str:
    """Return the absolute path without "." and "..", in Unicode normalization form C; links are not followed."""
    return unicodedata.normalize("NFC", os.path.abspath(path))
