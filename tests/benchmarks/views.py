"""Measure the time of a query of joined views of `proposed` in real buildings, relative to a query of one view.

    python tests/benchmarks/views.py DIR [--scans A,B] [--views 1,3,5] [--rounds N]

DIR is the folder of the Matterport annotations. Half of the viewpoints of a building are its map. The numbers of views
run in turn in one process. A query's time is the best of its rounds, joining included, without describing its
panoramas. Printed are the medians over the queries. Run it with OMP_NUM_THREADS=1 on an idle machine.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from salframe.framework.components.presets import configure, settings
from salframe.framework.components.registry import registry
from salframe.framework.files.cache import Cache
from salframe.localization.described_query import DescribedQuery, describe_view
from salframe.localization.map import LocalizationMap
from salframe.panoramas.opening import find_dataset

SCANS = "82sE5b5pLXE"


def described(root: str, scan: str, views: int) -> tuple[LocalizationMap, list[DescribedQuery]]:
    """Return the map of a building and its described queries."""
    given = ["data.map_share=0.5", "data.query_motion=driven", f"data.query_views={views}", f"data.scans=[{scan}]"]
    dataset = find_dataset("matterport-annotations", root, given)
    (fold,) = dataset.folds()
    config = configure("localizer", "proposed", settings("localizer", "proposed"), [{"detector": "annotations"}])
    localizer, cache, key = registry().build("localizer", config), Cache(), dataset.content_key
    built = LocalizationMap.build(localizer, fold.references, cache, key, floors=dataset.floors())
    queries = [
        built.describe_query([describe_view(localizer, view, cache, key) for view in query.views], query.T_last_view)
        for query in fold.queries
    ]
    return built, queries


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("root", help="folder of the Matterport annotations")
    parser.add_argument("--scans", default=SCANS, help="buildings, comma-separated")
    parser.add_argument("--views", default="1,3,5", help="numbers of views, comma-separated")
    parser.add_argument("--rounds", type=int, default=10)
    options = parser.parse_args()
    numbers = [int(number) for number in options.views.split(",")]
    best: dict[int, list[np.ndarray]] = {number: [] for number in numbers}
    for scan in options.scans.split(","):
        made = {number: described(options.root, scan, number) for number in numbers}
        seconds = {number: np.full(len(queries), np.inf) for number, (_, queries) in made.items()}
        for _ in range(options.rounds):
            for number, (built, queries) in made.items():
                for row, query in enumerate(queries):
                    start = time.perf_counter()
                    built.answer_query(query)
                    seconds[number][row] = min(seconds[number][row], time.perf_counter() - start)
        for number in numbers:
            best[number].append(seconds[number])
    median_ms = {number: 1e3 * float(np.median(np.concatenate(parts))) for number, parts in best.items()}
    for number, ms in median_ms.items():
        print(f"{number} views: {ms:.2f} ms, {ms / median_ms[numbers[0]]:.2f} times the first")


if __name__ == "__main__":
    main()
