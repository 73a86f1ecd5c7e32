"""detection: what do detectors find of what is there?"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer

from salframe.cli.compare import DataDir, Json, Set, split_names

if TYPE_CHECKING:
    from salframe.evaluation.detection import Counts, DetectorResult


def detection(
    detectors: Annotated[str, typer.Option(help="Detectors, comma-separated.")] = "panoseg",
    data: Annotated[
        str, typer.Option(help="A dataset preset, a dataset, or a folder with a manifest.json; with annotations.")
    ] = "house-12",
    data_dir: DataDir = None,
    overrides: Set = None,
    classes: Annotated[bool, typer.Option("--classes", help="Print a table of the classes too.")] = False,
    as_json: Json = False,
) -> None:
    """Detect objects in the query panoramas, and print precision and recall against their annotations."""
    from salframe.cli.tables import Bars
    from salframe.evaluation.detection import measure_detection

    with Bars() as bars:
        results = measure_detection(
            split_names(detectors), data, data_dir=data_dir, overrides=overrides or (), progress=bars.update
        )
    if as_json:
        print(json.dumps([result.to_json() for result in results], indent=2))
    else:
        print_detection(results, classes)
    if all(result.overall is None for result in results):
        raise typer.Exit(1)


def print_detection(results: list[DetectorResult], classes: bool) -> None:
    """A table of the detectors, one of the classes of each where wanted, and the reasons of those that could not run."""
    from salframe.cli.tables import print_table
    from salframe.evaluation.detection import NEAR_M

    measured = [(result, result.overall) for result in results if result.overall is not None]
    headings = ("precision %", "recall %", "annotated", "found", "right")
    if measured:
        print_table(
            ("detector", *headings, "ms"),
            [[result.detector, *_cells(overall), f"{result.ms:.0f}"] for result, overall in measured],
        )
    for result, _ in measured if classes else ():
        print_table(
            (result.detector, *headings), [[label, *_cells(counts)] for label, counts in result.classes.items()]
        )
    for result in results:
        if result.reason:
            print(f"{result.detector}: {result.reason}")
    print(f"right: an annotated object of the same label has its centroid within {NEAR_M} m")


def _cells(counts: Counts) -> list[str]:
    shares = ("-" if share is None else f"{share * 100:.1f}" for share in (counts.precision, counts.recall))
    return [*shares, str(counts.annotated), str(counts.found), str(counts.right)]
