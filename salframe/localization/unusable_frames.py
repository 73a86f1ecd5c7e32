"""Reference frames that a method cannot use: if their share is small, the map is built without them."""

from __future__ import annotations

from collections.abc import Mapping

from salframe.framework.errors import DataError, InputMissing

MAX_UNUSABLE_SHARE = 0.2
"""Maximum share of reference frames that may be left out of a map. With more, the map is not built, because
whole places would be missing, and queries there would get a wrong answer."""


def check_unusable(unusable_frames: Mapping[str, DataError | InputMissing], num_frames: int) -> None:
    """Raise an error if a method cannot use more than MAX_UNUSABLE_SHARE of the reference frames of a map.

    Args:
        unusable_frames: Mapping from the id of each frame that cannot be used to its error (one of FRAME_ERRORS).
        num_frames: Number of reference frames, including frames that cannot be used.

    Raises:
        InputMissing: Too many frames are left out, and at least one of them lacks something that the method needs.
        DataError: Too many frames are left out, all of them for other reasons.
    """
    if len(unusable_frames) <= MAX_UNUSABLE_SHARE * num_frames:
        return
    missing = [error for error in unusable_frames.values() if isinstance(error, InputMissing)]
    first = missing[0] if missing else next(iter(unusable_frames.values()))
    if num_frames == 1:
        raise type(first)(str(first))
    message = (
        f"{len(unusable_frames)} of {num_frames} reference frames (panoramas of the map) cannot be used, expected "
        f"at most {MAX_UNUSABLE_SHARE:.0%}: complete or remove these frames; the first error: {first}"
    )
    raise InputMissing(message) if missing else DataError(message)


def unusable_note(unusable_frames: Mapping[str, DataError | InputMissing]) -> str | None:
    """Return a note on the reference frames that were left out of a map; None if no frame was left out."""
    if not unusable_frames:
        return None
    return (
        f"{len(unusable_frames)} of the reference frames (panoramas of the map) left out; the first error: "
        f"{next(iter(unusable_frames.values()))}"
    )
