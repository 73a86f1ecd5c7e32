"""localize: localize a panorama with a saved map."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from salframe.cli.options import DataDir, Json, Set
from salframe.cli.output import print_json

if TYPE_CHECKING:
    from salframe.localization.answers import Localization
    from salframe.panoramas.frames import QueryFrame, ReferenceFrame
    from salframe.panoramas.panorama import Panorama


def localize(
    map: Annotated[Path, typer.Argument(help="A folder that `salframe build` wrote.")],
    frame: Annotated[
        str | None, typer.Argument(help="An image of a folder with a manifest.json; or with --data, the id of a frame.")
    ] = None,
    data: Annotated[str | None, typer.Option(help="The dataset that has the frame.")] = None,
    rgb: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Instead of FRAME: the colours, twice as wide as high.")
    ] = None,
    range_image: Annotated[
        Path | None, typer.Option("--range", metavar="FILE", help="Its range, a 16-bit PNG, along the ray.")
    ] = None,
    range_unit: Annotated[
        float, typer.Option(metavar="METRES", min=1e-6, help="What one step of the range image is.")
    ] = 0.001,
    z_depth: Annotated[
        bool, typer.Option("--z-depth", help="It was stitched from a cube's faces and holds depth along their axes.")
    ] = False,
    instances: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Ids of its objects, a 16-bit PNG, 0 where there is none.")
    ] = None,
    labels: Annotated[
        Path | None, typer.Option(metavar="FILE", help='Labels of these ids, JSON such as {"1": "bed"}.')
    ] = None,
    data_dir: DataDir = None,
    overrides: Set = None,
    as_json: Json = False,
) -> None:
    """Print where a panorama was taken, a frame or loose images: places, best first, and the pose."""
    from salframe.cli.output import Bars, tell_units
    from salframe.framework.errors import ConfigError
    from salframe.localization.map import open_map
    from salframe.panoramas.opening import open_frame
    from salframe.panoramas.shot import read_panorama

    loose = any(file is not None for file in (rgb, range_image, instances, labels))
    if loose == (frame is not None):
        received = "both a frame and images" if loose else "neither a frame nor images"
        raise ConfigError(f"received {received}, expected one of the two")
    opened = open_map(map)
    asked: Panorama | ReferenceFrame | QueryFrame
    if frame is None:
        asked = read_panorama(rgb, range_image, instances, labels, range_unit_m=range_unit, z_depth=z_depth)
    else:
        with Bars() as bars:
            asked = open_frame(frame, data, data_dir, overrides or (), bars.update)
    tell_units([asked])
    answer = opened.localize(asked)
    tell_decided(map)
    if as_json:
        print_json(answer_json(answer))
    else:
        print_answer(answer)


def tell_decided(map: Path) -> None:
    """Tell what fills the slots of a map's localizer that are left to the data by default."""
    from salframe.cli.output import tell
    from salframe.framework.component import components_in
    from salframe.framework.components.defaults import auto_order
    from salframe.localization.map import map_config

    for slot, inner in components_in(map_config(map)):
        if auto_order(inner.component.role):
            tell(f"{slot} of the map: {inner.kind}")


def answer_json(answer: Localization) -> dict[str, Any]:
    """A localizer's answer as JSON: status, places, the probability of being in none of them, pose in metres and
    degrees, T_world_query row by row, and the heading, which may be known without a pose."""
    places = [
        {"place": place.place, "frame": place.frame, "score": place.score, "probability": place.probability}
        for place in answer.places
    ]
    matrix = None if answer.T_world_query is None else answer.T_world_query.tolist()
    return {
        "status": answer.status,
        "places": places,
        "out_of_map_probability": answer.out_of_map_probability,
        "pose": _position(answer),
        "T_world_query": matrix,
        "heading_deg": None if answer.heading_rad is None else math.degrees(answer.heading_rad),
    }


def print_answer(answer: Localization) -> None:
    """Print a localizer's answer: status, the best five places, by probability where they have one, the pose or at
    least the heading."""
    print(f"status: {answer.status}")
    for place in answer.places[:5]:
        worth = f"{place.score:10.4g}" if place.probability is None else f"{place.probability:10.1%}"
        print(f"{worth}  {place.place}  (frame {place.frame})")
    if answer.out_of_map_probability is not None:
        print(f"{answer.out_of_map_probability:10.1%}  in no place of the map")
    if position := _position(answer):
        print(f"pose: x {position['x_m']:.2f} m, y {position['y_m']:.2f} m, yaw {position['yaw_deg']:.1f} deg")
    elif answer.heading_rad is not None:
        print(f"heading: {math.degrees(answer.heading_rad):.1f} deg")


def _position(answer: Localization) -> dict[str, float] | None:
    import numpy as np

    from salframe.panoramas.geometry import pose_yaw

    pose = answer.T_world_query
    return (
        None if pose is None else {"x_m": pose[0, 3], "y_m": pose[1, 3], "yaw_deg": float(np.degrees(pose_yaw(pose)))}
    )
