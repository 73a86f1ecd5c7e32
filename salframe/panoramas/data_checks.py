"""Checks of datasets and queries before they are used: one-line warnings where their conventions seem to be others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.panoramas.camera_height import camera_height, units_note
from salframe.panoramas.cube_depth import is_cube_depth
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.opening import reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.pose_checks import pose_notes
from salframe.panoramas.range_missing import missing_note
from salframe.panoramas.region_check import check_regions

MAX_HEIGHT_ERROR = 0.07
"""Maximum relative difference of two heights of one camera."""


def data_notes(dataset: Dataset) -> list[str]:
    """Return warnings about a prepared dataset; empty where its conventions are as expected.

    The unit of the ranges, values without a reading and the poses of the first fold are checked on a sample of the
    reference frames, the places and the up directions on all of them.

    Raises:
        DataError: Many panoramas are not upright by their poses, many frames stand outside the region of their place,
            or the floor masks are malformed.
    """
    folds, frames, floors = dataset.folds(), reference_frames(dataset), dataset.floors()
    notes = units_note(frames), missing_note(frames), check_regions(frames, floors)
    return [*(note for note in notes if note), *(pose_notes(folds[0].references, floors) if folds else [])]


def query_notes(panorama: Panorama, references: Sequence[ReferenceFrame] = ()) -> list[str]:
    """Return warnings about a query; empty where its range is as expected, and where it has none.

    Args:
        panorama: The query.
        references: Frames of the map in which it is localized. Their heights tell a camera that hangs upside down.
    """
    if panorama.range_m is None:
        return []
    if is_cube_depth(panorama.range_m):
        return [
            f"the range image of {panorama.id} holds z-depth of cube faces, in which straight walls bend, expected "
            "range along the ray: declare its kind, cube"
        ]
    z_m = [float(frame.T_world_pano[2, 3]) for frame in references]
    notes = [note] if (note := units_note([panorama], z_m)) else []
    floor_m, ceiling_m = camera_height(panorama.range_m), camera_height(panorama.range_m[::-1])
    if floor_m is not None and ceiling_m is not None and z_m:
        z_error, turned_error = (
            min(abs(np.log(z / h)) if z > 0 else np.inf for z in z_m) for h in (floor_m, ceiling_m)
        )
        if turned_error <= MAX_HEIGHT_ERROR < 2 * MAX_HEIGHT_ERROR < z_error:
            notes.append(
                f"{panorama.id} seems to be upside down: it shows the floor {floor_m:.2f} m below the camera and the "
                f"ceiling {ceiling_m:.2f} m above, and the cameras of the map are {np.median(z_m):.2f} m high"
            )
    return notes
