"""The command `track`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json


def track(
    map: Annotated[Path, typer.Argument(metavar="MAP", help="Map folder that `salframe build` wrote")],
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING", help="Dataset folder with an image sequence, or a recording such as a ROS bag"
        ),
    ],
    sequence: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of the sequence to track, if RECORDING has several")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="DIR", help="Folder to write trajectory.tum, track.json and trail.png to"
        ),
    ] = None,
    tracker: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Tracker, which combines localization and odometry; see `salframe show tracker` (default: votes)",
        ),
    ] = None,
    views: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Number of latest images to localize together, as one query (default: 5)"
        ),
    ] = None,
    format: Annotated[
        str | None,
        typer.Option(
            metavar="FORMAT",
            help="Format of a RECORDING without manifest.json; see `salframe show importer` (default: rosbag)",
        ),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change a setting of the importer that reads the recording, such as poses=tf; see `salframe "
            "show FORMAT`",
        ),
    ] = None,
    rerun: Annotated[
        Path | None, typer.Option(metavar="FILE.rrd", help="Also write the result for the viewer Rerun (rerun.io)")
    ] = None,
    as_json: Json = False,
) -> None:
    """Track the camera of a recording in a saved map.

    Prints the status, the place and the pose for each image. With --output, writes trajectory.tum (the poses with the
    status `tracking`), track.json (the results for all images) and trail.png (the positions on the floor plan).

    A dataset folder needs a manifest.json. In this file, each frame of the sequence has the keys `sequence` and `t_s`.
    The key `odometry` of the manifest names the file with the odometry.
    """
    from salframe.cli.output import Bars, warn
    from salframe.drawing.rerun_recording import check_rerun_output, write_rerun
    from salframe.drawing.trail_picture import draw_trail
    from salframe.localization.map import open_map
    from salframe.localization.tracking import NUM_VIEWS
    from salframe.localization.tracking import track as run
    from salframe.panoramas.camera_sequence import read_sequence

    if rerun is not None:
        check_rerun_output(rerun)
    opened = open_map(map)
    moving = read_sequence(recording, sequence, format=format, settings=overrides or ())
    for note in moving.notes:
        warn(note)
    with Bars() as bars:
        tracked = run(
            opened,
            moving,
            tracker=tracker,
            num_views=views or NUM_VIEWS,
            progress=lambda done, total: bars.update("frames", done, total),
        )
    if output is not None:
        tracked.write(output)
        draw_trail(tracked, output / "trail.png", opened.floors)
    if rerun is not None:
        write_rerun(tracked, moving, opened, rerun)
    if as_json:
        print_json(tracked.to_json())
        return
    print(tracked)
    if output is not None:
        print(f"written to {output}: trajectory.tum, track.json, trail.png")
    if rerun is not None:
        print(f"written to {rerun}")
