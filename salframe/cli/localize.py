"""The command `localize`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from salframe.cli.options import (
    CameraFile,
    DataDir,
    Fov,
    Json,
    RangeMissing,
    RangeUnit,
    SetForData,
    number_parser,
    range_options,
)
from salframe.cli.output import print_json

if TYPE_CHECKING:
    from salframe.localization.answers import Localization


def localize(
    map: Annotated[Path, typer.Argument(metavar="MAP", help="Map folder that `salframe build` wrote")],
    frame: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="FRAME",
            help="Query: photograph (with --fov or --camera), panorama file of a dataset folder, or id of a "
            "panorama in --data. For other panorama files, use --rgb",
        ),
    ] = None,
    views: Annotated[
        bool, typer.Option("--views", help="Localize several images (views) together, as one query")
    ] = False,
    motion: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="CSV file with the camera poses of --views in any fixed coordinate system: one row per view, with the "
            "columns t_s, x_m, y_m, z_m, yaw_deg",
        ),
    ] = None,
    data: Annotated[
        str | None, typer.Option(metavar="DATASET", help="Dataset that contains the panorama whose id is FRAME")
    ] = None,
    rgb: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Colour image to localize, instead of FRAME; it need not belong to a dataset"
        ),
    ] = None,
    range_image: Annotated[
        list[Path] | None,
        typer.Option(
            "--range",
            metavar="FILE",
            help="Range image of the query (16-bit PNG); with --views, one --range for each view",
        ),
    ] = None,
    range_unit: RangeUnit = None,
    range_missing: RangeMissing = None,
    range_kind: Annotated[
        Literal["ray", "z", "cube"] | None,
        typer.Option(
            help="What a range image contains: distance along the ray of each pixel (ray), depth along the "
            "optical axis of a photograph (z), or depth along the axis of a cube face (cube). Default: ray; for "
            "photographs: z"
        ),
    ] = None,
    fov: Fov = None,
    camera: CameraFile = None,
    instances: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Image of object ids (16-bit PNG, 0: no object); with --views, one --instances for each view",
        ),
    ] = None,
    labels: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help='JSON file that maps the object ids of --instances to labels, such as {"1": "bed"}'
        ),
    ] = None,
    max_false_accept: Annotated[
        float | None,
        typer.Option(
            parser=number_parser("--max-false-accept", float, 0.001, 0.999),
            metavar="SHARE",
            help="Maximum false accept rate (share of the queries from outside the map that are accepted), such as "
            "0.05; needs a calibrated map",
        ),
    ] = None,
    trajectory: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.tum", help="File to write the pose to, in the TUM trajectory format with the timestamp 0"
        ),
    ] = None,
    data_dir: DataDir = None,
    overrides: SetForData = None,
    as_json: Json = False,
) -> None:
    """Localize a panorama in a saved map.

    Prints the places, best first, and the pose. If the place is too uncertain, the answer is not accepted. The
    command then suggests a turn of the camera to a direction that the query does not show, if there is one.

    By default, images are read as panoramas. With --fov or --camera, images are read as photographs. The file of
    --camera can contain T_base_camera, the pose of the camera on a robot. The answer then has the pose of the robot's
    base.

    With --views, several images form one query. List the images in the order in which they were taken. The answer has
    the pose of the last image.

    With --trajectory, the pose of the answer is also written to a file. If the answer has no pose, the file contains
    only comments.
    """
    from salframe.cli.output import warn
    from salframe.cli.queries import QueryOptions
    from salframe.framework.files.writing import write_text
    from salframe.localization.answer_json import answer_json, next_view_json
    from salframe.localization.map import open_map
    from salframe.localization.trajectory import tum_lines

    query = QueryOptions(
        frames=frame or (),
        is_sequence=views,
        motion=motion,
        data=data,
        data_dir=data_dir,
        overrides=overrides or (),
        rgb=rgb,
        ranges=range_image or (),
        instances=instances or (),
        labels=labels,
        encoding=range_options(bool(range_image), range_unit, range_missing, range_kind),
        camera=camera,
        fov_deg=fov,
    )
    saved_map = open_map(map, max_false_accept=max_false_accept)
    answer = saved_map.localize(views=query.read(), warn=warn)
    tell_choices(map)
    next_view = answer.next_view if answer.accepted is False else None
    if trajectory is not None:
        pose = answer.T_world_query
        write_text(trajectory, tum_lines([] if pose is None else [(0.0, pose)], [f"localize: {answer.summary}"]))
    if as_json:
        print_json({**answer_json(answer), "next_view": next_view_json(next_view)})
        return
    print_answer(answer)
    if next_view is not None:
        print(f"next view: {next_view}")


def tell_choices(map: Path) -> None:
    """Print which component the localizer of a map has in each slot whose component `auto` can select."""
    from salframe.cli.output import tell
    from salframe.framework.component import components_in
    from salframe.framework.components.defaults import auto_order
    from salframe.localization.map_files import map_config

    for slot, inner in components_in(map_config(map)):
        if auto_order(inner.component.role):
            tell(f"{slot} of the map: {inner.kind}")


def print_answer(answer: Localization) -> None:
    """Print the answer of a localizer: status, the five best places, the pose or only the heading, and notes.

    Each place is printed with its probability, or with its score if it has no probability. The printed probabilities,
    including those of the other places and of out-of-map, sum to 100 %.
    """
    from salframe.localization.answer_json import pose_json

    print(f"status: {answer.summary}")
    for place in answer.places[:5]:
        value = f"{place.score:10.4g}" if place.probability is None else f"{place.probability:10.1%}"
        print(f"{value}  {place.place}  (frame {place.frame})")
    if answer.out_of_map_probability is not None:
        if others := answer.places[5:]:
            print(f"{sum(place.probability or 0.0 for place in others):10.1%}  other places ({len(others)})")
        print(f"{answer.out_of_map_probability:10.1%}  out-of-map")
    if answer.T_world_query is not None:
        position = pose_json(answer.T_world_query)
        print(f"pose: x {position['x_m']:.2f} m, y {position['y_m']:.2f} m, yaw {position['yaw_deg']:.1f} deg")
    elif answer.heading_rad is not None:
        print(f"heading: {math.degrees(answer.heading_rad):.1f} deg")
    for note in answer.notes:
        print(f"note: {note}")
