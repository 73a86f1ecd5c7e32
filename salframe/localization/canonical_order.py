"""Sort the frames of a map in an order that does not depend on the order and the names of the files of a dataset."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from salframe.localization.localizer import Description
from salframe.panoramas.frames import ReferenceFrame


def in_canonical_order(
    packed: Sequence[Description], frames: Sequence[ReferenceFrame]
) -> tuple[list[Description], list[ReferenceFrame]]:
    """Sort the frames of a map by place, and the frames of one place by the content of their descriptions.

    Localizers may then break ties by the order of the frames.

    Args:
        packed: N packed descriptions.
        frames: Their N frames.
    """
    keys = [
        (frame.place, _content_digest(description), frame.id) for description, frame in zip(packed, frames, strict=True)
    ]
    order = sorted(range(len(keys)), key=keys.__getitem__)
    return [packed[i] for i in order], [frames[i] for i in order]


def _content_digest(description: Description) -> bytes:
    content = hashlib.blake2b(digest_size=16)
    for name in sorted(description):
        array = np.ascontiguousarray(description[name])
        content.update(f"{name} {array.dtype} {array.shape}".encode())
        content.update(array.tobytes())
    return content.digest()
