"""The command `localize`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from salframe.cli.options import DataDir, Json, Set, number_parser
from salframe.cli.output import print_json

if TYPE_CHECKING:
    from salframe.localization.answers import Localization
    from salframe.panoramas.frames import QueryFrame, ReferenceFrame
    from salframe.panoramas.panorama import Panorama


def localize(
    map: Annotated[Path, typer.Argument(help="Map folder written by `salframe build`")],
    frame: Annotated[
        str | None, typer.Argument(help="Image in a folder with a manifest.json, or frame id with --data")
    ] = None,
    data: Annotated[str | None, typer.Option(help="Dataset that contains the frame")] = None,
    rgb: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Equirectangular colour image, instead of FRAME")
    ] = None,
    range_image: Annotated[
        Path | None, typer.Option("--range", metavar="FILE", help="Range image, 16-bit PNG, measured along the ray")
    ] = None,
    range_unit: Annotated[
        float,
        typer.Option(
            parser=number_parser("--range-unit", float, 1e-6, 1.0),
            metavar="METRES",
            help="Size of one step of the range image",
        ),
    ] = 0.001,
    z_depth: Annotated[
        bool, typer.Option("--z-depth", help="Range image holds the z-depth of stitched cube faces")
    ] = False,
    instances: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Object ids, 16-bit PNG, 0 for no object")
    ] = None,
    labels: Annotated[
        Path | None, typer.Option(metavar="FILE", help='Labels of the object ids, JSON such as {"1": "bed"}')
    ] = None,
    data_dir: DataDir = None,
    overrides: Set = None,
    as_json: Json = False,
) -> None:
    """Localize a panorama in a saved map.

    The query is a frame of a dataset or loose images. Prints the places, best first, and the pose.
    """
    from salframe.cli.output import Bars, warn_units
    from salframe.framework.errors import ConfigError
    from salframe.localization.map import open_map
    from salframe.panoramas.opening import open_frame
    from salframe.panoramas.shot import read_panorama

    loose = any(file is not None for file in (rgb, range_image, instances, labels))
    if loose == (frame is not None):
        received = "both a frame and images" if loose else "neither a frame nor images"
        raise ConfigError(f"received {received}, expected either FRAME or image files such as --rgb FILE")
    saved_map = open_map(map)
    query: Panorama | ReferenceFrame | QueryFrame
    if frame is None:
        query = read_panorama(rgb, range_image, instances, labels, range_unit_m=range_unit, z_depth=z_depth)
    else:
        with Bars() as bars:
            query = open_frame(frame, data, data_dir, overrides or (), bars.update)
    warn_units([query])
    answer = saved_map.localize(query)
    tell_choices(map)
    if as_json:
        print_json(answer_json(answer))
    else:
        print_answer(answer)


def tell_choices(map: Path) -> None:
    """Print the components in those slots of a map's localizer that may be `auto`."""
    from salframe.cli.output import tell
    from salframe.framework.component import components_in
    from salframe.framework.components.defaults import auto_order
    from salframe.localization.map import map_config

    for slot, inner in components_in(map_config(map)):
        if auto_order(inner.component.role):
            tell(f"{slot} of the map: {inner.kind}")


def answer_json(answer: Localization) -> dict[str, Any]:
    """Return the answer of a localizer as JSON.

    It holds the status, the places, the out-of-map probability, the pose in metres and degrees, the rows of
    T_world_query, and the heading in degrees. A heading may be known without a pose.
    """
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
    """Print the answer of a localizer: status, the five best places, and the pose or only the heading.

    Places are printed with their probability, or with their score if they have none.
    """
    print(f"status: {answer.status}")
    for place in answer.places[:5]:
        value = f"{place.score:10.4g}" if place.probability is None else f"{place.probability:10.1%}"
        print(f"{value}  {place.place}  (frame {place.frame})")
    if answer.out_of_map_probability is not None:
        print(f"{answer.out_of_map_probability:10.1%}  out-of-map")
    if position := _position(answer):
        print(f"pose: x {position['x_m']:.2f} m, y {position['y_m']:.2f} m, yaw {position['yaw_deg']:.1f} deg")
    elif answer.heading_rad is not None:
        print(f"heading: {math.degrees(answer.heading_rad):.1f} deg")


def _position(answer: Localization) -> dict[str, float] | None:
    """Return x and y in metres and yaw in degrees, or None without a pose."""
    import numpy as np

    from salframe.panoramas.geometry import pose_yaw

    pose = answer.T_world_query
    return (
        None if pose is None else {"x_m": pose[0, 3], "y_m": pose[1, 3], "yaw_deg": float(np.degrees(pose_yaw(pose)))}
    )
