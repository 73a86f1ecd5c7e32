"""Measure how several views of a narrow camera, turned on the spot, are localized as one query.

    python tests/benchmarks/views.py [--seeds N [N ...]] [--fov DEG] [--counts N [N ...]] [--queries N]
                                      [--drift-deg DEG]

The queries of `house-42` are rendered once, and cut to views that turn by 60 % of the field of view from one to the
next. The motion between views has the errors of odometry, 1 degree a step by default; views turned on the spot travel
no distance. The map has the true poses. Objects have the errors of `panoseg`, with one draw for each object and
stretch. Printed are, for each number of views, the joined answer and the product of the single answers: accuracy with
its 95 % CI (Wilson), the median error of the pose over the queries that were placed correctly with a pose, and the
share of all queries within 0.5 m and 5 degrees.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from salframe.evaluation.statistics import estimate_proportion, median
from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.framework.files.cache import Cache
from salframe.localization.answers import Localization
from salframe.localization.fusing import fuse_answers
from salframe.localization.map import LocalizationMap
from salframe.panoramas.dataset import Dataset
from salframe.panoramas.geometry import invert_pose, pose_2d, pose_errors
from salframe.panoramas.opening import configure_dataset, open_dataset, reference_frames
from salframe.panoramas.panorama import Panorama
from salframe.panoramas.query_view import as_query
from salframe.panoramas.turning import turned
from salframe.panoramas.view import OdometryNoise, View

TURN_SHARE = 0.6
"""Turn from one view to the next, relative to the field of view."""


def turned_views(panorama: Panorama, config, count: int, fov_deg: float, noise: OdometryNoise, seed) -> list[View]:
    """Return views that turn to the left, with the motion that odometry measures. The last view has the heading of the
    panorama."""
    rng, width = np.random.default_rng(seed), panorama.range_m.shape[1]
    columns = [-round(step * TURN_SHARE * fov_deg / 360 * width) for step in reversed(range(count))]
    view_config = config.model_copy(update={"query_fov_deg": fov_deg})
    T_last_view = [np.eye(4)]
    for before, after in reversed(list(pairwise(columns))):
        turn_rad = 2 * np.pi * (after - before) / width + np.radians(noise.heading_drift_deg) * rng.standard_normal()
        T_last_view.insert(0, T_last_view[0] @ invert_pose(pose_2d(0, 0, turn_rad)))
    return [
        View(as_query(turned(panorama, shift), view_config), T) for shift, T in zip(columns, T_last_view, strict=True)
    ]


def open_house(seed: int) -> tuple[Dataset, LocalizationMap]:
    """Return `house-42` of a seed, and the map of `proposed`."""
    _, config = configure_dataset("house-42", None, [{"seed": seed, "rgb": False}])
    house = open_dataset(config)
    localizer = registry().build(
        "localizer",
        configure("localizer", "proposed", settings("localizer", "proposed"), [{"detector": "annotations"}]),
    )
    frames = reference_frames(house)
    return house, LocalizationMap.build(localizer, frames, Cache(), house.content_key, floors=house.floors())


def report(name: str, answers: Sequence[Localization], truths: Sequence) -> None:
    """Print the accuracy and the pose errors of answers."""
    right = [
        answer.status.names_a_place and answer.places[0].place == truth.place
        for answer, truth in zip(answers, truths, strict=True)
    ]
    errors = np.full((len(answers), 2), np.inf)
    for number, (answer, truth) in enumerate(zip(answers, truths, strict=True)):
        if answer.T_world_query is not None:
            flat = answer.T_world_query.copy()
            flat[2, 3] = truth.T_world_pano[2, 3]
            errors[number] = pose_errors(flat, truth.T_world_pano)
    near = (errors[:, 0] <= 0.5) & (errors[:, 1] <= np.radians(5))
    share = estimate_proportion(np.array(right), [str(number) for number in range(len(right))])
    median_m = median(errors[np.array(right) & np.isfinite(errors[:, 0]), 0])
    print(
        f"{name:24s} n {len(right):4d}  accuracy {share.value:6.1%} (95 % CI {share.low:.1%} to {share.high:.1%})  "
        f"median pose error {np.nan if median_m is None else median_m:.2f} m  within 0.5 m, 5 deg {near.mean():6.1%}",
        flush=True,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[200], help="seeds of house-42")
    parser.add_argument("--fov", type=float, default=90.0, help="field of view in degrees")
    parser.add_argument("--counts", type=int, nargs="+", default=[1, 3, 6], help="numbers of views")
    parser.add_argument("--queries", type=int, default=10_000, help="maximum number of queries of a seed")
    parser.add_argument("--drift-deg", type=float, default=1.0, help="error of the heading from one view to the next")
    args = parser.parse_args()
    noise = OdometryNoise(heading_drift_deg=args.drift_deg)
    joined = {count: [] for count in args.counts}
    fused = {count: [] for count in args.counts}
    truths = []
    for seed in args.seeds:
        house, built = open_house(seed)
        queries = house.folds()[0].queries
        for number, query in enumerate(queries[:: max(1, round(len(queries) / args.queries))]):
            panorama = query.load()
            truths.append(house.truth(query.id))
            for count in args.counts:
                views = turned_views(panorama, house.config, count, args.fov, noise, (seed, number))
                joined[count].append(built.localize(views=views, warn=lambda _: None))
                singles = [built.localize(view.panorama, warn=lambda _: None) for view in views]
                fused[count].append(fuse_answers(singles, np.stack([view.T_last_view for view in views])))
    for count in args.counts:
        report(f"{count} views, joined", joined[count], truths)
        report(f"{count} views, product", fused[count], truths)


if __name__ == "__main__":
    main()
