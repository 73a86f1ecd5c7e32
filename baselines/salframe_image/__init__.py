"""Image baselines: features of perspective views by a network in ONNX, compared as they are."""

import salframe
from salframe_image.clip import ClipRooms
from salframe_image.image_network import ImageNetwork
from salframe_image.localizer import ImageFeatures
from salframe_image.networks import EfficientNetLite0, OwnNetwork, ResNet101


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """The role `image-network`, what fills it, and the localizers `image` and `clip-rooms`."""
    return [ImageNetwork, EfficientNetLite0, ResNet101, OwnNetwork, ImageFeatures, ClipRooms]
