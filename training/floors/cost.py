"""Time and memory to derive floors from panoramas: `python -m training.floors.cost house-106 --repeats 4`.

The panoramas are rendered before the measurement, which takes memory. Run the command twice.
"""

from __future__ import annotations

import resource
import time
from dataclasses import replace
from typing import Annotated

import typer

from salframe.localization.preparing import prepare
from salframe.panoramas.opening import reference_frames
from salframe.topology.build import build_topology
from salframe.topology.building_map import by_place
from salframe.topology.derived_floors import derive_floors


def main(
    data: Annotated[str, typer.Argument(help="Preset of the dataset house")],
    repeats: Annotated[int, typer.Option(help="Number of times that each panorama is used")] = 4,
    seed: Annotated[int, typer.Option(help="Seed of the building")] = 200,
) -> None:
    """Measure the time and memory of derived floors and their topology."""
    settings = ["data.rgb=false", f"data.seed={seed}"]
    _, dataset, _ = prepare(data, "proposed", None, settings, None, None, print)
    frames = [
        replace(frame, id=f"{frame.id}-{number}") for number in range(repeats) for frame in reference_frames(dataset)
    ]
    before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    start_s = time.perf_counter()
    plan = derive_floors(frames)
    floors_s = time.perf_counter() - start_s
    topology = build_topology(plan.floors, by_place(frames))
    total_s = time.perf_counter() - start_s
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    rows, columns = plan.floors[0].free.shape
    print(
        f"{data}: {len(frames)} panoramas, {columns} x {rows} cells: derived floors in {floors_s:.1f} s, topology "
        f"of {len(topology.nodes)} nodes in {total_s - floors_s:.1f} s; peak memory {before_mb:.0f} MB before both "
        f"steps and {peak_mb:.0f} MB after them"
    )


if __name__ == "__main__":
    typer.run(main)
