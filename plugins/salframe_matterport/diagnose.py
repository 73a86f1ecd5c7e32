"""Why queries of a finished run went wrong: `python -m salframe_matterport.diagnose RUN METHOD`."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np

from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.framework.errors import DataError, SalframeError
from salframe_matterport.bearings import direction
from salframe_matterport.dataset import MatterportAnnotations
from salframe_matterport.scenes import ViewpointScene

MISPLACED_M = 0.3
"""Objects that two viewpoints share and place farther apart than this cannot confirm each other."""

CAUSES = ("no shared object", "one shared object", "bad bearing or range", "twin room", "other")


def diagnose(run: Run, method: str) -> dict[str, list[str]]:
    """The ids of the wrong queries of a method by cause, in the order of CAUSES.

    Raises DataError where the run is of another dataset or lacks answers.
    """
    config = run.data()
    if not isinstance(config, MatterportAnnotations.Config):
        raise DataError(f"{run.directory} asked {config.kind}, expected {MatterportAnnotations.name}")
    dataset = MatterportAnnotations(config)
    answers = {(row.fold, row.query): row.places for row in run.rows(method, AnswerRow)}
    scenes = dataset.scenes()
    wrong: dict[str, list[str]] = {cause: [] for cause in CAUSES}
    for fold in dataset.folds():
        for query in fold.queries:
            if (fold.id, query.id) not in answers:
                raise DataError(f"{run.directory} has no answer of {method!r} to {query.id}: finish the run first")
            places = answers[fold.id, query.id]
            truth = dataset.truth(query.id)
            own = [scenes[frame.id] for frame in fold.references if frame.place == truth.place]
            if not own or (places and places[0].place == truth.place):  # not in the map, or right
                continue
            winning = [scenes[frame.id] for frame in fold.references if places and frame.place == places[0].place]
            wrong[cause_of(scenes[query.id.removesuffix("/query")], own, winning)].append(query.id)
    return wrong


def cause_of(query: ViewpointScene, own: list[ViewpointScene], winning: list[ViewpointScene]) -> str:
    """The first of CAUSES that holds for a query, given the other viewpoints of its own region and those of the winning
    one.

    Shared are objects, by id, with the viewpoint of its own region that has most of them. "bad bearing or range": the
    two viewpoints put fewer than two of these within MISPLACED_M of each other. "twin room": the winning region has as
    many labels of the query as its own.
    """
    shared = [np.intersect1d(query.object_id, scene.object_id, return_indices=True)[1:] for scene in own]
    most, (in_query, in_own) = max(zip(own, shared, strict=True), key=lambda pair: len(pair[1][0]))
    if len(in_query) == 0:
        return "no shared object"
    if len(in_query) == 1:
        return "one shared object"
    apart_m = np.linalg.norm(_positions(query)[in_query] - _positions(most)[in_own], axis=1)
    if (apart_m <= MISPLACED_M).sum() < 2:
        return "bad bearing or range"
    if _shared_labels(query, winning) >= _shared_labels(query, own):
        return "twin room"
    return "other"


def _positions(scene: ViewpointScene) -> np.ndarray:
    """(N, 3) metres in the world, where the scene's own bearings and ranges put its objects."""
    return scene.T_world_pano[:3, 3] + scene.range_m[:, None] * direction(scene.azimuth_rad, scene.elevation_rad)


def _shared_labels(query: ViewpointScene, others: list[ViewpointScene]) -> int:
    """Labels, counted as often as both have them, shared with the best of these viewpoints."""
    return max(((Counter(query.labels) & Counter(other.labels)).total() for other in others), default=0)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="salframe_matterport.diagnose", description="Why queries of a finished run went wrong."
    )
    parser.add_argument("run", type=Path, help="run folder of a comparison on matterport-annotations")
    parser.add_argument("method", help="method of that run")
    parser.add_argument("--queries", action="store_true", help="list the queries of each cause")
    options = parser.parse_args(arguments)
    try:
        wrong = diagnose(Run.load(options.run), options.method)
    except SalframeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    for cause, queries in wrong.items():
        print(f"{len(queries):5d}  {cause}")
        if options.queries:
            print("".join(f"         {query}\n" for query in queries), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
