"""navigate: methods in closed loop, in a building."""

from __future__ import annotations

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from salframe.cli.compare import DataDir, EngineName, Json, Name, Runs


class Positioning(StrEnum):
    """Which arms to run."""

    on = "on"
    off = "off"
    both = "both"


def navigate(
    methods: Annotated[
        str, typer.Option(help="Localizers, comma-separated: presets or localizers.")
    ] = "proposed,objects",
    data: Annotated[str, typer.Option(help="A dataset that can render, or matterport-annotations.")] = "house-12",
    episodes: Annotated[
        str, typer.Option(metavar="N|FILE", help="How many episodes to draw, or a JSON file of them.")
    ] = "100",
    positioning: Annotated[
        Positioning,
        typer.Option(
            help="off: place alone, heading by odometry; both: each method once with and once without its poses."
        ),
    ] = Positioning.on,
    data_dir: DataDir = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY.PATH=VALUE",
            help="Change a setting: navigation.KEY, data.KEY, engine.KEY, METHOD.KEY of one method, or KEY of every method that has it.",
        ),
    ] = None,
    name: Name = None,
    runs: Runs = Path("runs"),
    engine: EngineName = "processes",
    seed: Annotated[int, typer.Option(help="Seed of episodes, noise and confidence intervals.")] = 0,
    as_json: Json = False,
) -> None:
    """Send an agent from room to room with each method as its localizer. Run it again to resume."""
    from salframe.cli.tables import Bars, print_table
    from salframe.evaluation.navigation import navigate as run

    wanted = [method.strip() for method in methods.split(",") if method.strip()]
    asked = int(episodes) if episodes.lstrip("-").isdigit() else Path(episodes)
    try:
        with Bars() as bars:
            navigation = run(
                wanted,
                data,
                episodes=asked,
                positioning=positioning.value,
                data_dir=data_dir,
                overrides=overrides or (),
                name=name,
                runs=runs,
                engine=engine,
                seed=seed,
                progress=bars.update,
            )
    except KeyboardInterrupt:
        print("interrupted: run the same command again to resume", file=sys.stderr)
        raise typer.Exit(130) from None
    if as_json:
        print(json.dumps(navigation.to_json(), indent=2))
    else:
        print_table(HEADINGS, [_cells(row) for row in navigation.rows])
        notes = [f"{row['method']}: {row['reason']}" for row in navigation.rows if row["reason"]]
        print("\n".join([*notes, *navigation.notes, f"report: {navigation.report}"]))
    if navigation.crashed or not navigation.measured:
        raise typer.Exit(1)


HEADINGS = (
    "method",
    "SR %\n(95 %)",
    "oracle\nSR %",
    "SPL %\n(95 %)",
    "SR within\n3 m %",
    "path\nm",
    "panoramas",
    "collisions",
    "p",
)


def _cells(row: dict) -> list[str]:
    if row["success_rate"] is None:
        return [row["method"], *["-"] * (len(HEADINGS) - 1)]
    rate, spl = (
        f"{row[key] * 100:.1f} ({row[f'{key}_low'] * 100:.0f}-{row[f'{key}_high'] * 100:.0f})"
        for key in ("success_rate", "spl")
    )
    means = ["-" if row[key] is None else f"{row[key]:.1f}" for key in ("path_m", "panoramas", "collisions")]
    p_value = "" if row["p_value"] is None else f"{row['p_value']:.2g}"
    return [
        row["method"],
        rate,
        f"{row['oracle_success_rate'] * 100:.1f}",
        spl,
        f"{row['success_rate_3m'] * 100:.1f}",
        *means,
        p_value,
    ]
