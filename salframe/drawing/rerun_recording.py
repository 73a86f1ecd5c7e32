"""Write a track as a recording for the rerun viewer: panoramas with their objects, the floor, the estimated poses and
the true poses."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from salframe.drawing.object_picture import choose_colours, find_lines
from salframe.drawing.trail_picture import COLOURS
from salframe.framework.errors import ConfigError, RequirementMissing
from salframe.framework.files.writing import atomic_path
from salframe.localization.described_objects import described_objects
from salframe.localization.map import LocalizationMap
from salframe.localization.matched_objects import find_matched_objects
from salframe.localization.tracking import Track, TrackStep
from salframe.panoramas.camera_sequence import CameraSequence
from salframe.panoramas.floor_outlines import floor_outlines
from salframe.panoramas.geometry import confidence_ellipse

if TYPE_CHECKING:
    import rerun

SUFFIX = ".rrd"
TIME, STEP = "time", "step"
"""Timelines: seconds since the first view, and numbers of views."""
TRUTH_COLOUR = (42, 157, 90)
ARROW_M = 0.6
"""Length of the arrow of a pose in metres."""
JPEG_QUALITY = 85


def check_rerun_output(path: Path) -> None:
    """Check that a recording for rerun can be written.

    Raises:
        ConfigError: The file has another suffix than .rrd.
        RequirementMissing: The package rerun-sdk is not installed.
    """
    if path.suffix != SUFFIX:
        raise ConfigError(f"received --rerun {path}, expected a file name that ends in {SUFFIX}")
    if find_spec("rerun") is None:
        raise RequirementMissing(
            "a recording for rerun needs rerun-sdk, which is not installed: pip install 'salframe[rerun]'"
        )


def write_rerun(track: Track, views: CameraSequence, map: LocalizationMap, path: str | Path) -> None:
    """Write a track as a recording for the rerun viewer.

    The recording has these entities:

    - `camera/panorama` and `camera/panorama/objects`: the view, and the outlines of its objects with their labels.
    - `world/floors/N`: outlines of the places of a floor, with their names.
    - `world/belief`, `world/belief/ellipse` and `world/belief/trail`: estimated pose of the camera, 95 % ellipse of its
      position, and all poses up to now, in the colour of the status.
    - `world/objects`: objects of the map that were matched with objects of the view.
    - `world/truth` and `world/truth/trail`: true poses, if they are known.
    - `status` and `support`: status, place and errors as text, and the support (evidence for the estimated pose).

    Args:
        track: The track.
        views: The views that were tracked. Their panoramas are read again.
        map: The map.
        path: The file, which ends in .rrd.

    Raises:
        ConfigError: As `check_rerun_output`.
        RequirementMissing: As `check_rerun_output`.
    """
    check_rerun_output(Path(path))
    import rerun

    with atomic_path(Path(path)) as temporary:
        stream = rerun.RecordingStream("salframe")
        stream.set_log_time_enabled(False)  # the time of writing is not a time of the track
        stream.set_log_tick_enabled(False)
        stream.save(temporary)
        _log_floors(stream, map)
        for number, step in enumerate(track.steps):
            stream.set_time(STEP, sequence=number)
            stream.set_time(TIME, duration=float(track.t_s[number] - track.t_s[0]))
            _log_view(stream, views, number, step)
            _log_belief(stream, map, track, number)
            _log_truth(stream, views, number)
        stream.flush()
        stream.disconnect()


def _log_floors(stream: rerun.RecordingStream, map: LocalizationMap) -> None:
    """Log the outlines of the places of the floors."""
    import rerun

    stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for number, floor in enumerate(map.floors):
        lines, names = [], []
        for region, place in floor.regions.items():
            for polygon in floor_outlines(floor, floor.region == region):
                lines += [_lifted(ring, floor.z_m) for ring in polygon]
                names += [place] * len(polygon)
        stream.log(f"world/floors/{number}", rerun.LineStrips3D(lines, labels=names), static=True)


def _log_view(stream: rerun.RecordingStream, views: CameraSequence, number: int, step: TrackStep) -> None:
    """Log the panorama of a view and its objects; neither if the view could not be used or has no colour."""
    import cv2
    import rerun

    rgb = None if step.description is None else views.frames[number].load().rgb
    if rgb is None or step.description is None:
        stream.log("camera/panorama", rerun.Clear(recursive=True))
        return
    _, content = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    stream.log("camera/panorama", rerun.EncodedImage(contents=content.tobytes(), media_type="image/jpeg"))
    objects = described_objects(step.description)
    lines: list[np.ndarray] = []
    labels: list[str] = []
    if objects is not None:
        for label, parts in zip(objects[1].labels, find_lines(len(rgb), objects[1]), strict=True):
            closed = [np.vstack([part, part[:1]]) for part in parts]
            lines += closed
            labels += [label] * len(closed)
    colours = choose_colours(labels)
    strips = rerun.LineStrips2D(lines, labels=labels, colors=[colours[label] for label in labels])
    stream.log("camera/panorama/objects", strips)


def _log_belief(stream: rerun.RecordingStream, map: LocalizationMap, track: Track, number: int) -> None:
    """Log the belief after a view, and the objects of the map that the objects of the view were matched with."""
    import rerun

    step = track.steps[number]
    belief, colour = step.pose, COLOURS[step.pose.status]
    text = f"{belief.status}: {belief.place or 'no place'}"
    stream.log("status", rerun.TextLog(f"{text}; {step.error}" if step.error else text))
    stream.log("support", rerun.Scalars(belief.support))
    if belief.T_world_pano is not None:
        _log_pose(stream, "world/belief", belief.T_world_pano, colour)
        if belief.covariance is not None:
            ellipse_m = confidence_ellipse(belief.covariance[:2, :2]) + belief.T_world_pano[:2, 3]
            strip = _lifted(ellipse_m, float(belief.T_world_pano[2, 3]))
            stream.log("world/belief/ellipse", rerun.LineStrips3D([strip], colors=[colour]))
        posed = [past.pose.T_world_pano for past in track.steps[: number + 1]]
        _log_trail(stream, "world/belief/trail", [pose for pose in posed if pose is not None], colour)
    matched = []
    if step.answer is not None and step.description is not None:
        matched = list(find_matched_objects(map, step.description, step.answer).values())
    points = np.array([thing.xyz_m for thing in matched]).reshape(-1, 3)
    stream.log("world/objects", rerun.Points3D(points, labels=[thing.label for thing in matched], radii=0.08))


def _log_truth(stream: rerun.RecordingStream, views: CameraSequence, number: int) -> None:
    """Log the true pose of a view, if it is known."""
    pose = views.truth[number]
    if pose is not None:
        _log_pose(stream, "world/truth", pose, TRUTH_COLOUR)
        known = [past for past in views.truth[: number + 1] if past is not None]
        _log_trail(stream, "world/truth/trail", known, TRUTH_COLOUR)


def _log_pose(stream: rerun.RecordingStream, entity: str, T_world_pano: np.ndarray, colour: Any) -> None:
    """Log the arrow of a pose."""
    import rerun

    origin, forward = T_world_pano[:3, 3], ARROW_M * T_world_pano[:3, 0]
    stream.log(entity, rerun.Arrows3D(origins=[origin], vectors=[forward], colors=[colour]))


def _log_trail(stream: rerun.RecordingStream, entity: str, poses: list[np.ndarray], colour: Any) -> None:
    """Log the line through poses."""
    import rerun

    stream.log(entity, rerun.LineStrips3D([[pose[:3, 3] for pose in poses]], colors=[colour]))


def _lifted(xy_m: np.ndarray, z_m: float) -> np.ndarray:
    """Return points (K, 2) at a height, (K, 3)."""
    return np.column_stack([xy_m, np.full(len(xy_m), z_m)])
