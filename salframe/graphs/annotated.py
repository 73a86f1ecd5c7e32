"""Annotated objects of a panorama, also as the detections of a perfect detector. They are the truth that detectors are
compared with."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from salframe.framework.errors import InputMissing
from salframe.graphs.boxes import box_solid_angle, detections_from_points, detections_where_known
from salframe.graphs.detections import MAX_TEXT, Detections, unit_vectors
from salframe.panoramas.geometry import equirectangular_rays, pixel_solid_angles, pose_2d, transform_points
from salframe.panoramas.panorama import VISIBLE_PIXELS, Annotations, Panorama, split_text


@dataclass(frozen=True)
class Annotated:
    """An annotated object.

    Attributes:
        key: A number that identifies the object in every panorama.
        label: The annotated label, without its text.
        points_m: (n, 3) float32, points of the object in the panorama frame, in metres: one point per pixel, or the
            corners of the box of a listed object. In an instance image without range, unit vectors through the pixels.
        solid_angle_sr: (n,), solid angle that each point stands for, in steradians. For a listed object, NaN if its
            range is known, otherwise the mean solid angle of its box divided by 8, the number of corners.
        text: The text on the object, "" if it has none.
    """

    key: int
    label: str
    points_m: np.ndarray
    solid_angle_sr: np.ndarray
    text: str = ""


def annotated_objects(panorama: Panorama) -> list[Annotated]:
    """Return the visible annotated objects of a panorama with their points.

    Raises:
        InputMissing: The panorama has no annotations, or the range of the annotated objects is unknown.
    """
    if panorama.annotations is not None and not has_points(panorama):
        raise InputMissing(
            f"{panorama.display_name} has an instance image (annotations) but no range image, expected both"
        )
    return visible_objects(panorama)


def visible_objects(panorama: Panorama) -> list[Annotated]:
    """Return the visible annotated objects of a panorama. If their range is unknown, only the directions of their
    points are meaningful.

    Raises:
        InputMissing: The panorama has no annotations.
    """
    if panorama.annotations is None:
        raise InputMissing(
            f"{panorama.display_name} has no annotations, expected an instance image or a list of objects"
        )
    if panorama.annotations.instance_id is not None:
        return _objects_in_image(panorama.annotations.instance_id, panorama.annotations.labels, panorama.range_m)
    return _objects_in_list(panorama.annotations)


def has_points(panorama: Panorama) -> bool:
    """Return whether the points of the annotated objects of a panorama are positions; otherwise they are directions
    only."""
    listed = None if panorama.annotations is None else panorama.annotations.objects
    return panorama.range_m is not None if listed is None else listed.ranged


def annotated_detections(panorama: Panorama) -> Detections:
    """Return the annotated objects as the detections of a perfect detector.

    Raises:
        InputMissing: As in `annotated_objects`.
    """
    objects = annotated_objects(panorama)
    return as_detections(objects)


def as_detections(objects: list[Annotated], *, ranged: bool = True) -> Detections:
    """Return objects as detections with score 1.

    Args:
        objects: The annotated objects.
        ranged: Whether the points of the objects are positions; otherwise they are directions.
    """
    labels, scores = [annotated.label for annotated in objects], np.ones(len(objects))
    if not objects:
        return Detections.empty()
    solid_angle_sr = np.array([annotated.solid_angle_sr.sum() for annotated in objects])
    texts = tuple(annotated.text[:MAX_TEXT] for annotated in objects)
    if ranged:
        detections = detections_from_points(labels, scores, [annotated.points_m for annotated in objects])
        return replace(detections, solid_angle_sr=solid_angle_sr, texts=texts)
    bearing = unit_vectors(np.array([annotated.solid_angle_sr @ annotated.points_m for annotated in objects]))
    return replace(detections_where_known(labels, scores, None, bearing, solid_angle_sr), texts=texts)


def _objects_in_image(
    instance_id: np.ndarray, labels: Mapping[int, str], range_m: np.ndarray | None
) -> list[Annotated]:
    """Return the objects of an instance image, sorted by instance id."""
    visible = instance_id > 0
    if range_m is not None:
        visible &= range_m > 0
    ids = instance_id[visible]
    order = np.argsort(ids.astype(np.uint16) if ids.max(initial=0) < 2**16 else ids, kind="stable")
    points = equirectangular_rays(len(visible))[visible]
    if range_m is not None:
        points = points * range_m[visible][:, None]
    points, solid_angle_sr = points[order], pixel_solid_angles(len(visible))[np.nonzero(visible)[0]][order]
    instances, counts = np.unique(ids, return_counts=True)
    parts = [slice(end - count, end) for count, end in zip(counts, np.cumsum(counts), strict=True)]
    return [
        _annotated(int(instance), labels[int(instance)], points[part], solid_angle_sr[part])
        for instance, count, part in zip(instances, counts, parts, strict=True)
        if count >= VISIBLE_PIXELS and int(instance) in labels
    ]


def _objects_in_list(annotations: Annotations) -> list[Annotated]:
    """Return the objects of a list whose position is known. The points of an object are the eight corners of its box.

    If the list has no ranges, each corner gets an eighth of the mean solid angle of the box.
    """
    listed = annotations.objects
    if listed is None:
        return []
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
    objects = []
    for i in np.flatnonzero(np.isfinite(listed.centroid_m).all(1)):
        x_m, y_m, z_m = listed.centroid_m[i]
        pose = pose_2d(x_m, y_m, listed.yaw_rad[i], z_m)
        corners = transform_points(pose, signs * listed.size_m[i])
        key = zlib.crc32(listed.keys[i].encode())
        range_m = float(np.linalg.norm(listed.centroid_m[i]))
        solid_angle_sr = np.nan if listed.ranged else box_solid_angle(listed.size_m[i], range_m)
        objects.append(_annotated(key, listed.labels[i], corners.astype(np.float32), np.full(8, solid_angle_sr / 8)))
    return objects


def _annotated(key: int, label: str, points_m: np.ndarray, solid_angle_sr: np.ndarray) -> Annotated:
    """Return an object. Separate the text of the object from its label (`split_text`)."""
    name, text = split_text(label)
    return Annotated(key, name, points_m, solid_angle_sr, text)
