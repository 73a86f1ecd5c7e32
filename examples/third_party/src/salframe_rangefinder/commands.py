"""Commands of this package. Heavy imports are inside the commands, so that they do not slow down `salframe --help`."""

from typing import Annotated

import typer

import salframe


def bands(
    frame: Annotated[str, typer.Argument(help="Id of a frame of the dataset.")],
    data: Annotated[str, typer.Option(help="Dataset: a name in `salframe data list`, or a folder.")] = "box-rooms-8",
) -> None:
    """Print the objects that `height-bands` finds in a frame: label, distance, azimuth."""
    import numpy as np

    from salframe.panoramas.opening import open_frame
    from salframe_rangefinder.detector import HeightBands

    detections = HeightBands().detect(open_frame(frame, data).load())
    for label, (x_m, y_m, _) in zip(detections.labels, detections.centroid_m, strict=True):
        print(f"{label}: {np.hypot(x_m, y_m):.2f} m, {np.degrees(np.arctan2(y_m, x_m)):.0f} deg")


@salframe.hookimpl
def salframe_commands():
    return {"bands": bands}
