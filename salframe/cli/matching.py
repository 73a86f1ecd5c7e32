"""matching: are the points or objects that a method matches the same ones?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from salframe.cli.compare import DataDir, EngineName, Json, Name, Runs, Set, show, split_names

if TYPE_CHECKING:
    from salframe.evaluation.matching import Matching


def matching(
    methods: Annotated[str, typer.Option(help="Methods, comma-separated: presets or localizers.")] = "proposed,sift",
    data: Annotated[
        str, typer.Option(help="A dataset preset, a dataset, or a folder with a manifest.json.")
    ] = "house-12",
    data_dir: DataDir = None,
    overrides: Set = None,
    name: Name = None,
    runs: Runs = Path("runs"),
    engine: EngineName = "processes",
    as_json: Json = False,
) -> None:
    """Match each query with the nearest map frame of its own place, and print how much of it is right. Run it again to
    resume."""
    from salframe.evaluation.matching import measure_matching

    show(
        lambda progress: measure_matching(
            split_names(methods),
            data,
            data_dir=data_dir,
            overrides=overrides or (),
            name=name,
            runs=runs,
            engine=engine,
            progress=progress,
        ),
        print_matching,
        as_json,
    )


def print_matching(matching: Matching) -> None:
    """A table of the methods that match points, another of those that match nodes, and what the tables do not say in
    notes below."""
    from salframe.cli.tables import print_table

    points, nodes = ([row for row in matching.rows if row["kind"] == kind] for kind in ("points", "nodes"))
    if points:
        headings = ("points", "MMA@1 %", "MMA@3 %", "MMA@5 %", "matches\na pair", "pairs without\na match")
        print_table(
            headings,
            [
                [
                    row["method"],
                    *(f"{row[column] * 100:.1f}" for column in ("mma_1", "mma_3", "mma_5")),
                    f"{row['matches_per_pair']:.0f}",
                    f"{row['pairs_without_match']} of {row['pairs']}",
                ]
                for row in points
            ],
        )
    if nodes:
        headings = ("nodes", "precision %", "recall %", "matches\na pair", "true\na pair", "pairs")
        print_table(
            headings,
            [
                [
                    row["method"],
                    f"{row['precision'] * 100:.1f}",
                    "-" if row["recall"] is None else f"{row['recall'] * 100:.1f}",
                    f"{row['matches_per_pair']:.1f}",
                    f"{row['true_per_pair']:.1f}",
                    str(row["pairs"]),
                ]
                for row in nodes
            ],
        )
    notes = [*matching.notes, *(f"{row['method']}: {row['reason']}" for row in matching.rows if row["reason"])]
    if matching.left_out:
        notes.append(f"{matching.left_out} queries left out: their place has no scene frame in the map")
    for note in notes:
        print(note)
    print(f"run: {matching.run}")
