"""The commands `build` and `map build`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from salframe.cli.options import ENGINE, MAP_METHOD, DataDir, EngineName, SetForMethod, Workers, with_workers

if TYPE_CHECKING:
    from salframe.topology.topological_map import TopologicalMap


def build(
    data: Annotated[
        str,
        typer.Argument(
            metavar="DATA",
            help="Dataset: a name in `salframe data list`, a YAML file of settings, or a folder with manifest.json",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="MAP", help="Folder to write the map to")],
    method: Annotated[
        str, typer.Option(metavar="METHOD", help="Localization method that uses the map; see `salframe methods`")
    ] = MAP_METHOD,
    topology: Annotated[
        bool,
        typer.Option(
            "--topology/--no-topology",
            help="Include a topology (graph for routes); needs images of the free floor (floor masks) or range images",
        ),
    ] = True,
    central_nodes: Annotated[
        bool,
        typer.Option(
            "--central-nodes",
            help="Put one topology node into the widest part of each room (default: one node at each panorama)",
        ),
    ] = False,
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate/--no-calibrate", help="Use the panoramas of the map to calibrate the probabilities of answers"
        ),
    ] = True,
    floor_map: Annotated[
        Path | None,
        typer.Option(
            metavar="MAP.yaml",
            help="Occupancy map of ROS map_server, for a dataset without floor masks (images of the free floor)",
        ),
    ] = None,
    data_dir: DataDir = None,
    overrides: SetForMethod = None,
    engine: EngineName = ENGINE,
    workers: Workers = None,
) -> None:
    """Build a map from the reference frames of a dataset.

    `salframe build` and `salframe map build` are the same command. Reference frames are panoramas with known poses.
    The map includes a topology (nodes and edges for routes) if the dataset has floor masks (images of the free floor
    from above) or range images.
    """
    from salframe.cli.calibration import describe_calibration
    from salframe.cli.output import Bars, tell
    from salframe.evaluation.tables.text import format_bytes
    from salframe.framework.components.installation import folder_bytes
    from salframe.topology.building_map import build_map

    with Bars() as bars:
        result = build_map(
            data,
            output,
            method,
            topology=topology,
            central_nodes=central_nodes,
            calibrate=calibrate,
            floor_map=floor_map,
            data_dir=data_dir,
            overrides=with_workers(overrides, workers),
            engine=engine,
            progress=bars.update,
            tell=tell,
        )
    print(f"{output}: {format_bytes(folder_bytes(output))}, {_describe(result.topology)}")
    if result.localization is not None and result.localization.calibration is not None:
        print(f"  {describe_calibration(result.localization.calibration)}")
    for note in () if result.topology is None else result.topology.notes:
        print(f"  {note}")


def _describe(topology: TopologicalMap | None) -> str:
    """Return the number of nodes and edges of a topology, in words."""
    from salframe.topology.topological_map import NodeKind

    if topology is None:
        return "no topology"
    scenes = sum(node.kind is NodeKind.SCENE for node in topology.nodes)
    return f"{scenes} scene nodes, {len(topology.nodes) - scenes} transition nodes, {len(topology.edges)} edges"
