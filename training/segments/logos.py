"""Objects that `segments` finds in a logo: `python -m training.segments.logos --seed 200`.

The command paints a logo into the panoramas of a rendered building, 25 degrees around the nadir and without range, as
360-degree cameras do to hide the tripod. It writes the panoramas as a folder, and counts the objects of the detector
near the nadir: without logo, with logo, and with logo where the reader of the folder does not mask it. The page
docs/how-to/import.md reports the results.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from salframe.framework.components.presets import configure
from salframe.framework.components.registry import registry
from salframe.framework.errors import SalframeError
from salframe.localization.preparing import prepare
from salframe.panoramas.folder_format import FrameEntry, image_names, write_manifest, write_panorama
from salframe.panoramas.folder_reader import Folder
from salframe.panoramas.geometry import row_elevation
from salframe.panoramas.opening import reference_frames

LOGO_DEG, NEAR_DEG = 25.0, 30.0
"""Angular radius of the logo, and maximum angle between the nadir and objects that are counted."""
SIDE_PX = 1024
"""Side of the square picture of the logo, seen from above."""


def logo_picture() -> np.ndarray:
    """Return the logo seen from above, (SIDE_PX, SIDE_PX, 3) uint8: a ring, a star and a name on white."""
    picture = np.full((SIDE_PX, SIDE_PX, 3), 240, np.uint8)
    centre = SIDE_PX // 2
    cv2.circle(picture, (centre, centre), 400, (30, 90, 170), 60)
    cv2.drawMarker(picture, (centre, centre - 120), (200, 60, 40), cv2.MARKER_STAR, 260, 50)
    cv2.putText(picture, "CAMERA 360", (170, 660), cv2.FONT_HERSHEY_SIMPLEX, 3.4, (20, 20, 20), 16)
    return picture


def paint_logo(rgb: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """Return a panorama (H, 2H, 3) uint8 with the logo around the nadir."""
    height = len(rgb)
    in_logo = row_elevation(height) < np.radians(LOGO_DEG - 90)
    radius = (np.pi / 2 + row_elevation(height)[in_logo]) / np.radians(LOGO_DEG) * (SIDE_PX / 2 - 1)
    azimuth = (np.arange(2 * height) + 0.5) * np.pi / height
    x = SIDE_PX / 2 + radius[:, None] * np.sin(azimuth)
    y = SIDE_PX / 2 + radius[:, None] * np.cos(azimuth)
    painted = rgb.copy()
    painted[in_logo] = cv2.remap(picture, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
    return painted


def main(
    seed: Annotated[int, typer.Option(help="Seed of the building")],
    data: Annotated[str, typer.Option(help="Dataset: a preset of rendered buildings")] = "house-12",
) -> None:
    """Count the objects near the nadir with and without the mask of a logo."""
    detector = registry().build("detector", configure("detector", "segments", {"tilted_views": 4}))
    picture = logo_picture()
    counts = {"no logo": 0, "logo": 0, "masked logo": 0}
    masked_rows: list[int] = []
    try:
        _, dataset, _ = prepare(data, "proposed", None, [f"data.seed={seed}", "data.rgb=true"], None, None, print)
        panoramas = [(frame, frame.load()) for frame in reference_frames(dataset)]
        with tempfile.TemporaryDirectory() as directory:
            root = Path(directory)
            entries = []
            for index, (frame, panorama) in enumerate(panoramas):
                names = image_names(f"frames/r{index}", ("rgb", "range"))
                pose = tuple(frame.T_world_pano.ravel().tolist())
                entries.append(FrameEntry(id=f"r{index}", role="map", place=frame.place, pose=pose, **names))
                in_logo = row_elevation(len(panorama.rgb)) < np.radians(LOGO_DEG - 90)
                range_m = np.where(in_logo[:, None], np.nan, panorama.range_m)
                write_panorama(root, entries[-1], paint_logo(panorama.rgb, picture), range_m)
            write_manifest(root, entries, {})
            folder = Folder(root)
            for entry, (_, panorama) in zip(folder.manifest.frames, panoramas, strict=True):
                masked = folder.load(entry)
                masked_rows.append(0 if masked.valid is None else int((~masked.valid).any(axis=1).sum()))
                for name, shown in zip(
                    counts, (replace(panorama, annotations=None), replace(masked, valid=None), masked), strict=True
                ):
                    bearing = detector.detect(shown).bearing
                    counts[name] += int((bearing[:, 2] < -np.cos(np.radians(NEAR_DEG))).sum())
    except SalframeError as error:
        raise SystemExit(f"error: {error}") from None
    print(f"{len(masked_rows)} panoramas; masked rows: {min(masked_rows)} to {max(masked_rows)}")
    for name, count in counts.items():
        print(f"{name}: {count} objects at most {NEAR_DEG:g} degrees from the nadir")


if __name__ == "__main__":
    typer.run(main)
