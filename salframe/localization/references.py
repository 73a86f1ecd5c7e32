"""Describe the reference frames of a map, and leave out those that a localizer cannot use."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from salframe.framework.errors import FRAME_ERRORS, DataError, InputMissing
from salframe.framework.files.cache import Cache
from salframe.localization.describing import describe_frame
from salframe.localization.left_out import check_left_out, left_out_note
from salframe.localization.level_frames import split_level, upright_frame
from salframe.localization.localizer import Description, Localizer
from salframe.localization.preparing import Tell
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
        raise DataError("a map needs at least one reference frame, received none")
    packed, usable, notes = [], [], []
    left_out: dict[str, DataError | InputMissing] = {}
    for done, frame in enumerate(frames):
        if progress:
            progress(done, len(frames))
        try:
            description, _ = describe_frame(localizer, frame, cache, dataset)
        except FRAME_ERRORS as error:
            left_out[frame.id] = error
            continue
        packed.append(localizer.pack(split_level(description)[0]))
        usable.append(upright_frame(localizer, frame))
        if note := localizer.note(description):
            notes.append(f"{frame.id}: {note}")
    if progress:
        progress(len(frames), len(frames))
    check_left_out(left_out, len(frames))
    for note in [*notes, *filter(None, [left_out_note(left_out)])]:
        tell(note)
    return packed, usable
