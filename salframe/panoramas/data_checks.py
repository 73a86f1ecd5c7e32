"""Checks of datasets before they are used: one-line warnings where their conventions seem to be others."""

from __future__ import annotations

from salframe.panoramas.camera_height import units_note
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.opening import reference_frames
from salframe.panoramas.range_missing import missing_note
from salframe.panoramas.region_check import check_regions


def data_notes(dataset: Dataset) -> list[str]:
    """Return warnings about a prepared dataset; empty where its conventions are as expected.

    The unit of the ranges and values without a reading are checked on a sample of the reference frames, the places on
    all of them.

    Raises:
        DataError: Many frames stand outside the region of their place, or the floor masks are malformed.
    """
    frames = reference_frames(dataset)
    notes = units_note(frames), missing_note(frames), check_regions(frames, dataset.floors())
    return [note for note in notes if note]
