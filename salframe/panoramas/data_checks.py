"""Checks of datasets and queries before use: one-line warnings about units and conventions that are probably wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.panoramas.camera_height import NUM_FRAMES, LevelSurfaces, units_note
from salframe.panoramas.cube_depth import is_cube_depth
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.floors import FloorMasks
from salframe.panoramas.frames import Fold
from salframe.panoramas.opening import distinct_references
from salframe.panoramas.panorama import Panorama, unlabelled_note
from salframe.panoramas.place_heights import storeys_note
from salframe.panoramas.pose_checks import pose_notes
from salframe.panoramas.range_missing import missing_note
from salframe.panoramas.region_check import check_regions
from salframe.panoramas.samples import Frame, load_samples

MAX_HEIGHT_ERROR = 0.07
"""Maximum relative difference between two heights that count as equal."""


def data_notes(dataset: Dataset) -> list[str]:
    """Return warnings about a prepared dataset; empty if its conventions are as expected. See `fold_notes`."""
    return fold_notes(dataset.folds(), dataset.floors())


def fold_notes(folds: Sequence[Fold], floors: Sequence[FloorMasks] = ()) -> list[str]:
    """Return warnings about the conventions of folds (maps with their queries); empty if the conventions are as
    expected.

    A sample of all reference frames is checked for the unit of the ranges and for values that mean an unknown range.
    The places of all reference frames are compared with the floor masks and with the storeys. The poses of the first
    fold are compared with its range images. Queries whose views have an unknown motion are reported.

    Raises:
        DataError: In any of these cases: according to their poses, many panoramas are tilted; many frames stand outside
            the region of their place; the floor masks are malformed.
    """
    frames = distinct_references(folds)
    units = units_note(frames)
    notes = units, missing_note(frames), storeys_note(frames), check_regions(frames, floors), motion_note(folds)
    references = folds[0].references if folds else ()
    # Ranges in a wrong unit contradict the poses in any case.
    return [*(note for note in notes if note), *pose_notes(references, floors, compares_ranges=units is None)]


def motion_note(folds: Sequence[Fold]) -> str | None:
    """Return a one-line note if the motion between the views of queries is unknown; None if it is known."""
    queries = {query.id: query for fold in folds for query in fold.queries if query.earlier}
    unknown = [id for id, query in queries.items() if query.T_last_view is None]
    if not unknown:
        return None
    return (
        f"{len(unknown)} of {len(queries)} queries with several views have no motion between the views, such as "
        f"{unknown[0]}, expected odometry (measured camera motion) at the times t_s of all views: each view is "
        "localized alone, and the answers are combined"
    )


def picture_note(frames: Sequence[Frame]) -> str | None:
    """Return a one-line note if the file reader changed the images of frames, for example their size; else None.

    A few of the frames are loaded. Those that cannot be read are ignored.
    """
    panoramas = [panorama for _, panorama in load_samples(frames, NUM_FRAMES)]
    notes = {panorama.id: panorama.notes[0] for panorama in panoramas if panorama.notes}
    if not notes:
        return None
    first = next(iter(notes))
    others = f" (the reader changed {len(notes)} of {len(panoramas)} checked images)" if len(frames) > 1 else ""
    return f"image of {first}: {notes[first]}{others}"


def query_notes(panorama: Panorama, camera_z_m: Sequence[float] | np.ndarray = ()) -> list[str]:
    """Return warnings about a query; empty if its range and annotations are as expected.

    Args:
        panorama: The query.
        camera_z_m: (S,) world z of the cameras of the map. An implausible height of the query causes no warning if it
            is close to one of them.
    """
    notes = [unlabelled_note(panorama)]
    if panorama.range_m is not None and panorama.range_by is None:
        if is_cube_depth(panorama.range_m):
            notes.append(
                f"the range image of {panorama.id} seems to contain z-depth of cube faces (depth along the axis of "
                'the face), expected the distance along the ray: set range_kind to "cube" (option --range-kind cube)'
            )
        else:
            notes.append(units_note([panorama], camera_z_m))
        notes.append(missing_note([panorama]))
    return [note for note in notes if note]


def upside_down_note(query: str, surfaces: LevelSurfaces, camera_z_m: np.ndarray) -> str | None:
    """Return a warning if the ceiling is as far from the camera as the floor is in the map; else None.

    A camera that hangs upside down is the likely cause, but an upright camera may stand at such a height too.

    Args:
        query: Id of the query.
        surfaces: Floor and ceiling in the query.
        camera_z_m: (S,) world z of the cameras of the map. Positive values are used as heights above the floor.
    """
    known_m = camera_z_m[camera_z_m > 0]
    if np.isnan(surfaces).any() or not len(known_m):
        return None
    error, turned_error = (float(np.abs(np.log(known_m / height_m)).min()) for height_m in surfaces)
    if turned_error > MAX_HEIGHT_ERROR or turned_error >= error:
        return None
    return (
        f"{query} seems to be upside down: the image shows the floor {surfaces.floor_m:.2f} m below the camera and the "
        f"ceiling {surfaces.ceiling_m:.2f} m above it, but the cameras of the map are at z = {np.median(known_m):.2f} "
        "m: turn the images by 180 deg"
    )
