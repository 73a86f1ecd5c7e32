"""Annotated objects as detections without error: what a perfect detector finds, and the truth that detectors are
measured by."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from salframe.framework.errors import InputMissing
from salframe.graphs.boxes import detections_from_points
from salframe.graphs.detections import Detections
from salframe.panoramas.geometry import equirectangular_rays, pose_2d, transform_points
from salframe.panoramas.panorama import VISIBLE_PIXELS, Annotations, Panorama


@dataclass(frozen=True)
class Annotated:
    """One annotated object: `key`, a number that stays with it; points_m (n, 3) float32 in the panorama frame."""

    key: int
    label: str
    points_m: np.ndarray


def annotated_objects(panorama: Panorama) -> list[Annotated]:
    """The visible annotated objects of a panorama. Raises InputMissing where it has no annotations, or an instance
    image and no range.
    """
    if panorama.annotations is None:
        raise InputMissing(f"{panorama.id} has no annotations")
    if panorama.annotations.objects is None:
        return _objects_in_image(panorama)
    return _objects_in_list(panorama.annotations)


def annotated_detections(panorama: Panorama) -> Detections:
    """The annotated objects as a detector without error finds them. Raises InputMissing."""
    objects = annotated_objects(panorama)
    return as_detections(objects)


def as_detections(objects: list[Annotated]) -> Detections:
    """Objects as detections of full score."""
    labels = [one.label for one in objects]
    return detections_from_points(labels, np.ones(len(objects)), [one.points_m for one in objects])


def _objects_in_image(panorama: Panorama) -> list[Annotated]:
    """The objects of an instance image, by instance id."""
    annotations = panorama.annotations
    if annotations is None or annotations.instance_id is None or panorama.range_m is None:
        raise InputMissing(f"{panorama.id} lacks an instance image or range, expected both")
    seen = (annotations.instance_id > 0) & (panorama.range_m > 0)
    ids = annotations.instance_id[seen]
    order = np.argsort(ids.astype(np.uint16) if ids.max(initial=0) < 2**16 else ids, kind="stable")
    points = (equirectangular_rays(len(seen))[seen] * panorama.range_m[seen][:, None])[order]
    instances, counts = np.unique(ids, return_counts=True)
    ends = np.cumsum(counts)
    return [
        Annotated(int(instance), annotations.labels[int(instance)], points[end - count : end])
        for instance, count, end in zip(instances, counts, ends, strict=True)
        if count >= VISIBLE_PIXELS and int(instance) in annotations.labels
    ]


def _objects_in_list(annotations: Annotations) -> list[Annotated]:
    """The objects of a list, each as the eight corners of its box; those of unknown range are left out."""
    objects = annotations.objects
    if objects is None:
        return []
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
    found = []
    for i in np.flatnonzero(np.isfinite(objects.centroid_m).all(1)):
        x_m, y_m, z_m = objects.centroid_m[i]
        pose = pose_2d(x_m, y_m, objects.yaw_rad[i], z_m)
        corners = transform_points(pose, signs * objects.size_m[i])
        key = zlib.crc32(objects.keys[i].encode())
        found.append(Annotated(key, objects.labels[i], corners.astype(np.float32)))
    return found
