"""Annotated objects as detections without error: what a perfect detector finds, and the truth that detectors are
measured by."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from salframe.framework.errors import InputMissing
from salframe.graphs.boxes import detections_from_points, detections_where_known
from salframe.graphs.detections import Detections, unit_vectors
from salframe.panoramas.geometry import equirectangular_rays, pixel_solid_angles, pose_2d, transform_points
from salframe.panoramas.panorama import VISIBLE_PIXELS, Annotations, Panorama


@dataclass(frozen=True)
class Annotated:
    """One annotated object: `key`, a number that stays with it; points_m (n, 3) float32 in the panorama frame, or the
    directions of its pixels, unit vectors, where the range is not known; solid_angle_sr (n,), what each pixel covers,
    NaN where it is known by its box."""

    key: int
    label: str
    points_m: np.ndarray
    solid_angle_sr: np.ndarray


def annotated_objects(panorama: Panorama) -> list[Annotated]:
    """The visible annotated objects of a panorama and where they are. Raises InputMissing where it has no annotations,
    or an instance image and no range.
    """
    if panorama.annotations is not None and not has_points(panorama):
        raise InputMissing(f"{panorama.id} lacks range, expected it beside the instance image")
    return seen_objects(panorama)


def seen_objects(panorama: Panorama) -> list[Annotated]:
    """The visible annotated objects of a panorama, by their directions where it has no range. Raises InputMissing where
    it has no annotations."""
    if panorama.annotations is None:
        raise InputMissing(f"{panorama.id} has no annotations")
    if panorama.annotations.instance_id is not None:
        return _objects_in_image(panorama.annotations.instance_id, panorama.annotations.labels, panorama.range_m)
    return _objects_in_list(panorama.annotations)


def has_points(panorama: Panorama) -> bool:
    """Whether its annotated objects have points, or directions alone."""
    listed = panorama.annotations is not None and panorama.annotations.objects is not None
    return listed or panorama.range_m is not None


def annotated_detections(panorama: Panorama) -> Detections:
    """The annotated objects as a detector without error finds them. Raises InputMissing."""
    objects = annotated_objects(panorama)
    return as_detections(objects)


def as_detections(objects: list[Annotated], *, ranged: bool = True) -> Detections:
    """Objects as detections of full score; not `ranged`: their points are directions."""
    labels, scores = [one.label for one in objects], np.ones(len(objects))
    if not objects:
        return Detections.empty()
    solid_angle_sr = np.array([one.solid_angle_sr.sum() for one in objects])
    if ranged:
        found = detections_from_points(labels, scores, [one.points_m for one in objects])
        return replace(found, solid_angle_sr=solid_angle_sr)
    bearing = unit_vectors(np.array([one.solid_angle_sr @ one.points_m for one in objects]))
    return detections_where_known(labels, scores, None, bearing, solid_angle_sr)


def _objects_in_image(
    instance_id: np.ndarray, labels: Mapping[int, str], range_m: np.ndarray | None
) -> list[Annotated]:
    """The objects of an instance image, by instance id."""
    seen = instance_id > 0
    if range_m is not None:
        seen &= range_m > 0
    ids = instance_id[seen]
    order = np.argsort(ids.astype(np.uint16) if ids.max(initial=0) < 2**16 else ids, kind="stable")
    points = equirectangular_rays(len(seen))[seen]
    if range_m is not None:
        points = points * range_m[seen][:, None]
    points, solid_angle_sr = points[order], pixel_solid_angles(len(seen))[np.nonzero(seen)[0]][order]
    instances, counts = np.unique(ids, return_counts=True)
    parts = [slice(end - count, end) for count, end in zip(counts, np.cumsum(counts), strict=True)]
    return [
        Annotated(int(instance), labels[int(instance)], points[part], solid_angle_sr[part])
        for instance, count, part in zip(instances, counts, parts, strict=True)
        if count >= VISIBLE_PIXELS and int(instance) in labels
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
        found.append(Annotated(key, objects.labels[i], corners.astype(np.float32), np.full(8, np.nan)))
    return found
