"""Describe the reference frames of a map, and leave out the frames that a localizer cannot use."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from salframe.framework.errors import FRAME_ERRORS, DataError, InputMissing
from salframe.framework.files.cache import Cache
from salframe.localization.describing import describe_frame
from salframe.localization.level_frames import R_LEVEL_PANO, split_level, upright_frame
from salframe.localization.localizer import Description, Localizer
from salframe.localization.preparing import Tell
from salframe.localization.unusable_frames import check_unusable, unusable_note
from salframe.panoramas.frames import ReferenceFrame


def describe_references(
    localizer: Localizer,
    frames: Sequence[ReferenceFrame],
    cache: Cache | None,
    dataset: str,
    progress: Callable[[int, int], None] | None,
    tell: Tell,
) -> tuple[list[Description], list[ReferenceFrame]]:
    """Return the packed descriptions of the reference frames that a localizer can use, and these frames.

    Arguments and errors are those of `LocalizationMap.build`.
    """
    if not frames:
        raise DataError(
            "received no reference frame, expected at least one for a map: add panoramas with poses and places"
        )
    descriptions, described, notes = [], [], []
    unusable_frames: dict[str, DataError | InputMissing] = {}
    for done, frame in enumerate(frames):
        if progress:
            progress(done, len(frames))
        try:
            description, _ = describe_frame(localizer, frame, cache, dataset)
        except FRAME_ERRORS as error:
            unusable_frames[frame.id] = error
            continue
        descriptions.append(description)
        described.append(frame)
        if note := localizer.note(description):
            notes.append(f"{frame.id}: {note}")
    if progress:
        progress(len(frames), len(frames))
    completed = complete_references(localizer, descriptions, described)
    unusable_frames |= completed.unusable_frames
    check_unusable(unusable_frames, len(frames))
    for note in [*notes, *completed.notes, *filter(None, [unusable_note(unusable_frames)])]:
        tell(note)
    packed = [localizer.pack(split_level(description)[0]) for description in completed.descriptions]
    return packed, [upright_frame(localizer, frame) for frame in completed.frames]


@dataclass(frozen=True, eq=False)
class CompletedReferences:
    """Reference frames that a localizer can use.

    Attributes:
        descriptions: The completed descriptions of the frames.
        frames: The frames.
        unusable_frames: Mapping from the id of each frame that cannot be used to its error.
        notes: Remarks for the user.
    """

    descriptions: Sequence[Description]
    frames: Sequence[ReferenceFrame]
    unusable_frames: Mapping[str, DataError | InputMissing]
    notes: Sequence[str]


def complete_references(
    localizer: Localizer, descriptions: Sequence[Description], frames: Sequence[ReferenceFrame]
) -> CompletedReferences:
    """Complete the descriptions of reference frames (`Localizer.complete`), and leave out the frames that cannot be in
    a map.

    Args:
        localizer: The localizer.
        descriptions: One description for each frame.
        frames: The frames.
    """
    level = [split_level(description) for description in descriptions]
    before = [description for description, _ in level]
    after = localizer.complete(before, [upright_frame(localizer, frame) for frame in frames])
    changed = [number for number, description in enumerate(after) if description is not before[number]]
    total, placed = (sum(localizer.count_objects(part[number]) for number in changed) for part in (before, after))
    notes = (
        f"{total - placed} of {total} objects in {len(changed)} reference frames without range are left out: their "
        "position cannot be triangulated from a second panorama"
    )
    unusable_frames: dict[str, DataError | InputMissing] = {}
    for frame, description in zip(frames, after, strict=True):
        if reason := localizer.unfit_for_map(description):
            unusable_frames[frame.id] = InputMissing(f"panorama {frame.id} cannot be a reference frame: {reason}")
    rows = [number for number, frame in enumerate(frames) if frame.id not in unusable_frames]
    tilted = {number: {R_LEVEL_PANO: rotation} for number, (_, rotation) in enumerate(level) if rotation is not None}
    return CompletedReferences(
        [{**after[row], **tilted[row]} if row in tilted else after[row] for row in rows],
        [frames[row] for row in rows],
        unusable_frames,
        [notes] if placed < total else [],
    )
