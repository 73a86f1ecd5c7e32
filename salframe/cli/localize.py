"""build, localize: a map of places on disk, and one question to it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.compare import DataDir, Json, Set


def build(
    data: Annotated[str, typer.Argument(help="A dataset preset, a dataset, or a folder with a manifest.json.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="MAP", help="Folder to write the map to.")],
    method: Annotated[str, typer.Option(help="A preset or localizer.")] = "proposed",
    data_dir: DataDir = None, overrides: Set = None,
) -> None:  # fmt: skip
    """Build a map from a dataset's mapping frames."""
    from salframe.cli.tables import Bars, format_bytes
    from salframe.doctor import folder_bytes
    from salframe.maps import build_map

    with Bars() as bars:
        build_map(data, output, method, data_dir=data_dir, overrides=overrides or (), progress=bars.update)
    print(f"{output}: {format_bytes(folder_bytes(output))}")


def localize(
    map: Annotated[Path, typer.Argument(help="A folder that `salframe build` wrote.")],
    frame: Annotated[str, typer.Argument(help="An image of a folder with a manifest.json; or with --data, the id of a frame.")],
    data: Annotated[str | None, typer.Option(help="The dataset that has the frame.")] = None,
    data_dir: DataDir = None, overrides: Set = None, as_json: Json = False,
) -> None:  # fmt: skip
    """Print where a panorama was taken: places, best first, and the pose."""
    import numpy as np

    from salframe.cli.tables import Bars
    from salframe.geometry import pose_yaw
    from salframe.maps import find_dataset, find_frame, find_image, open_map

    localizer = open_map(map)
    if data is None:
        folder, frame = find_image(Path(frame))
        data = str(folder)
    with Bars() as bars:
        dataset = find_dataset(data, data_dir, overrides or (), bars.update)
    answer = localizer.localize(find_frame(dataset, frame))
    pose = answer.T_world_query
    position = None if pose is None else {"x_m": pose[0, 3], "y_m": pose[1, 3], "yaw_deg": float(np.degrees(pose_yaw(pose)))}
    if as_json:
        places = [{"place": place.place, "frame": place.frame, "score": place.score} for place in answer.places]
        matrix = None if pose is None else pose.tolist()
        print(json.dumps({"status": answer.status, "places": places, "pose": position, "T_world_query": matrix}, indent=2))
        return
    print(f"status: {answer.status}")
    for place in answer.places[:5]:
        print(f"{place.score:10.4g}  {place.place}  (frame {place.frame})")
    if position is not None:
        print(f"pose: x {position['x_m']:.2f} m, y {position['y_m']:.2f} m, yaw {position['yaw_deg']:.1f} deg")
