"""Measure the import of a rendered home that is written in each format, and the localization in the imported folder.

    python tests/benchmarks/import_formats.py [--formats NAMES] [--panoramas N] [--folder DIR]

`house-42` is rendered at 512 x 256 pixels. Of its panoramas, N (at most 100) are written in each format by
tests/importers, without salframe. About a third of them are queries in rooms of the others. Then `data import` with the
floor masks of the home, `data info`, `build` (with the detector `panoseg`), `localize` (one query) and `map route` are
called. Printed are what they print and, in a row of JSON and a table of Markdown, the time of the import for 100
panoramas, the errors of poses and ranges of the imported folder, the share of queries with the correct place, the
position and heading errors of the accepted answers in the map of the imported folder, and the length of the route.
Positions and ranges are compared with the renderer.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

TESTS = Path(__file__).parent.parent
sys.path[:0] = [str(TESTS / "importers"), str(TESTS / "matterport")]

from foreign_formats import (  # noqa: E402
    Stand,
    image_rays,
    write_cubemaps,
    write_pictures,
    write_rgb,
    write_steps,
    write_transforms,
    write_tum,
)
from home_writers import write_bag, write_colmap  # noqa: E402

import salframe  # noqa: E402
from salframe.panoramas.floors import FloorMasks  # noqa: E402
from salframe.panoramas.folder_format import write_floor  # noqa: E402
from salframe.panoramas.geometry import pose_errors, rays_to_pixels, sample_nearest  # noqa: E402

HEIGHT = 256
REFERENCE_SHARE = 0.64
DATA = ["data.height=256", "data.queries_per_room=1"]
SETTINGS = {
    "pictures": [],
    "tum": ["height=256", "camera=default"],
    "colmap": ["height=256", "camera_height=1.5"],
    "matterport3d": ["height=256", "color=pictures"],
}
"""Settings of each import; otherwise the height of the stitched panoramas."""
IMAGE = {"w": 192, "h": 160, "fl_x": 96.0, "fl_y": 96.0, "cx": 96.0, "cy": 80.0}
"""Posed images of 90 x 80 degrees with the resolution of the panoramas."""


def look(panorama: salframe.Panorama, T_world_pano: np.ndarray, T_world_camera: np.ndarray, calibration: dict):
    """Colour and z-depth that a camera at the position of a panorama sees of it."""
    rays = image_rays(calibration)
    directions = rays @ (T_world_pano[:3, :3].T @ T_world_camera[:3, :3]).T
    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    depth_m = sample_nearest(panorama.range_m, unit) / np.linalg.norm(rays, axis=-1)
    return sample(panorama.rgb, unit), np.nan_to_num(depth_m)


def sample(rgb: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Return the colour of rays, bilinear."""
    import cv2

    columns, rows = rays_to_pixels(rays, len(rgb))
    wrapped = np.concatenate([rgb[:, -1:], rgb, rgb[:, :1]], 1)
    columns, rows = (columns + 0.5).astype(np.float32), np.clip(rows - 0.5, 0, len(rgb) - 1).astype(np.float32)
    return cv2.remap(wrapped, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def resized(panorama: salframe.Panorama, T_world_pano: np.ndarray, height: int):
    """Colour and range of a panorama at another height."""
    rays = salframe.equirectangular_rays(height)
    return sample(panorama.rgb, rays), sample_nearest(panorama.range_m, rays)


def read_stands(num_panoramas: int) -> tuple[list[Stand], list[Stand], FloorMasks]:
    """Return the reference stands and the query stands of the rendered home, and its floor."""
    dataset = salframe.find_dataset("house-42", overrides=DATA)
    (fold,) = dataset.folds()
    scenes = [frame for frame in fold.references if frame.kind is salframe.FrameKind.SCENE]
    scenes = scenes[: round(REFERENCE_SHARE * num_panoramas)]
    mapped = {frame.place for frame in scenes}
    truths = [(query, truth) for query in fold.queries if (truth := dataset.truth(query.id)).place in mapped]

    def stand(frame, place, pose) -> Stand:
        panorama = frame.load()
        name = frame.id.removeprefix("map-")
        return Stand(name, place, pose, partial(look, panorama, pose), lambda T, height: resized(panorama, T, height))

    references = [stand(frame, frame.place, frame.T_world_pano) for frame in scenes]
    queries = [stand(query, truth.place, truth.T_world_pano) for query, truth in truths]
    (floor,) = dataset.floors()
    return references, queries[: num_panoramas - len(references)], floor


def write_matterport(root: Path, stands: list[Stand]) -> Path:
    """Write the official layout of Matterport3D, whose pictures are 1280 x 1024 pixels."""
    from official_layout import CX, CY, FX, FY, SIZE, camera_lines, rig, write_building

    calibration = {"w": SIZE[0], "h": SIZE[1], "fl_x": FX, "fl_y": FY, "cx": CX + 0.5, "cy": CY + 0.5}
    folder, lines, places, panoramas = root / "v1" / "scans" / "home", [], [], {}
    for number, stand in enumerate(stands):
        name = f"{number:032x}"
        poses = rig(stand.position, 90 - stand.heading_deg, rise_m=(0, 0, 0))
        for (camera, stop), pose in poses.items():
            rgb, depth_m = stand.look(pose, calibration)
            write_rgb(folder / "undistorted_color_images" / f"{name}_i{camera}_{stop}.jpg", rgb)
            write_steps(folder / "undistorted_depth_images" / f"{name}_d{camera}_{stop}.png", depth_m, 1 / 4000)
        lines += camera_lines(name, poses)
        places += [] if stand.place in places else [stand.place]
        panoramas[name] = places.index(stand.place), stand.position
    write_building(folder, lines, dict.fromkeys(range(len(places)), ((0, 0, 0), (1, 1, 1))), panoramas)
    return root


def salframe_command(*arguments: object) -> str:
    """Run a command and return what it prints. Raises RuntimeError if it fails."""
    command = [sys.executable, "-m", "salframe.cli", *map(str, arguments)]
    code = "import sys; from salframe.cli import main; sys.argv[0] = 'salframe'; main()"
    done = subprocess.run([sys.executable, "-c", code, *command[3:]], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"salframe {' '.join(command[3:])}: {done.stderr}")
    return done.stderr + done.stdout


def measure(format: str, root: Path, references: list[Stand], queries: list[Stand], floor: FloorMasks) -> dict:
    """Write the home in a format, import it, and compare the imported folder with the home."""
    settings = SETTINGS.get(format, ["height=256"])
    stands = [*references, *queries]
    writers: dict[str, Callable[[Path], Path]] = {
        "pictures": lambda path: write_pictures(path, references, queries, HEIGHT),
        "perspective": lambda path: write_transforms(path, stands, IMAGE, apart_m=0.0),
        "tum": lambda path: write_tum(path, stands),
        "cubemap": lambda path: write_cubemaps(path, stands, size=HEIGHT // 2),
        "matterport3d": lambda path: write_matterport(path, stands),
        "colmap": lambda path: write_colmap(path, stands, IMAGE),
        "rosbag": lambda path: write_bag(path, stands, HEIGHT),
    }
    entry = write_floor(root, "floor", floor).model_dump(mode="json")
    (root / "floors.yaml").write_text(json.dumps({"floors": [entry]}))
    source, folder, map_folder = root / "source", root / "imported", root / "map"
    writers[format](source)
    ids = {
        "tum": [f"station-{number:03d}" for number in range(1, len(stands) + 1)],
        "matterport3d": [f"{number:032x}" for number in range(len(stands))],
        "rosbag": [f"{number:06d}" for number in range(len(stands))],
    }.get(format, [stand.name for stand in stands])
    by_id = dict(zip(ids, stands, strict=True))
    (root / "queries.txt").write_text("\n".join(ids[len(references) :]))
    options = ["--floors", root / "floors.yaml"]
    if format == "colmap":
        settings = [*settings, f"depth={source / 'depth'}"]
    options += [option for setting in settings for option in ("--set", setting)]
    options += [] if format == "pictures" else ["--queries", root / "queries.txt"]
    start = time.perf_counter()
    printed = {"import": salframe_command("data", "import", format, source, "-o", folder, *options)}
    seconds = time.perf_counter() - start
    printed["info"] = salframe_command("data", "info", folder)
    printed["build"] = salframe_command("build", folder, "-o", map_folder, "--set", "detector.kind=panoseg")
    query = folder / "frames" / f"{ids[len(references)]}.jpg"
    printed["localize"] = salframe_command("localize", map_folder, query)
    start_id, goal_id = ids[0], ids[len(references) - 1]
    printed["route"] = salframe_command("map", "route", map_folder, start_id, goal_id)
    return {
        "format": format,
        "panoramas": len(stands),
        "seconds_per_100": 100 * seconds / len(stands),
        "route": printed["route"].partition("\n")[0],
        **compare(folder, map_folder, by_id, own_heading=format != "tum"),
        "printed": printed,
    }


def compare(folder: Path, map_folder: Path, by_id: dict[str, Stand], own_heading: bool) -> dict:
    """Return the errors of the poses and ranges of an imported folder, and of the answers of its map.

    Without `own_heading`, the importer chooses the headings of the panoramas. They are then not compared with the
    renderer, and answers are compared with the imported poses.
    """
    dataset = salframe.find_dataset(str(folder))
    (fold,) = dataset.folds()
    shifts_m, turns_deg, range_errors = [], [], []
    for frame in fold.references:
        stand, imported = by_id[frame.id], frame.load()
        shift_m, turn_rad = pose_errors(frame.T_world_pano, stand.T_world_pano)
        shifts_m.append(shift_m)
        turns_deg.append(np.degrees(turn_rad) if own_heading else np.nan)
        rays = salframe.equirectangular_rays(len(imported.range_m)) @ frame.T_world_pano[:3, :3].T
        truth_m = sample_nearest(stand.panorama(stand.T_world_pano, HEIGHT)[1], rays @ stand.T_world_pano[:3, :3])
        ratio = imported.range_m / truth_m
        range_errors.append(np.abs(ratio[np.isfinite(ratio)] - 1))
    localizer = salframe.open_map(str(map_folder))
    right, errors_m, errors_deg = [], [], []
    for query in fold.queries:
        answer, stand = localizer.localize(query.load()), by_id[query.id]
        right.append(answer.accepted and answer.places[0].place == stand.place)
        if answer.accepted and answer.T_world_query is not None:
            truth = stand.T_world_pano if own_heading else dataset.truth(query.id).T_world_pano
            error_m, error_rad = pose_errors(answer.T_world_query, truth)
            errors_m.append(error_m)
            errors_deg.append(np.degrees(error_rad))
    return {
        "max_pose_error_m": max(shifts_m),
        "max_pose_error_deg": max(turns_deg),
        "median_range_error": float(np.median(np.concatenate(range_errors))),
        "known_share": float(np.mean([np.isfinite(frame.load().range_m).mean() for frame in fold.references])),
        "references": len(fold.references),
        "right_reference_places": float(np.mean([frame.place == by_id[frame.id].place for frame in fold.references])),
        "queries": len(fold.queries),
        "right_places": sum(right),
        "posed": len(errors_m),
        "median_error_m": float(np.median(errors_m)) if errors_m else None,
        "median_error_deg": float(np.median(errors_deg)) if errors_deg else None,
    }


def table(rows: Sequence[dict]) -> str:
    """Return the measured rows as a table of Markdown."""
    lines = [
        "| format | import of 100 panoramas | largest pose error | median range error | known range "
        "| queries with the correct place | median pose error of the queries | `map route` |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        pose = "no pose"
        if row["posed"]:
            pose = f"{row['median_error_m']:.2f} m, {row['median_error_deg']:.1f} deg ({row['posed']} poses)"
        turn = f"{row['max_pose_error_deg']:.2f} deg" if np.isfinite(row["max_pose_error_deg"]) else "own heading"
        lines.append(
            f"| `{row['format']}` | {row['seconds_per_100']:.0f} s "
            f"| {row['max_pose_error_m'] * 1000:.1f} mm, {turn} "
            f"| {row['median_range_error']:.1%} | {row['known_share']:.0%} "
            f"| {row['right_places']} of {row['queries']} | {pose} | {row['route'].rpartition(': ')[2]} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Measure the formats and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--formats", default="pictures,perspective,tum,cubemap,matterport3d,colmap,rosbag")
    parser.add_argument("--panoramas", type=int, default=100)
    parser.add_argument("--folder", type=Path, help="where the recordings are written (default: a temporary folder)")
    arguments = parser.parse_args()
    references, queries, floor = read_stands(arguments.panoramas)
    rows = []
    for format in arguments.formats.split(","):
        with tempfile.TemporaryDirectory(dir=arguments.folder) as root:
            row = measure(format, Path(root), references, queries, floor)
            shutil.rmtree(root, ignore_errors=True)
            Path(root).mkdir(exist_ok=True)
        printed = row.pop("printed")
        print(json.dumps(row))
        for command, text in printed.items():
            print(f"--- {command}\n{text}", flush=True)
        rows.append(row)
    print(table(rows))


if __name__ == "__main__":
    main()
