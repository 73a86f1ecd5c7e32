"""The command `track`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json


def track(
    map: Annotated[Path, typer.Argument(help="Map folder written by `salframe build`")],
    folder: Annotated[Path, typer.Argument(metavar="SEQUENCE", help="Folder of panoramas with a sequence")],
    sequence: Annotated[str | None, typer.Option(help="Name of the sequence, if the folder has several")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Folder of trajectory, JSON and picture")
    ] = None,
    tracker: Annotated[str | None, typer.Option(help="Name of the tracker")] = None,
    views: Annotated[
        int | None, typer.Option(min=1, help="Number of the latest views that are localized together (default: 8)")
    ] = None,
    as_json: Json = False,
) -> None:
    """Track the camera of a sequence in a saved map.

    Prints the status, the place and the pose after each frame. In the manifest of the folder, each frame of the
    sequence has the keys `sequence` and `t_s`, and the key `odometry` is the name of the file with the motion. With
    --output, writes trajectory.tum (the poses with the status `tracking`), track.json (all steps) and trail.png.
    """
    from salframe.cli.output import Bars
    from salframe.drawing.trail_picture import draw_trail
    from salframe.localization.map import open_map
    from salframe.localization.tracking import NUM_VIEWS
    from salframe.localization.tracking import track as run

    opened = open_map(map)
    with Bars() as bars:
        tracked = run(
            opened,
            folder,
            sequence,
            tracker=tracker,
            num_views=views or NUM_VIEWS,
            progress=lambda done, total: bars.update("frames", done, total),
        )
    if output is not None:
        tracked.write(output)
        draw_trail(tracked, output / "trail.png", opened.floors)
    if as_json:
        print_json(tracked.to_json())
        return
    print(tracked)
    if output is not None:
        print(f"written to {output}: trajectory.tum, track.json, trail.png")
