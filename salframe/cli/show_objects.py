"""show-objects: what does a detector find in my pictures?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.options import Json
from salframe.cli.output import print_json, tell


def show_objects(
    images: Annotated[
        list[Path],
        typer.Argument(
            metavar="IMAGE", help="Panoramas, twice as wide as high, or with --fov photographs; JPEG or PNG."
        ),
    ],
    detector: Annotated[str | None, typer.Option(help="A detector of `salframe plugins`; auto unless named.")] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY.PATH=VALUE", help="Change a setting: detector.KEY, saliency.KEY or graph.KEY."
        ),
    ] = None,
    range_image: Annotated[
        Path | None,
        typer.Option(
            "--range",
            metavar="FILE",
            help="Range of the one IMAGE, a 16-bit PNG in millimetres: along the ray, of a photograph the z-depth. "
            "An image that a manifest.json names has that of its frame.",
        ),
    ] = None,
    fov: Annotated[
        float | None, typer.Option(metavar="DEG", help="The images are photographs of this horizontal field of view.")
    ] = None,
    pitch: Annotated[
        float | None, typer.Option(metavar="DEG", help="Pitch of the photographs, positive upwards (default: 0).")
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where the pictures go.")] = Path(),
    as_json: Json = False,
) -> None:
    """Draw the objects that a detector finds in images: NAME.objects.png has outlines, labels and scores, the saliency
    graph from above, or without range the bearings, and a table. Exit 1 where an image could not be shown."""
    from salframe.cli.output import Bars
    from salframe.drawing.show_objects import show_objects

    with Bars() as bars:
        shown = show_objects(
            images,
            output,
            detector=detector,
            overrides=overrides or (),
            range_image=range_image,
            fov_deg=fov,
            pitch_deg=pitch,
            progress=bars.update if len(images) > 1 else None,
        )
    if as_json:
        print_json(shown.to_json())
    else:
        for view in shown.views:
            print(f"{view.picture}: {len(view.detections)} objects in {view.seconds:.2f} s")
    for note in shown.notes:
        tell(note)
    for error in shown.failures.values():
        tell(f"error: {error}")
    if shown.failures:
        raise typer.Exit(1)
