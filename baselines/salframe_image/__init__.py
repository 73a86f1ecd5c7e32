"""Image baselines: features of perspective views by an ONNX network, compared by similarity."""

import salframe
from salframe_image.appearance import AppearanceEvidence
from salframe_image.clip import ClipRooms
from salframe_image.image_network import ImageNetwork
from salframe_image.localizer import ImageFeatures
from salframe_image.networks import EfficientNetLite0, OwnNetwork, ResNet101


@salframe.hookimpl
def salframe_provides() -> list[type]:
    """Return the role `image-network`, its components, the localizers `image` and `clip-rooms`, and the evidence
    `appearance`."""
    return [ImageNetwork, EfficientNetLite0, ResNet101, OwnNetwork, ImageFeatures, ClipRooms, AppearanceEvidence]
