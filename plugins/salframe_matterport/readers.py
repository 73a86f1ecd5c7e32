"""The official files: connectivity of the Matterport3D Simulator, boxes of REVERIE, regions of the viewpoints."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from salframe.framework.errors import DataError
from salframe.framework.files import read_json
from salframe.panoramas.geometry import pose_2d


@dataclass(frozen=True, eq=False)
class Boxes:
    """An object in the views of one viewpoint: its label, the views that see it (K,) int64, its boxes (K, 4) x, y,
    width, height in pixels."""

    label: str
    view: np.ndarray
    box_px: np.ndarray


NO_LABEL = "-"
"""The label of a region that nobody has labelled."""


@contextmanager
def format_of(path: Path) -> Iterator[None]:
    """Say which file is malformed."""
    try:
        yield
    except KeyError as error:
        raise DataError(f"{path} has no key {error}") from None
    except (AttributeError, IndexError, TypeError, ValueError) as error:
        raise DataError(f"{path} is not in the official format: {error}") from None


def connectivity_path(root: Path, scan: str) -> Path:
    return root / "connectivity" / f"{scan}_connectivity.json"


def boxes_path(root: Path, scan: str, viewpoint: str) -> Path:
    return root / "reverie" / "BBox" / f"{scan}_{viewpoint}.json"


def regions_path(root: Path) -> Path:
    return root / "vp2room_label.json"


def find_scans(root: Path) -> list[str]:
    """The buildings that have a connectivity file, sorted. Raises DataError where there is none."""
    suffix = "_connectivity.json"
    scans = sorted(path.name.removesuffix(suffix) for path in connectivity_path(root, "*").parent.glob(f"*{suffix}"))
    if not scans:
        received = "a folder without any" if root.is_dir() else "no folder"
        raise DataError(
            f"{root} is {received}, expected connectivity/*{suffix}, reverie/BBox/*.json and vp2room_label.json in it"
        )
    return scans


def read_connectivity(path: Path) -> dict[str, np.ndarray]:
    """T_world_pano (4, 4) of the included viewpoints of a building, by viewpoint id, in the order of the file.

    The file's pose has camera axes x right, y down, z forward; the panorama frame stands upright at the camera and
    looks where it looks.
    """
    with format_of(path):
        poses = {}
        for viewpoint in read_json(path):
            if viewpoint["included"]:
                camera = np.array(viewpoint["pose"], float).reshape(4, 4)
                x, y, z = camera[:3, 3]
                poses[viewpoint["image_id"]] = pose_2d(x, y, np.arctan2(camera[1, 2], camera[0, 2]), z)
        return poses


def read_boxes(path: Path, viewpoint: str) -> dict[int, Boxes]:
    """The objects that some view of a viewpoint sees, by their id, which is unique in the building."""
    with format_of(path):
        return {
            int(number): Boxes(
                annotation["name"].replace("#", " ").strip().lower(),
                np.array(annotation["visible_pos"], np.int64),
                np.array(annotation["bbox2d"], float).reshape(len(annotation["visible_pos"]), 4),
            )
            for number, annotation in read_json(path)[viewpoint].items()
            if annotation["visible_pos"]
        }


def read_room_types(path: Path) -> dict[str, dict[int, str]]:
    """Building -> index of a region -> what kind of room it is, in the file's words without their explanation; regions
    without a label are left out."""
    with format_of(path):
        content = read_json(path)
        words = content["label_info"].get("label_name", {})
        return {
            scan: {
                int(entry["region_index"]): words.get(entry["label"], entry["label"]).partition(" (")[0]
                for entry in viewpoints.values()
                if entry["label"] != NO_LABEL
            }
            for scan, viewpoints in content["pano_info"].items()
        }


def read_regions(path: Path) -> dict[str, dict[str, int]]:
    """Building -> viewpoint -> index of its region."""
    with format_of(path):
        return {
            scan: {viewpoint: int(entry["region_index"]) for viewpoint, entry in viewpoints.items()}
            for scan, viewpoints in read_json(path)["pano_info"].items()
        }
