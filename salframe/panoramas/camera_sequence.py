"""The views of a moving camera with odometry, from a folder of panoramas or a recording of another format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from salframe.framework.components.defaults import default_of
from salframe.framework.errors import ConfigError, DataError, UnknownName, counted, unknown
from salframe.panoramas.dataset import MANIFEST
from salframe.panoramas.folder_format import FrameEntry
from salframe.panoramas.folder_reader import Folder
from salframe.panoramas.frames import QueryFrame
from salframe.panoramas.importing import find_importer
from salframe.panoramas.sequences import Odometry


@dataclass(frozen=True, eq=False)
class CameraSequence:
    """The N views of a moving camera in the order of time.

    Attributes:
        name: Name of the sequence.
        t_s: (N,) float64 times in seconds.
        frames: The views. The images of a view are read when the view is loaded.
        odometry: Pose (4, 4) of each view by the odometry, in any fixed frame with z up; None where it is unknown.
        truth: True pose T_world_pano (4, 4) of each view; None where it is unknown. Not used by `track`.
        notes: Warnings about the recording, one line each.
    """

    name: str
    t_s: np.ndarray
    frames: tuple[QueryFrame, ...]
    odometry: tuple[np.ndarray | None, ...]
    truth: tuple[np.ndarray | None, ...]
    notes: tuple[str, ...] = ()


def read_sequence(
    source: str | Path, name: str | None = None, *, format: str | None = None, settings: Sequence[str] = ()
) -> CameraSequence:
    """Return the views of a moving camera in a folder of panoramas or in a recording of another format.

    Args:
        source: A folder in the format of docs/reference/folder-format.md, or a recording such as a ROS bag.
        name: Name of a sequence of the folder; None: the only one. A recording of another format is one sequence.
        format: Name of the importer of the recording; None: the folder format if there is a manifest.json, else the
            default importer.
        settings: Settings of the importer as "key=value".

    Raises:
        ConfigError: The folder has several sequences, and none was named; or an argument is not for this source.
        DataError: The source cannot be read, or has no sequence.
        RequirementMissing: The importer needs a package that is not installed.
        UnknownName: There is no such sequence or importer.
    """
    source = Path(source)
    if format is None and (source / MANIFEST).exists():
        if settings:
            raise ConfigError(
                f"received the importer setting {settings[0]} for {source}, expected none, because a folder with a "
                f"{MANIFEST} is read without an importer: leave out --set"
            )
        return _folder_sequence(Folder(source), name)
    if name is not None:
        raise ConfigError(
            f"received the sequence {name!r} for {source}, expected a sequence name only for a folder with a "
            f"{MANIFEST}: leave out --sequence"
        )
    return _recorded_sequence(source, default_of("recording") if format is None else format, settings)


def _folder_sequence(folder: Folder, name: str | None) -> CameraSequence:
    """Return a sequence of queries in a dataset folder."""
    name, entries = _choose(folder, name)
    t_s = [entry.t_s or 0.0 for entry in entries]
    odometry, truths = folder.odometry, folder.true_poses
    return CameraSequence(
        name,
        np.array(t_s),
        tuple(folder.view_frames(entries, {})),
        tuple(None if odometry is None else odometry.pose(time) for time in t_s),
        tuple(truths.get(entry.id) for entry in entries),
    )


def _choose(folder: Folder, name: str | None) -> tuple[str, Sequence[FrameEntry]]:
    """Return the name and the entries of a sequence."""
    sequences = folder.sequences
    if not sequences:
        raise DataError(
            f"{folder.root} has no sequence (recorded camera path), expected frames with the keys `sequence` and `t_s` "
            "in its manifest.json"
        )
    if name is None and len(sequences) > 1:
        names = ", ".join(list(sequences)[:5]) + (", ..." if len(sequences) > 5 else "")
        raise ConfigError(
            f"{folder.root} has {len(sequences)} sequences, expected the option --sequence with one of the names "
            f"{names}"
        )
    name = next(iter(sequences)) if name is None else name
    if name not in sequences:
        raise UnknownName(f"{folder.root}: {unknown('sequence', name, list(sequences))}")
    return name, sequences[name]


def _recorded_sequence(source: Path, format: str, settings: Sequence[str]) -> CameraSequence:
    """Return the views of a recording of another format."""
    if not source.exists():
        raise DataError(
            f"{source} does not exist, expected a folder with a {MANIFEST}, or a recording in the format {format}"
        )
    try:
        recording = find_importer(format, settings).read_views(source)
    except DataError as error:
        if not source.is_dir():
            raise
        raise DataError(f"{error}; a folder of panoramas with a {MANIFEST} is also accepted") from None
    times = [record.t_s for record in recording.records if record.t_s is not None]
    if num_timeless := len(recording.records) - len(times):
        raise DataError(
            f"{source} has no time for {num_timeless} of {counted(len(recording.records), 'view')}, expected a "
            "recording with the times of all views"
        )
    if recording.odometry is None:
        raise DataError(f"{source} has no odometry (measured motion of the camera), expected a recording with odometry")
    odometry = Odometry.of_rows(recording.odometry, str(source))
    return CameraSequence(
        source.stem,
        np.array(times),
        tuple(QueryFrame(record.id, record.load) for record in recording.records),
        tuple(odometry.pose(time) for time in times),
        tuple(record.T_world_pano for record in recording.records),
        recording.notes,
    )
