"""The cameras of a ROS bag as a rig: poses of its images, and its panoramas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from salframe.framework.errors import DataError
from salframe.panoramas.camera import LEVEL
from salframe.panoramas.geometry import invert_pose, range_of_cube_depth
from salframe.panoramas.importer import PanoramaRecord
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.range_encoding import RangeKind
from salframe.panoramas.stitching import PosedCamera
from salframe_import.bag import MessageStore
from salframe_import.bag_cameras import BagCamera, BagImages
from salframe_import.bag_images import color_image, depth_image
from salframe_import.bag_poses import TransformTree
from salframe_import.stations import PosedImage, station_record, z_depth

MIN_UP = float(np.cos(np.radians(45)))
"""Minimum mean z of the up directions of equirectangular images that are considered upright."""
CameraAxes = Literal["auto", "optical", "body"]
Message = tuple[int, int]
"""Header stamp and recording time of a message, in nanoseconds."""


@dataclass(frozen=True)
class BagShot:
    """The messages of all cameras at one time.

    Attributes:
        number: Index of the picture of the first camera in its topic.
        colors: The picture of each camera.
        depths: The depth of each camera; None for a camera without depth.
    """

    number: int
    colors: tuple[Message, ...]
    depths: tuple[Message | None, ...]

    @property
    def stamp_ns(self) -> int:
        """Header stamp of the first picture."""
        return self.colors[0][0]


@dataclass(frozen=True, eq=False)
class BagRig:
    """The cameras of a bag: one equirectangular camera, or any number of other cameras.

    Attributes:
        bag: The bag.
        cameras: The cameras.
        tree: The transforms between the frames of the cameras.
        tolerance_s: Maximum difference between the header stamps of messages that belong together.
        depth_unit_m: Metres per unit of 16-bit depth images.
        depth_kind: Quantity that the depth images measure.
        axes: Axes of the frame of equirectangular images: "optical" (x right, y down, z forward) or "body" (x forward,
            y left, z up).
    """

    bag: MessageStore
    cameras: tuple[BagCamera, ...]
    tree: TransformTree
    tolerance_s: float
    depth_unit_m: float
    depth_kind: RangeKind
    axes: CameraAxes = "optical"

    @property
    def frame(self) -> str:
        """Name of the frame of the first camera."""
        return self.cameras[0].color.frame

    @property
    def is_equirectangular(self) -> bool:
        """Whether the camera is equirectangular."""
        return self.cameras[0].color.camera is None

    def find_shots(self) -> tuple[list[BagShot], list[str]]:
        """Return the shots in temporal order, and notes about pictures that are left out.

        Raises:
            DataError: A topic has no message or no stamps, or there is no time at which all topics have a message.
        """
        topics = [images.topic for camera in self.cameras for images in (camera.color, camera.depth) if images]
        times = self.bag.stamps(topics)
        first = times[topics[0]][:, 0]
        stamps = first[np.append(True, np.diff(first) > 0)].tolist()
        tolerance_ns = round(self.tolerance_s * 1e9)
        shots, missing = [], dict.fromkeys(topics, 0)
        for number, stamp_ns in enumerate(stamps):
            messages = {topic: _nearest(times[topic], stamp_ns, tolerance_ns) for topic in topics}
            if absent := [topic for topic, message in messages.items() if message is None]:
                missing[absent[0]] += 1
                continue
            colors = tuple(message for camera in self.cameras if (message := messages[camera.color.topic]))
            depths = tuple(messages[camera.depth.topic] if camera.depth else None for camera in self.cameras)
            shots.append(BagShot(number, colors, depths))
        notes = [
            f"{count} of {len(stamps)} pictures of {topics[0]} are left out, because no message of {topic} is within "
            f"{self.tolerance_s:g} s of them"
            for topic, count in missing.items()
            if count
        ]
        if not shots:
            raise DataError(
                f"{self.bag.path}: {notes[0]}; expected at least one time at which every topic has a message: check "
                "the header stamps, or increase the setting tolerance_s"
            )
        return shots, notes

    def posed_images(self, shot: BagShot, T_world_frame: np.ndarray) -> list[PosedImage]:
        """Return the pictures of a shot with their poses.

        Args:
            shot: The shot.
            T_world_frame: (4, 4) pose of the frame of the first camera.

        Raises:
            DataError: The transform of a camera is unknown, or a camera is equirectangular.
        """
        images = []
        for camera, color, depth in zip(self.cameras, shot.colors, shot.depths, strict=True):
            name = f"{camera.color.topic} at {color[0] / 1e9:.3f} s"
            posed = self._posed(camera.color, T_world_frame, color[0])
            image = PosedImage(name, posed, partial(self._color, camera.color, color), t_s=shot.stamp_ns / 1e9)
            if camera.depth is not None and depth is not None:
                depth_camera = self._posed(camera.depth, T_world_frame, depth[0])
                read_depth = partial(self._z_depth_m, camera.depth, depth)
                image = replace(image, read_depth=read_depth, depth_camera=depth_camera)
            images.append(image)
        return images

    def equirectangular(self, name: str, shot: BagShot) -> Panorama:
        """Return the panorama of an equirectangular picture, with its depth at the resolution of the picture.

        Raises:
            DataError: A message is damaged.
        """
        import cv2

        camera, depth = self.cameras[0], shot.depths[0]
        rgb = self._color(camera.color, shot.colors[0])
        if camera.depth is None or depth is None:
            return Panorama(name, rgb)
        range_m = self._depth_m(camera.depth, depth)
        if range_m.shape != rgb.shape[:2]:
            range_m = cv2.resize(range_m, rgb.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        return Panorama(name, rgb, range_of_cube_depth(range_m) if self.depth_kind == RangeKind.CUBE else range_m)

    def record(
        self, shot: BagShot, T_world_frame: np.ndarray, height: int, sources: Sequence[Path] = ()
    ) -> PanoramaRecord:
        """Return the panorama of a shot.

        Args:
            shot: The shot.
            T_world_frame: (4, 4) pose of the frame of the first camera.
            height: Height in pixels of a panorama that is stitched from pinhole images. Equirectangular pictures keep
                their height.
            sources: Files of the bag.

        Raises:
            DataError: The transform of a camera is unknown.
        """
        id = f"{shot.number:06d}"
        if not self.is_equirectangular:
            return station_record(id, self.posed_images(shot, T_world_frame), height, sources)
        parts = frozenset({"rgb", "range"} if self.cameras[0].depth else {"rgb"})
        load = partial(self.equirectangular, id, shot)
        pose = self.pano_pose(T_world_frame)
        return PanoramaRecord(id, load, parts, pose, t_s=shot.stamp_ns / 1e9, sources=tuple(sources))

    def with_upright_axes(self, T_world_frames: Sequence[np.ndarray], axes: CameraAxes | Literal["auto"]) -> BagRig:
        """Return a copy of the rig with `axes` set, after a check that equirectangular images are upright.

        Images that are not equirectangular always have optical axes (x right, y down, z forward).

        Args:
            T_world_frames: (4, 4) poses of the frame of the first camera, at least one.
            axes: Axes of the frame of equirectangular images; "auto": the axes under which the images are upright.

        Raises:
            DataError: `axes` is explicit, and the equirectangular images are upright only under other axes. Or `axes`
                is "auto", and the images are upright under no axes.
        """
        if not self.is_equirectangular:
            return self
        poses = np.array(T_world_frames)
        up = {"body": float(poses[:, 2, 2].mean()), "optical": float((poses @ invert_pose(LEVEL))[:, 2, 2].mean())}
        best: CameraAxes = "body" if up["body"] > up["optical"] else "optical"
        if axes != "auto" and (up[axes] >= MIN_UP or up[best] < MIN_UP):
            return replace(self, axes=axes)
        where = (
            f"the images of {self.cameras[0].color.topic} (frame {self.frame}) are not upright according to their poses"
        )
        if axes != "auto":
            raise DataError(
                f"{where}: with camera_axes={axes}, the up vector of the images has the z component {up[axes]:.2f} in "
                f"the world, expected {MIN_UP:.2f} to 1: try --set camera_axes={best}"
            )
        if up[best] < MIN_UP:
            raise DataError(
                f"{where}: the up vectors of the images have the z component {up['optical']:.2f} in the world if the "
                f"frame has optical camera axes, and {up['body']:.2f} if it has body axes, expected {MIN_UP:.2f} to 1 "
                "in one of the two cases: check the transforms of this frame in /tf_static (not inverted, quaternions "
                "in the order x, y, z, w)"
            )
        return replace(self, axes=best)

    def pano_pose(self, T_world_frame: np.ndarray) -> np.ndarray:
        """Return the pose T_world_pano (4, 4) of an equirectangular picture."""
        return T_world_frame if self.axes == "body" else T_world_frame @ invert_pose(LEVEL)

    def notes(self, shot: BagShot, T_world_frame: np.ndarray) -> list[str]:
        """Return one-line warnings about cameras that are not upright according to the transforms at one shot."""
        if self.is_equirectangular:
            return []
        notes = []
        for camera in self.cameras:
            for images in (camera.color, camera.depth):
                if images is not None and images.camera is not None:
                    T_world_camera = self._posed(images, T_world_frame, shot.stamp_ns).T_world_camera.copy()
                    T_world_camera[:3, 3] = 0
                    notes += [
                        f"the topic {images.topic}: {note}: check the transforms of the frame {images.frame} in "
                        "/tf_static, and whether they are inverted"
                        for note in replace(images.camera, T_base_camera=T_world_camera).notes
                    ]
        return notes

    def _posed(self, images: BagImages, T_world_frame: np.ndarray, stamp_ns: int) -> PosedCamera:
        """Return the camera of a topic in the world. Raises DataError if it is equirectangular or has no transform."""
        T_frame_camera = self.tree.pose(self.frame, images.frame, stamp_ns, self.tolerance_s)
        if images.camera is None:
            raise DataError(f"the topic {images.topic} is equirectangular, expected images with pinhole intrinsics")
        if T_frame_camera is None:
            raise DataError(
                f"the transform from {images.frame} to {self.frame} is unknown at {stamp_ns / 1e9:.3f} s, expected a "
                "transform in /tf_static"
            )
        return PosedCamera(images.camera, T_world_frame @ T_frame_camera)

    def _color(self, images: BagImages, message: Message) -> np.ndarray:
        return color_image(self.bag.read(images.topic, *message), images.topic)

    def _depth_m(self, images: BagImages, message: Message) -> np.ndarray:
        return depth_image(self.bag.read(images.topic, *message), images.topic, self.depth_unit_m)

    def _z_depth_m(self, images: BagImages, message: Message) -> np.ndarray:
        depth_m = self._depth_m(images, message)
        if self.depth_kind != RangeKind.RAY or images.camera is None:
            return depth_m
        return z_depth(depth_m, images.camera)


def _nearest(times: np.ndarray, stamp_ns: int, tolerance_ns: int) -> Message | None:
    """Return the row (stamp, recording time) of `times` (N, 2) with the nearest stamp; None if it is beyond the
    tolerance."""
    stamp, log = times[int(np.abs(times[:, 0] - stamp_ns).argmin())].tolist()
    return (stamp, log) if abs(stamp - stamp_ns) <= tolerance_ns else None
