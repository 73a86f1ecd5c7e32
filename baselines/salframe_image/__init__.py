"""Image baselines: features of perspective views by a network in ONNX, compared as they are."""

import salframe
from salframe_image.clip import ClipRooms
from salframe_image.localizer import ImageFeatures


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """The localizers `image` and `clip-rooms`."""
    return [ImageFeatures, ClipRooms]
