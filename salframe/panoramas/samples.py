"""Load a few panoramas of a dataset, to check what its images contain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from salframe.panoramas.frames import QueryFrame, ReferenceFrame
from salframe.panoramas.panorama import Panorama

Frame = ReferenceFrame | QueryFrame | Panorama


def load_samples(frames: Sequence[Frame], count: int) -> list[tuple[Frame, Panorama]]:
    """Load the panoramas of up to `count` frames, evenly spaced in the list, with the first and the last frame.

    Panoramas that cannot be read are left out. The code that uses the frame later reports the error.
    """
    loaded: list[tuple[Frame, Panorama]] = []
    for index in sorted({round(i) for i in np.linspace(0, len(frames) - 1, count)}) if frames else ():
        frame = frames[index]
        try:
            loaded.append((frame, frame if isinstance(frame, Panorama) else frame.load()))
        except Exception:  # raised by a plugin
            continue
    return loaded
