"""The time of a query of `proposed` after its graph, compiled by numba and not: `python tests/benchmarks/query_time.py
[DATA ...]`, on a machine that does nothing else.

DATA is a data set, without colour, or the folder of the real buildings, of which one map is asked. All queries are
asked of both sides in turn and the best of five counts for each, in processor time: mean, median and 95th percentile.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from salframe_graphs import compilation

from salframe.framework.cache import Cache
from salframe.localization.describing import describe_frame
from salframe.localization.localizer import Description
from salframe.localization.map import LocalizationMap
from salframe.localization.preparing import prepare, silent

DATA, ROUNDS = ("house-42", "house-106"), 5
SIDES = {"numpy": lambda module: None, "compiled": compilation.compiled}


def asked(data: str, settings: Sequence[str] = ()) -> tuple[LocalizationMap, list[Description]]:
    """Return the map and the descriptions of the queries."""
    if Path(data).is_dir():
        name, root, more = "matterport-annotations", data, ["data.one_map=true"]
    else:
        name, root, more = data, None, ["data.rgb=false", "data.seed=200"]
    _, dataset, localizer = prepare(name, "proposed", root, [*more, *settings], None, None, silent)
    fold, cache = dataset.folds()[0], Cache()
    known, queries = (
        [describe_frame(localizer, frame, cache, dataset.content_key)[0] for frame in frames]
        for frames in (fold.mapping, fold.queries)
    )
    return LocalizationMap.from_descriptions(localizer, known, fold.mapping, dataset.floors()), queries


def milliseconds(known: LocalizationMap, queries: Sequence[Description]) -> dict[str, np.ndarray]:
    """(Q,) of each side."""
    best = {side: np.full(len(queries), np.inf) for side in SIDES}
    try:
        for side in SIDES:
            compilation.compiled = SIDES[side]
            known.answer(queries[0])  # imports and compiles what there is to compile
        for side in [*SIDES] * ROUNDS:
            compilation.compiled = SIDES[side]
            for number, query in enumerate(queries):
                start = time.process_time()
                known.answer(query)
                best[side][number] = min(best[side][number], 1e3 * (time.process_time() - start))
    finally:
        compilation.compiled = SIDES["compiled"]
    return best


if __name__ == "__main__":
    for data in sys.argv[1:] or DATA:
        known, queries = asked(data)
        for side, ms in milliseconds(known, queries).items():
            median, late = np.percentile(ms, [50, 95])
            print(f"{data}, {len(ms)} queries, {side}: {ms.mean():.2f} ms, {median:.2f}, {late:.2f}")
