"""The cameras of a ROS bag: topics of pictures and depth, projection, and intrinsics of CameraInfo messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from salframe.framework.errors import DataError
from salframe.panoramas.camera import Camera
from salframe_import.bag import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE, MessageStore
from salframe_import.bag_images import image_size, is_depth
from salframe_import.bag_poses import frame_name

Projection = Literal["auto", "equirectangular", "pinhole"]
_IMAGE_TYPES = (IMAGE, COMPRESSED_IMAGE)
_TRANSPORTS = ("compressed", "compressedDepth")
"""Last parts of the names of topics that image_transport adds."""


@dataclass(frozen=True, eq=False)
class BagImages:
    """A topic of images of one camera.

    Attributes:
        topic: Name of the topic.
        frame: Name of the coordinate frame in the message headers (frame_id).
        camera: The camera; None for equirectangular images.
    """

    topic: str
    frame: str
    camera: Camera | None


@dataclass(frozen=True, eq=False)
class BagCamera:
    """A topic of pictures of a camera, and the topic of its depth; None if the camera has no depth."""

    color: BagImages
    depth: BagImages | None


def find_cameras(
    bag: MessageStore,
    images: str | None = None,
    depths: str | None = None,
    infos: str | None = None,
    projection: Projection = "auto",
) -> list[BagCamera]:
    """Return the cameras of a bag.

    Args:
        bag: The bag.
        images: Topics of pictures, separated by commas; None: the only topic of images that are not depth.
        depths: Topics of depth in the same order; "none": without depth; None: the only topic of depth, if there is
            one.
        infos: Topics of CameraInfo in the same order; None: the topic `camera_info` in the namespace of each topic of
            images, if it exists.
        projection: Projection of the images. "auto": pinhole if there are intrinsics, otherwise equirectangular.

    Raises:
        DataError: A topic is missing, has another type, or is not the only candidate; or a camera is invalid.
    """
    shown = {topic: is_depth(bag.first(topic).content) for topic in bag.topics(_IMAGE_TYPES)}
    colors = [topic for topic, depth in shown.items() if not depth]
    color_names: Sequence[str | None] = _names(images) or [None]
    color_topics = [bag.choose("image", name, _IMAGE_TYPES, colors) for name in color_names]
    if depths == "none" or (depths is None and not any(shown.values())):
        depth_topics: Sequence[str | None] = [None] * len(color_topics)
    else:
        candidates = [topic for topic, depth in shown.items() if depth]
        depth_names: Sequence[str | None] = _names(depths) or [None]
        depth_topics = [bag.choose("depth", name, _IMAGE_TYPES, candidates) for name in depth_names]
        _check_count("depth", depth_topics, color_topics)
    info_topics: Sequence[str | None] = _names(infos) or [None] * len(color_topics)
    _check_count("camera_info", info_topics, color_topics)
    for topics, expects_depth in ((color_topics, False), (depth_topics, True)):
        for topic in topics:
            if topic is not None and shown[topic] != expects_depth:
                received, expected = ("pictures", "depth images") if expects_depth else ("depth images", "pictures")
                option = "depth" if expects_depth else "image"
                raise DataError(
                    f"the topic {topic} (setting {option}) contains {received}, expected {expected}: choose another "
                    f"topic with --set {option}=TOPIC"
                )
    cameras = []
    for color, depth, info in zip(color_topics, depth_topics, info_topics, strict=True):
        images_of_color = _images(bag, color, info, projection)
        of_depth = None
        if depth is not None:
            # Depth that is registered to the picture has the same intrinsics, often without its own CameraInfo.
            fallback = info or _info_topic(bag, color)
            of_depth = _images(bag, depth, _info_topic(bag, depth) or fallback, projection)
            if (of_depth.camera is None) != (images_of_color.camera is None):
                raise DataError(
                    f"only one of the topics {color} and {depth} has camera intrinsics ({CAMERA_INFO}), expected both "
                    "or neither: pass --set projection=pinhole for images of a pinhole camera, or --set "
                    "projection=equirectangular for panoramas"
                )
        cameras.append(BagCamera(images_of_color, of_depth))
    return cameras


def _images(bag: MessageStore, topic: str, info_topic: str | None, projection: Projection) -> BagImages:
    """Return a topic of images with its camera."""
    message = bag.first(topic).content
    width, height = image_size(message, topic)
    frame = frame_name(message.header.frame_id)
    if not frame:
        raise DataError(
            f"the topic {topic} of {bag.path} has an empty header.frame_id, expected the name of the camera's tf frame"
        )
    info_topic = info_topic or _info_topic(bag, topic)
    info = None
    if info_topic is not None and projection != "equirectangular":
        info = bag.first(bag.choose("camera_info", info_topic, (CAMERA_INFO,))).content
    if info is not None and not _intrinsics(info)[0]:  # K[0] is 0: not calibrated
        info = None
    if info is not None:
        return BagImages(topic, frame, _camera(info, info_topic, topic, width, height))
    if projection == "pinhole":
        raise DataError(
            f"{bag.path} has no intrinsics for {topic}, expected a topic of the type {CAMERA_INFO} with the matrix K: "
            "pass --set camera_info=TOPIC"
        )
    if width != 2 * height:
        raise DataError(
            f"the topic {topic} has images of {width} x {height} without intrinsics, expected width = 2 x height "
            f"(equirectangular), or a topic of the type {CAMERA_INFO}: pass --set camera_info=TOPIC"
        )
    return BagImages(topic, frame, None)


def _camera(info: Any, info_topic: str | None, topic: str, width: int, height: int) -> Camera:
    """Return the camera of a CameraInfo message.

    Images of topics that end in image_rect are rectified: they have the intrinsics P and no distortion.
    """
    if (info.width, info.height) != (width, height):
        raise DataError(
            f"the topic {topic} has images of {width} x {height}, and {info_topic} has intrinsics for "
            f"{info.width} x {info.height}, expected equal sizes"
        )
    K, P, D = _intrinsics(info)
    is_rectified = "rect" in _base_name(topic).split("_")
    fx, fy, cx, cy = (P[0], P[5], P[2], P[6]) if is_rectified else (K[0], K[4], K[2], K[5])
    has_distortion = not is_rectified and any(D)
    model = info.distortion_model if has_distortion else "none"
    try:
        return Camera(width, height, fx, fy, cx, cy, model, D if has_distortion else [])
    except DataError as error:
        raise DataError(f"the topic {info_topic}: {error}") from None


def _intrinsics(info: Any) -> tuple[list[float], list[float], list[float]]:
    """Return K, P and D of a CameraInfo message; ROS 1 spells them in upper case, ROS 2 in lower case."""
    K, P, D = (getattr(info, name) if hasattr(info, name) else getattr(info, name.lower()) for name in "KPD")
    return [float(x) for x in K], [float(x) for x in P], [float(x) for x in D]


def _info_topic(bag: MessageStore, topic: str) -> str | None:
    """Return the topic camera_info in the namespace of a topic of images; None if there is none."""
    parent = topic.rsplit("/", 2)[0] if topic.rsplit("/", 1)[-1] in _TRANSPORTS else topic.rsplit("/", 1)[0]
    name = f"{parent}/camera_info"
    return name if bag.types.get(name) == CAMERA_INFO else None


def _base_name(topic: str) -> str:
    """Return the last part of a topic name, without the suffix of image_transport, such as `compressed`."""
    parts = [part for part in topic.split("/") if part not in _TRANSPORTS]
    return parts[-1]


def _names(value: str | None) -> list[str]:
    return [] if value is None else [name.strip() for name in value.split(",")]


def _check_count(option: str, topics: Sequence[object], images: Sequence[object]) -> None:
    if len(topics) != len(images):
        raise DataError(
            f"the number of topics in the setting {option} is {len(topics)}, expected {len(images)}: one for each "
            "topic in the setting image"
        )
