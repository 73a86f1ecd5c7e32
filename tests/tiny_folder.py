"""A dataset in the folder format: the conformance suite's three rooms, a reference frame and a query in each."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from salframe.panoramas.folder_format import FrameEntry, TruthEntry, write_manifest, write_objects, write_panorama
from salframe.panoramas.frames import ReferenceFrame
from salframe.testing.rooms import ROOMS, map_frames, query_frames, query_truths


def write_tiny_folder(root: Path) -> Path:
    """Write it to `root` and return `root`; frames are BEDROOM-map and BEDROOM-query, and so on, 384 x 192 pixels."""
    labels = sorted({box.label for room in ROOMS for box in room.boxes})
    write_objects(root / "objects.parquet", {"instance_id": range(1, len(labels) + 1), "label": labels})
    entries = []
    for frame in (*map_frames(), *query_frames()):
        panorama = frame.load()
        known = {"role": "query"}
        if isinstance(frame, ReferenceFrame):
            known = {"role": "map", "place": frame.place, "pose": tuple(frame.T_world_pano.ravel().tolist())}
        files = {part: f"frames/{frame.id}.{part}.png" for part in ("rgb", "range", "instances")}
        entry = FrameEntry(id=frame.id, **known, **files)
        instance_id = np.zeros_like(panorama.annotations.instance_id)
        for number, label in panorama.annotations.labels.items():
            instance_id[panorama.annotations.instance_id == number] = labels.index(label) + 1
        write_panorama(root, entry, panorama.rgb, panorama.range_m, instance_id)
        entries.append(entry)
    truth = {id: TruthEntry(place=true.place) for id, true in query_truths().items()}
    write_manifest(root, entries, truth, objects="objects.parquet")
    return root
