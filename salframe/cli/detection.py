"""The command `detection`."""

from __future__ import annotations

from typing import Annotated

import typer

from salframe.cli.options import DETECTORS, CommonOptions, SetForDetectors, timeout_option, with_common_options
from salframe.cli.output import show


@with_common_options(without=["seed"], timeout=(timeout_option("panorama"), None), overrides=(SetForDetectors, None))
def detection(
    detectors: Annotated[
        str, typer.Option(metavar="NAMES", help="Detectors to measure, comma-separated; see `salframe show detector`")
    ] = DETECTORS,
    classes: Annotated[
        bool, typer.Option("--classes", help="Also print the results for each object class, such as chair")
    ] = False,
    *,
    options: CommonOptions,
) -> None:
    """Measure the precision and recall of object detectors.

    Runs the detectors on the query panoramas and compares the detections with the annotations. Run the same command
    again to resume an interrupted run.
    """
    from salframe.evaluation.tasks.detection.task import DetectionTask, measure_detection

    request = options.request(detectors)
    show(
        lambda progress: measure_detection(request, progress=progress), options.printing, DetectionTask, details=classes
    )
