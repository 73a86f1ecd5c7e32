"""detection: what do detectors find of what is there?"""

from __future__ import annotations

from typing import Annotated

import typer

from salframe.cli.options import DETECTORS, CommonOptions, with_common_options
from salframe.cli.output import show


@with_common_options(without=["seed"])
def detection(
    detectors: Annotated[str, typer.Option(help="Detectors, comma-separated.")] = DETECTORS,
    classes: Annotated[bool, typer.Option("--classes", help="Print a table of the classes too.")] = False,
    *,
    options: CommonOptions,
) -> None:
    """Detect objects in the query panoramas, and print precision and recall against their annotations. Run it again to
    resume.
    """
    from salframe.evaluation.tasks.detection.task import measure_detection

    request = options.request(detectors)
    show(
        lambda progress: measure_detection(request, progress=progress), options.as_json, options.style, details=classes
    )
