"""Diagnose the wrong answers of a finished run: `python -m salframe_matterport.diagnose RUN METHOD`."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np

from salframe.evaluation.runs.run_folder import Run
from salframe.evaluation.tasks.localization.rows import AnswerRow
from salframe.framework.errors import DataError, SalframeError
from salframe.graphs.vocabulary import object_label
from salframe_matterport.bearings import direction
from salframe_matterport.dataset import MatterportAnnotations
from salframe_matterport.scenes import ViewpointScene

MISPLACED_M = 0.3
"""Maximum distance in metres between the positions of an object from two viewpoints. Within it, the positions agree."""

CAUSES = ("no shared object", "one shared object", "bad bearing or range", "twin room", "other")


def diagnose(run: Run, method: str) -> dict[str, list[str]]:
    """Return the ids of the queries that a method answered wrongly, by cause, in the order of CAUSES.

    Raises:
        DataError: The run is on another dataset, or it lacks answers.
    """
    config = run.data()
    if not isinstance(config, MatterportAnnotations.Config):
        raise DataError(
            f"the run in {run.directory} used the dataset {config.kind}, expected {MatterportAnnotations.name}"
        )
    dataset = MatterportAnnotations(config)
    answers = {(row.fold, row.query): row.places for row in run.rows(method, AnswerRow)}
    scenes = dataset.scenes()
    wrong: dict[str, list[str]] = {cause: [] for cause in CAUSES}
    for fold in dataset.folds():
        for query in fold.queries:
            if (fold.id, query.id) not in answers:
                raise DataError(
                    f"{run.directory} has no answer of the method {method!r} to the query {query.id}, expected a "
                    "complete run: resume the run"
                )
            places = answers[fold.id, query.id]
            truth = dataset.truth(query.id)
            region_scenes = [scenes[frame.id] for frame in fold.references if frame.place == truth.place]
            # Skip out-of-map queries and correct answers.
            if not region_scenes or (places and places[0].place == truth.place):
                continue
            answer_scenes = [scenes[frame.id] for frame in fold.references if places and frame.place == places[0].place]
            wrong[cause_of(scenes[query.id.removesuffix("/query")], region_scenes, answer_scenes)].append(query.id)
    return wrong


def cause_of(query: ViewpointScene, region_scenes: list[ViewpointScene], answer_scenes: list[ViewpointScene]) -> str:
    """Return the cause of a wrong answer: the first of CAUSES that applies to the query.

    The query is compared with one viewpoint of its region: the viewpoint that shares the most objects (by id).

    - "bad bearing or range": at most one shared object has the same position from both viewpoints, within MISPLACED_M.
    - "twin room": the region of the answer shares at least as many labels with the query as the region of the query.

    Args:
        query: Scene of the query.
        region_scenes: The other viewpoints of the query's region.
        answer_scenes: The viewpoints of the region that the method returned.
    """
    shared = [np.intersect1d(query.object_id, scene.object_id, return_indices=True)[1:] for scene in region_scenes]
    best_scene, (in_query, in_scene) = max(zip(region_scenes, shared, strict=True), key=lambda pair: len(pair[1][0]))
    if len(in_query) == 0:
        return "no shared object"
    if len(in_query) == 1:
        return "one shared object"
    apart_m = np.linalg.norm(_positions(query)[in_query] - _positions(best_scene)[in_scene], axis=1)
    if (apart_m <= MISPLACED_M).sum() < 2:
        return "bad bearing or range"
    if _shared_labels(query, answer_scenes) >= _shared_labels(query, region_scenes):
        return "twin room"
    return "other"


def _positions(scene: ViewpointScene) -> np.ndarray:
    """Return the objects' positions (N, 3) in metres, in the world, from the scene's bearings and ranges."""
    return scene.T_world_pano[:3, 3] + scene.range_m[:, None] * direction(scene.azimuth_rad, scene.elevation_rad)


def _shared_labels(query: ViewpointScene, others: list[ViewpointScene]) -> int:
    """Return the largest number of labels, counted with multiplicity, that the query shares with one of `others`."""
    counts = Counter(map(object_label, query.labels))
    return max(((counts & Counter(map(object_label, other.labels))).total() for other in others), default=0)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="salframe_matterport.diagnose",
        description="Count the wrong answers of a method in a finished comparison by cause.",
    )
    parser.add_argument("run", type=Path, help="Folder of a finished comparison on matterport-annotations")
    parser.add_argument("method", help="Name of a method of the comparison")
    parser.add_argument(
        "--queries", action="store_true", help="Also list the ids of the wrongly answered queries under each cause"
    )
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
