"""Preview of an import: a summary of the recording, a contact sheet of its panoramas, and a top view of its poses."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from salframe.drawing.canvas import FAINT, INK, PAPER, Colour, disk, font, stroke
from salframe.framework.errors import DataError, describe_error
from salframe.framework.files.writing import check_picture_output
from salframe.panoramas import images
from salframe.panoramas.camera_height import camera_height
from salframe.panoramas.data_checks import fold_notes
from salframe.panoramas.geometry import row_elevation
from salframe.panoramas.import_floors import read_floors, with_regions
from salframe.panoramas.import_selection import SelectedPanorama, select
from salframe.panoramas.importer import PlaceSource
from salframe.panoramas.importing import find_importer, read_recording, selected_fold
from salframe.panoramas.opening import Progress
from salframe.panoramas.panorama import Panorama

MAX_SHOWN = 24
"""Maximum number of panoramas that are read."""
TILE, COLUMNS = (256, 128), 4
"""Width and height of a panorama on the contact sheet, and number of panoramas in a row."""
SIDE, MARGIN, LEGEND = 900, 60, 30
"""Side and margin of the top view, and height of its legend in pixels."""
REFERENCE, QUERY = (31, 119, 180), (214, 39, 40)
"""Colours of reference frames and queries in the top view."""


@dataclass(frozen=True, eq=False)
class ImportPreview:
    """Summary of the dataset that an import would write.

    Attributes:
        num_references: Number of reference frames.
        num_queries: Number of query panoramas. Each view of a sequence is counted.
        num_without_pose: Number of panoramas without a pose.
        num_places: Number of places of reference frames.
        place_from: Source of the names of places.
        camera_z_m: Minimum, median and maximum z of the poses of the reference frames.
        camera_height_m: Median height of the camera above the floor in the range images; None if no floor is visible.
        valid_range_share: Share of the visible part of the sphere whose range is known, averaged over the panoramas
            with range that were read; None if there are none.
        max_tilt_deg: Maximum angle between the up axis of a reference frame and the up axis of the world.
        pictures: Paths of the contact sheet and of the top view.
        failures: The one-line error of each panorama that could not be read, by id.
        notes: Warnings, one line each.
        seconds: Computing time of the preview.
    """

    num_references: int
    num_queries: int
    num_without_pose: int
    num_places: int
    place_from: PlaceSource
    camera_z_m: tuple[float, float, float]
    camera_height_m: float | None
    valid_range_share: float | None
    max_tilt_deg: float
    pictures: tuple[Path, Path]
    failures: Mapping[str, str]
    notes: tuple[str, ...]
    seconds: float

    def to_json(self) -> dict[str, Any]:
        """Return the preview as JSON."""
        return {**asdict(self), "pictures": [str(path) for path in self.pictures]}

    def lines(self) -> list[str]:
        """Return the preview as text."""
        low_m, middle_m, high_m = self.camera_z_m
        height_m, share = self.camera_height_m, self.valid_range_share
        return [
            f"reference frames: {self.num_references} in {self.num_places} places (--place-from {self.place_from})",
            f"queries: {self.num_queries} ({self.num_without_pose} without a pose)",
            f"camera z: {low_m:.2f} to {high_m:.2f} m, median {middle_m:.2f} m",
            f"camera height above the visible floor: {'unknown' if height_m is None else f'{height_m:.2f} m'}",
            f"known range: {'none' if share is None else f'{share:.0%} of the visible sphere'}",
            f"up direction: at most {self.max_tilt_deg:.1f} deg from that of the world",
            f"pictures: {self.pictures[0]}, {self.pictures[1]}",
        ]


def preview_import(
    format: str,
    source: str | Path,
    output: str | Path,
    *,
    settings: Sequence[str] = (),
    place_from: str | None = None,
    queries: str | Path | None = None,
    every: str | None = None,
    floors: str | Path | None = None,
    progress: Progress | None = None,
) -> ImportPreview:
    """Read a sample of a recording, check its conventions and draw two pictures. No dataset is written.

    The contact sheet OUTPUT-contact-sheet.png shows up to MAX_SHOWN panoramas, and OUTPUT-top-view.png all poses.

    Args:
        format: As in `import_data`.
        source: As in `import_data`.
        output: The folder of the import. It is not created.
        settings: As in `import_data`.
        place_from: As in `import_data`.
        queries: As in `import_data`.
        every: As in `import_data`.
        floors: As in `import_data`.
        progress: Called as progress(name of the step, done, total) with numbers of panoramas; None: not called.

    Raises:
        UnknownName: As in `import_data`.
        ConfigError: An argument is invalid, or a picture would replace another file.
        DataError: The source is missing or malformed.
    """
    start, output = time.perf_counter(), Path(output)
    pictures = tuple(output.with_name(f"{output.name}-{name}.png") for name in ("contact-sheet", "top-view"))
    for picture in pictures:
        check_picture_output(picture)
    masks = [] if floors is None else read_floors(Path(floors))
    recording = with_regions(read_recording(find_importer(format, settings), source), masks)
    place_source, selected = select(recording, place_from, queries, every)
    sample = [selected[i] for i in sorted({round(i) for i in np.linspace(0, len(selected) - 1, MAX_SHOWN)})]
    loaded: dict[str, Panorama] = {}
    failures: dict[str, str] = {}
    for done, panorama in enumerate(sample):
        if progress is not None:
            progress(f"read {format}", done, len(sample))
        try:
            loaded[panorama.record.id] = panorama.record.load()
        except DataError as error:
            failures[panorama.record.id] = describe_error(error)
    fold = selected_fold(selected)
    try:
        checks = fold_notes([fold], masks)
    except DataError as error:  # building a map raises this error
        checks = [str(error)]
    ranges = [panorama for panorama in loaded.values() if panorama.range_m is not None]
    heights_m = [height for panorama in ranges if (height := camera_height(np.asarray(panorama.range_m))) is not None]
    poses = np.array([frame.T_world_pano for frame in fold.references])
    images.write_color(pictures[0], draw_contact_sheet(loaded))
    images.write_color(pictures[1], draw_top_view(selected))
    return ImportPreview(
        len(fold.references),
        sum(panorama.is_query for panorama in selected),
        sum(panorama.record.T_world_pano is None for panorama in selected),
        len({frame.place for frame in fold.references}),
        place_source,
        (float(poses[:, 2, 3].min()), float(np.median(poses[:, 2, 3])), float(poses[:, 2, 3].max())),
        float(np.median(heights_m)) if heights_m else None,
        float(np.mean([_known_share(panorama) for panorama in ranges])) if ranges else None,
        float(np.degrees(np.arccos(np.clip(poses[:, 2, 2], -1, 1))).max()),
        (pictures[0], pictures[1]),
        failures,
        (*recording.notes, *checks),
        time.perf_counter() - start,
    )


def draw_contact_sheet(panoramas: Mapping[str, Panorama]) -> np.ndarray:
    """Return a picture of panoramas with their ids, (h, w, 3) uint8. A panorama without colour is shown by its
    range."""
    import cv2
    from PIL import Image, ImageDraw

    width, height = TILE
    rows = max(1, -(-len(panoramas) // COLUMNS))
    sheet = np.full((rows * (height + LEGEND), COLUMNS * width, 3), PAPER, np.uint8)
    corners = [(i // COLUMNS * (height + LEGEND), i % COLUMNS * width) for i in range(len(panoramas))]
    for (row, column), panorama in zip(corners, panoramas.values(), strict=True):
        sheet[row : row + height, column : column + width] = cv2.resize(
            _shown(panorama), TILE, interpolation=cv2.INTER_AREA
        )
    picture = Image.fromarray(sheet)
    draw = ImageDraw.Draw(picture)
    for (row, column), id in zip(corners, panoramas, strict=True):
        draw.text((column + 4, row + height + 4), id[-40:], INK, font(12))
    return np.array(picture)


def draw_top_view(selected: Sequence[SelectedPanorama]) -> np.ndarray:
    """Return a picture of the positions and headings of all poses viewed from above, (h, w, 3) uint8, with x to the
    right and y up."""
    from PIL import Image, ImageDraw

    posed = [panorama for panorama in selected if panorama.record.T_world_pano is not None]
    poses = np.array([panorama.record.T_world_pano for panorama in posed])
    low, high = poses[:, :2, 3].min(0), poses[:, :2, 3].max(0)
    scale = (SIDE - 2 * MARGIN) / max(float((high - low).max()), 1.0)
    image = np.full((SIDE + LEGEND, SIDE, 3), PAPER, np.uint8)

    def pixel(xy_m: np.ndarray) -> np.ndarray:
        return SIDE / 2 + (xy_m - (low + high) / 2) * scale * (1, -1)

    step_m = next(step for step in (1, 2, 5, 10, 20, 50, 100, 200, 500, 10**9) if step * scale >= 40)
    reach = SIDE / scale / 2
    for axis in (0, 1):
        middle = (low + high)[axis] / 2
        for at in np.arange(np.ceil((middle - reach) / step_m), (middle + reach) / step_m) * step_m:
            ends = np.tile((low + high) / 2, (2, 1))
            ends[:, axis], ends[:, 1 - axis] = at, ends[:, 1 - axis] + (-reach, reach)
            stroke(image, pixel(ends), (229, 231, 235), 1)
    for panorama, pose in zip(posed, poses, strict=True):
        colour: Colour = QUERY if panorama.is_query else REFERENCE
        at = pixel(pose[:2, 3])
        stroke(image, np.stack([at, at + 16 * pose[:2, 0] * (1, -1)]), colour, 2)
        disk(image, at, 5, colour)
    image[SIDE:] = PAPER
    picture = Image.fromarray(image)
    legend = f"{len(posed)} poses from above: reference blue, query red; x right, y up; grid {step_m} m"
    ImageDraw.Draw(picture).text((8, SIDE + 6), legend, FAINT, font(14))
    return np.array(picture)


def _shown(panorama: Panorama) -> np.ndarray:
    """Return the colour of a panorama, or its range in grey, (H, 2H, 3) uint8."""
    if panorama.rgb is not None:
        return panorama.rgb
    if panorama.range_m is None:
        return np.zeros((TILE[1], TILE[0], 3), np.uint8)
    near = 255 / (1 + np.nan_to_num(panorama.range_m, nan=np.inf))
    return np.repeat(near[..., None], 3, 2).astype(np.uint8)


def _known_share(panorama: Panorama) -> float:
    """Return the share (by solid angle) of the visible part of the sphere whose range is known."""
    known = np.isfinite(np.asarray(panorama.range_m))
    visible = np.ones_like(known) if panorama.valid is None else panorama.valid
    weight = np.cos(row_elevation(len(known)))[:, None]
    return float((weight * (known & visible)).sum() / max(float((weight * visible).sum()), 1e-9))
