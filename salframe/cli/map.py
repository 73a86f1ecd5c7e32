"""The commands `map build`, `add`, `remove`, `merge`, `calibrate`, `connect`, `show`, `route`, `query` and `export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from salframe.cli.build import build
from salframe.cli.options import (
    ENGINE,
    MAX_ANGLE_DEG,
    PLANNER,
    DataArgument,
    DataDir,
    EngineName,
    Json,
    SetForData,
    Workers,
    number_parser,
    with_workers,
)
from salframe.cli.output import print_json

if TYPE_CHECKING:
    from salframe.topology.map_changes import MapChange
    from salframe.topology.planner import Route

app = typer.Typer(help="Build, change, draw and query the map of a building.", no_args_is_help=True)
TopologyMap = Annotated[
    Path,
    typer.Argument(metavar="MAP", help="Map folder; the map must have a topology (see `salframe build --topology`)"),
]
AnyMap = Annotated[Path, typer.Argument(metavar="MAP", help="Map folder")]
PlannerName = Annotated[
    str, typer.Option("--planner", metavar="NAME", help="Planner that computes the route; see `salframe show planner`")
]
Heading = Annotated[
    float | None,
    typer.Option(
        parser=number_parser("--heading", float, -MAX_ANGLE_DEG, MAX_ANGLE_DEG),
        metavar="DEG",
        help="Direction you face at the start, in degrees counter-clockwise from the world x axis (default: unknown)",
    ),
]


app.command()(build)


@app.command()
def add(
    map: AnyMap,
    data: DataArgument,
    data_dir: DataDir = None,
    overrides: SetForData = None,
    engine: EngineName = ENGINE,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Add the places of a dataset to a map.

    Uses the method and the settings of the map. The dataset must have the same world frame as the map. A place of the
    dataset replaces a place of the map with the same name.
    """
    from salframe.cli.output import Bars, tell
    from salframe.topology.map_changes import add_to_map

    with Bars() as bars:
        change = add_to_map(
            map,
            data,
            data_dir=data_dir,
            overrides=with_workers(overrides, workers),
            engine=engine,
            progress=bars.update,
            tell=tell,
        )
    _print_change(map, change, as_json)


@app.command()
def remove(
    map: AnyMap,
    places: Annotated[
        list[str], typer.Argument(metavar="PLACE", help="Names of the places to remove, such as kitchen-01")
    ],
    as_json: Json = False,
) -> None:
    """Remove places (rooms or doorways) from a map.

    The places are also removed from the floor masks of the map (images of the floor).
    """
    from salframe.topology.map_changes import remove_from_map

    _print_change(map, remove_from_map(map, places), as_json)


@app.command()
def merge(
    map: AnyMap,
    others: Annotated[
        list[Path],
        typer.Argument(
            metavar="OTHER", help="Map folders to add; must have the same method, settings and world frame as MAP"
        ),
    ],
    as_json: Json = False,
) -> None:
    """Add the places of other maps to a map.

    The other maps do not change.
    """
    from salframe.topology.map_changes import merge_maps

    _print_change(map, merge_maps(map, others), as_json)


@app.command()
def calibrate(map: AnyMap, as_json: Json = False) -> None:
    """Calibrate the probabilities of answers in a map.

    The calibration uses the reference frames (panoramas of the map). `salframe build` also calibrates the map. Each
    change of a calibrated map calibrates it again.
    """
    from salframe.cli.calibration import describe_calibration
    from salframe.topology.map_changes import calibrate_map

    calibration = calibrate_map(map)
    if as_json:
        print_json(calibration.model_dump(mode="json"))
    else:
        print(f"{map}: {describe_calibration(calibration)}")


@app.command()
def connect(
    map: TopologyMap,
    start: Annotated[
        str | None, typer.Argument(metavar="FROM", help="Place or node of the map at one end of the connection")
    ] = None,
    end: Annotated[
        str | None, typer.Argument(metavar="TO", help="Place or node of the map at the other end, on another floor")
    ] = None,
    kind: Annotated[str, typer.Option(metavar="KIND", help="Kind of the connection: stairs or lift")] = "stairs",
    length: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Length of the connection in metres. It is added to the length of routes over the connection",
        ),
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="CSV file of connections, instead of FROM and TO: one per row, with the columns start, end (places or "
            "nodes), kind (stairs or lift) and length_m",
        ),
    ] = None,
) -> None:
    """Connect floors of a map by stairs or a lift.

    Routes can then lead from one floor to another. Set FROM, TO and --length for one connection, or --file for
    several connections.
    """
    from salframe.framework.errors import ConfigError
    from salframe.framework.validation import validate
    from salframe.panoramas.floors import Connection
    from salframe.topology.connections import read_connections
    from salframe.topology.store import connect_map

    if file is not None and start is None:
        connections = read_connections(file)
    elif file is None and start is not None and end is not None and length is not None:
        values = {"start": start, "end": end, "kind": kind, "length_m": length}
        connections = [validate(Connection, values, "map connect:")]
    else:
        received = "both FROM and --file" if file is not None else "only a part of FROM, TO and --length"
        raise ConfigError(f"received {received}, expected either FROM, TO and --length, or --file FILE.csv")
    topology = connect_map(map, connections)
    print(f"{map}: {len(topology.connections)} connections between {len(topology.floors)} floors")
    for note in topology.notes:
        print(f"  {note}")


@app.command()
def show(
    map: TopologyMap,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE.png", help="PNG file to write the picture to (default: MAP/map.png)"
        ),
    ] = None,
) -> None:
    """Draw a map and print its calibration.

    The picture shows the floor, rooms, nodes and edges. Nodes are positions in rooms and doorways. Edges connect
    nodes, and are labelled with lengths and azimuths.
    """
    from salframe.cli.calibration import describe_calibration
    from salframe.drawing.floor_picture import draw_topology
    from salframe.localization.map_files import map_calibration
    from salframe.topology.store import open_topology

    output = output or map / "map.png"
    draw_topology(open_topology(map), output)
    print(output)
    print(describe_calibration(*map_calibration(map)))


@app.command()
def route(
    map: TopologyMap,
    start: Annotated[
        str,
        typer.Argument(
            metavar="FROM", help="Start of the route: a place, a topology node, or the text on a sign in the building"
        ),
    ],
    goal: Annotated[
        str,
        typer.Argument(
            metavar="TO", help="Goal of the route: a place, a topology node, or the text on a sign in the building"
        ),
    ],
    planner: PlannerName = PLANNER,
    heading: Heading = None,
    as_json: Json = False,
) -> None:
    """Print the shortest route between nodes, places or signs.

    Nodes are positions in rooms and doorways. Places are rooms and doorways. Signs are texts on walls. Each step of
    the route has its length, azimuth and turn.
    """
    import numpy as np

    from salframe.topology.routes import find_route, route_json
    from salframe.topology.store import open_topology

    plan = find_route(open_topology(map), start, goal, planner)
    heading_rad = None if heading is None else float(np.radians(heading))
    if as_json:
        print_json(route_json(plan, heading_rad))
    else:
        _print_route(plan, heading_rad)


@app.command()
def query(
    map: AnyMap,
    frame: Annotated[
        str,
        typer.Argument(metavar="FRAME", help="Query: panorama file of a dataset folder, or id of a panorama in --data"),
    ],
    data: Annotated[
        str | None, typer.Option(metavar="DATASET", help="Dataset that contains the panorama whose id is FRAME")
    ] = None,
    goal: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="GOAL",
            help="Also find the route from the query to this goal: a place, a topology node, or the text on a sign",
        ),
    ] = None,
    planner: PlannerName = PLANNER,
    data_dir: DataDir = None,
    overrides: SetForData = None,
    as_json: Json = False,
) -> None:
    """Localize a panorama in a map and print the nearest node.

    Nodes are positions in rooms and doorways, for routes. With --to, also prints the route from the nearest node to
    GOAL. The first turn of the route is relative to the estimated heading. If there is no route, the command prints the
    reason, and the exit status is 1.
    """
    import numpy as np

    from salframe.cli.localize import print_answer, tell_choices
    from salframe.cli.output import Bars, warn
    from salframe.localization.answer_json import answer_json, next_view_json
    from salframe.panoramas.opening import open_frame
    from salframe.topology.building_map import ask_map
    from salframe.topology.routes import route_json

    with Bars() as bars:
        query_frame = open_frame(frame, data, data_dir, overrides or (), bars.update)
    answer = ask_map(map, query_frame, goal, planner, warn=warn)
    tell_choices(map)
    next_view = answer.localization.next_view if answer.localization.accepted is False else None
    if as_json:
        heading_deg = None if answer.heading_rad is None else float(np.degrees(answer.heading_rad))
        node = {"node": answer.node, "distance_m": answer.distance_m, "heading_deg": heading_deg}
        route = None if answer.route is None else route_json(answer.route, answer.heading_rad)
        plan = {"route": route, "no_route": answer.no_route, "next_view": next_view_json(next_view)}
        print_json({**answer_json(answer.localization), **node, **plan})
    else:
        print_answer(answer.localization)
        distance = "" if answer.distance_m is None else f", {answer.distance_m:.2f} m away"
        print(f"nearest node: {answer.node or 'unknown'}{distance}")
        if next_view is not None:
            print(f"next view: {next_view}")
        if answer.route is not None:
            _print_route(answer.route, answer.heading_rad)
        elif answer.no_route is not None:
            print(answer.no_route)
    if answer.no_route is not None:
        raise typer.Exit(1)


@app.command()
def export(
    map: AnyMap,
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="File to write: .json, .geojson, .yaml, .svg, .graphml or .parquet")
    ],
    anchor: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON,BEARING",
            help="Only for .geojson: latitude and longitude of the map origin, and compass bearing of its y axis "
            "(degrees)",
        ),
    ] = None,
) -> None:
    """Export a map for other programs.

    The suffix of FILE selects the format: places with their objects (json), a geographic map (geojson), free floor for
    map_server of ROS (yaml and pgm), a floor plan (svg), the topology (graphml), or the descriptions of the reference
    frames (parquet). Each file states its axes and units. Without --anchor, the coordinates of GeoJSON are metres.
    """
    from salframe.topology.export import export_map
    from salframe.topology.geojson import GeoAnchor

    for written in export_map(map, file, None if anchor is None else GeoAnchor.parse(anchor)):
        print(written)


def _print_change(map: Path, change: MapChange, as_json: bool) -> None:
    from dataclasses import asdict

    if as_json:
        print_json(asdict(change))
        return
    changes = {"added": change.added, "replaced": change.replaced, "removed": change.removed}
    for action, places in changes.items():
        if places:
            print(f"{action}: {', '.join(places)}")
    print(f"{map}: {change.places} places, {change.frames} frames")
    for note in change.notes:
        print(f"  {note}")


def _print_route(route: Route, heading_rad: float | None) -> None:
    from salframe.topology.routes import directions

    print(f"from {route.nodes[0]} to {route.nodes[-1]}: {route.length_m:.2f} m")
    for number, step in enumerate(directions(route, heading_rad), 1):
        print(f"{number:4d}. {step}")
