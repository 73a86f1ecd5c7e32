"""Commands of this package; what is heavy is imported when a command runs."""

from typing import Annotated

import typer

import salframe


def bands(
    frame: Annotated[str, typer.Argument(help="A frame of the dataset.")],
    data: Annotated[str, typer.Option(help="A dataset preset, a dataset, or a folder.")] = "box-rooms-8",
) -> None:
    """Print the objects that `height-bands` finds in a frame: label, distance, azimuth."""
    import numpy as np

    from salframe.panoramas.opening import open_frame
    from salframe_rangefinder.detector import HeightBands

    found = HeightBands().detect(open_frame(frame, data).load())
    for label, (x_m, y_m, _) in zip(found.labels, found.centroid_m, strict=True):
        print(f"{label}: {np.hypot(x_m, y_m):.2f} m, {np.degrees(np.arctan2(y_m, x_m)):.0f} deg")


@salframe.hookimpl
def salframe_commands():
    return {"bands": bands}
