"""The command `show-objects`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from salframe.cli.options import CameraFile, Fov, Json, RangeMissing, RangeUnit, number_parser, range_options
from salframe.cli.output import print_json, tell


def show_objects(
    images: Annotated[
        list[Path],
        typer.Argument(metavar="IMAGE", help="Equirectangular panoramas, or photographs with --fov or --camera"),
    ],
    detector: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Detector that finds the objects; see `salframe show detector` (default: auto, the first detector "
            "that can run)",
        ),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change a setting of the detector (detector.KEY), the saliency model (saliency.KEY) or the "
            "object graph (graph.KEY), such as detector.min_score=0.5",
        ),
    ] = None,
    range_image: Annotated[
        Path | None,
        typer.Option("--range", metavar="FILE", help="Range image (16-bit PNG) of IMAGE; only with a single IMAGE"),
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
    elevation: Annotated[
        float | None,
        typer.Option(
            parser=number_parser("--elevation", float, -90.0, 90.0),
            metavar="DEG",
            help="Upward tilt of the camera of photographs, in degrees; only with --fov (default: 0)",
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write the pictures to")
    ] = Path(),
    as_json: Json = False,
) -> None:
    """Draw the objects that a detector finds in images.

    Writes a picture for each image, such as hall.objects.png for hall.jpg. The picture shows the outlines, labels and
    scores of the objects, a top view of their graph, and a table of the objects. The exit status is 1 if an image
    cannot be read.
    """
    from salframe.cli.output import Bars, warn
    from salframe.drawing.show_objects import show_objects
    from salframe.panoramas.camera_file import read_camera

    calibration = None if camera is None else read_camera(camera)
    for warning in () if calibration is None else calibration.notes:
        warn(f"{camera}: {warning}")
    with Bars() as bars:
        result = show_objects(
            images,
            output,
            detector=detector,
            overrides=overrides or (),
            range_image=range_image,
            **range_options(range_image is not None, range_unit, range_missing, range_kind),
            fov_deg=fov,
            elevation_deg=elevation,
            camera=calibration,
            progress=bars.update if len(images) > 1 else None,
        )
    if as_json:
        print_json(result.to_json())
    else:
        for view in result.views:
            print(f"{view.picture}: {len(view.detections)} objects in {view.seconds:.2f} s")
    for note in result.notes:
        tell(note)
    for error in result.failures.values():
        tell(f"error: {error}")
    if result.failures:
        raise typer.Exit(1)
