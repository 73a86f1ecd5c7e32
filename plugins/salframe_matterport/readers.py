"""Readers of the official files: connectivity (Matterport3D Simulator), boxes (REVERIE) and regions of viewpoints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field, StrictBool, model_validator

from salframe.framework.errors import DataError
from salframe.framework.files.reading import read_as
from salframe.framework.validation import MAX_NUMBER
from salframe.panoramas.geometry import pose_2d
from salframe_matterport.bearings import VIEWS


@dataclass(frozen=True, eq=False)
class Boxes:
    """An object in the views of one viewpoint.

    Attributes:
        label: Label of the object.
        view: Indices (K,) int64 of the views that show the object.
        box_px: Boxes (K, 4) of the object in these views: x, y, width, height in pixels.
    """

    label: str
    view: np.ndarray
    box_px: np.ndarray


NO_LABEL = "-"
"""Label of a region without an annotation."""


Number = Annotated[float, Field(strict=True, ge=-MAX_NUMBER, le=MAX_NUMBER)]


class ConnectivityViewpoint(BaseModel):
    """A viewpoint of a connectivity file.

    Attributes:
        image_id: Id of the viewpoint.
        pose: Camera pose, 4 x 4, row by row.
        included: Whether the viewpoint is part of the simulator.
        unobstructed: Whether the way to each viewpoint of the file is free.
        height: Height of the camera above the floor in metres.
    """

    image_id: str
    pose: tuple[Number, ...] = Field(min_length=16, max_length=16)
    included: StrictBool
    unobstructed: tuple[StrictBool, ...] | None = None
    height: Number | None = None


class _Annotation(BaseModel):
    """An object in a box file: the views that show it, and its box in each view."""

    name: str
    visible_pos: tuple[Annotated[int, Field(strict=True, ge=0, lt=VIEWS)], ...]
    bbox2d: tuple[tuple[Number, Number, Number, Number], ...]

    @model_validator(mode="after")
    def _a_box_a_view(self) -> _Annotation:
        if len(self.bbox2d) != len(self.visible_pos):
            raise ValueError(
                f"the object {self.name} has {len(self.bbox2d)} boxes in bbox2d and {len(self.visible_pos)} "
                "views in visible_pos, expected one box for each view"
            )
        return self


class _HouseRegion(BaseModel):
    region_index: int
    label: str | None = None


class _Labels(BaseModel):
    label_name: dict[str, str] = {}


class _RoomLabels(BaseModel):
    """Content of vp2room_label.json."""

    pano_info: dict[str, dict[str, _HouseRegion]]
    label_info: _Labels = _Labels()


def connectivity_path(root: Path, scan: str) -> Path:
    return root / "connectivity" / f"{scan}_connectivity.json"


def boxes_path(root: Path, scan: str, viewpoint: str) -> Path:
    return root / "reverie" / "BBox" / f"{scan}_{viewpoint}.json"


def regions_path(root: Path) -> Path:
    return root / "vp2room_label.json"


def find_scans(root: Path) -> list[str]:
    """Return the sorted names of the buildings with a connectivity file. Raises DataError if there is none."""
    suffix = "_connectivity.json"
    scans = sorted(path.name.removesuffix(suffix) for path in connectivity_path(root, "*").parent.glob(f"*{suffix}"))
    if not scans:
        received = "a folder without connectivity files" if root.is_dir() else "not a folder"
        raise DataError(
            f"{root} is {received}, expected a folder with connectivity/*{suffix}, reverie/BBox/*.json and "
            f"vp2room_label.json"
        )
    return scans


def read_viewpoints(path: Path) -> tuple[ConnectivityViewpoint, ...]:
    """Read the viewpoints of a connectivity file in its order. Raises DataError if the file is malformed."""
    listed: tuple[ConnectivityViewpoint, ...] = tuple(read_as(path, list[ConnectivityViewpoint]))
    names = {viewpoint.image_id for viewpoint in listed}
    if len(names) < len(listed):
        raise DataError(
            f"{path} lists {len(listed)} viewpoints with {len(names)} distinct ids, expected a different id for each"
        )
    return listed


def read_ways(path: Path) -> set[tuple[str, str]]:
    """Read the ways: pairs of viewpoints between which a connectivity file has an unobstructed way.

    Raises:
        DataError: The file is malformed.
    """
    listed = read_viewpoints(path)
    ways = set()
    for viewpoint in listed:
        if viewpoint.unobstructed is None:
            raise DataError(
                f"{path} has a viewpoint without the key 'unobstructed', expected the key in every viewpoint"
            )
        if len(viewpoint.unobstructed) != len(listed):
            raise DataError(
                f"{path}: the key 'unobstructed' of the viewpoint {viewpoint.image_id} has "
                f"{len(viewpoint.unobstructed)} values, "
                f"expected one for each of {len(listed)} viewpoints"
            )
        free = zip(listed, viewpoint.unobstructed, strict=True)
        ways |= {(viewpoint.image_id, other.image_id) for other, clear in free if clear}
    return ways


def read_connectivity(path: Path) -> dict[str, np.ndarray]:
    """Read T_world_pano (4, 4) of the included viewpoints of a building, by viewpoint id, in the order of the file.

    Camera axes in the file are x right, y down, z forward. The panorama frame is upright at the camera position and has
    the azimuth of the camera's forward axis.
    """
    poses = {}
    for viewpoint in read_viewpoints(path):
        if viewpoint.included:
            camera = np.array(viewpoint.pose).reshape(4, 4)
            x, y, z = camera[:3, 3]
            poses[viewpoint.image_id] = pose_2d(x, y, np.arctan2(camera[1, 2], camera[0, 2]), z)
    return poses


def read_boxes(path: Path, viewpoint: str) -> dict[int, Boxes]:
    """Read the objects visible from a viewpoint, by object id. Ids are unique within the building."""
    content: dict[str, dict[int, _Annotation]] = read_as(path, dict[str, dict[int, _Annotation]])
    if viewpoint not in content:
        raise DataError(f"{path} has no key {viewpoint!r}, expected a key equal to the viewpoint id in its file name")
    return {
        number: Boxes(
            annotation.name.replace("#", " ").strip().lower(),
            np.array(annotation.visible_pos, np.int64),
            np.array(annotation.bbox2d, float),
        )
        for number, annotation in content[viewpoint].items()
        if annotation.visible_pos
    }


def read_room_types(path: Path) -> dict[str, dict[int, str]]:
    """Read the room type of each region: building -> region index -> room type.

    An explanation in parentheses is removed from a room type. Regions without a label are left out.
    """
    content: _RoomLabels = read_as(path, _RoomLabels)
    types: dict[str, dict[int, str]] = {}
    for scan, viewpoints in content.pano_info.items():
        types[scan] = {}
        for region in viewpoints.values():
            if region.label is None:
                raise DataError(
                    f"{path} has no label for the region {region.region_index} of the building {scan}, expected a label"
                )
            if region.label != NO_LABEL:
                word = content.label_info.label_name.get(region.label, region.label)
                types[scan][region.region_index] = word.partition(" (")[0]
    return types


def read_regions(path: Path) -> dict[str, dict[str, int]]:
    """Read the region of each viewpoint: building -> viewpoint -> region index."""
    content: _RoomLabels = read_as(path, _RoomLabels)
    return {
        scan: {viewpoint: region.region_index for viewpoint, region in viewpoints.items()}
        for scan, viewpoints in content.pano_info.items()
    }
