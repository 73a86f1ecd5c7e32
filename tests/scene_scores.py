"""What scene indexes compute, object by object, and graphs to compute it on."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from salframe_graphs.retrieval.postings import CODE_LOW, CODE_STEP, POSITION_M

from salframe.graphs.graph import SaliencyGraph
from salframe.panoramas.geometry import pose_2d, transform_points

NAMES = np.array(["chair", "chair", "chair", "table", "lamp", "bed", "vase", "harp"])


def some_graph(rng: np.random.Generator, max_objects: int = 8) -> SaliencyGraph:
    """Return objects at values that the codes stand for, so that packing them changes nothing."""
    count = rng.integers(0, max_objects + 1)
    value = CODE_LOW + CODE_STEP * rng.integers(60, 200, (count, 3))
    centroid_m = np.column_stack([rng.choice(POSITION_M[np.abs(POSITION_M) < 4], (count, 2)), value[:, 0]])
    size_m = np.exp(value[:, [1, 1, 2]])
    ones, edges = np.ones(count), np.zeros((0, 2), np.int64)
    labels = tuple(rng.choice(NAMES, count).tolist())
    return SaliencyGraph(labels, ones, ones / max(count, 1), centroid_m, size_m, 0 * ones, edges)


def refurnished(graph: SaliencyGraph, rng: np.random.Generator) -> SaliencyGraph:
    """Return most of a graph's objects, moved, raised and resized a little, again at values that codes stand for."""
    kept = np.flatnonzero(rng.random(len(graph)) < 0.9)
    moved = graph.centroid_m[kept] + np.column_stack(
        [rng.normal(0, 0.3, (len(kept), 2)), CODE_STEP * rng.integers(-4, 5, len(kept))]
    )
    for axis in (0, 1):
        moved[:, axis] = POSITION_M[np.abs(POSITION_M[:, None] - moved[:, axis]).argmin(0)]
    size_m = graph.size_m[kept] * np.exp(CODE_STEP * rng.integers(-8, 9, (len(kept), 3)))
    ones, edges = np.ones(len(kept)), np.zeros((0, 2), np.int64)
    labels = tuple(graph.labels[i] for i in kept)
    return SaliencyGraph(labels, ones, ones / max(len(kept), 1), moved, size_m, 0 * ones, edges)


def turned(graph: SaliencyGraph, rng: np.random.Generator) -> SaliencyGraph:
    """Return a graph as seen from elsewhere."""
    pose = pose_2d(*rng.normal(0, 1, 2), rng.uniform(-np.pi, np.pi))
    return replace(graph, centroid_m=transform_points(pose, graph.centroid_m), bearing=None)


def rarities(query: SaliencyGraph, graphs: list[SaliencyGraph]) -> dict[str, float]:
    """Return the smooth inverse document frequency of each label."""
    having = {name: sum(name in graph.labels for graph in graphs) for name in {*NAMES.tolist(), *query.labels}}
    return {name: np.log((1 + len(graphs)) / (1 + number)) + 1 for name, number in having.items()}


def similarity(query: SaliencyGraph, graph: SaliencyGraph) -> np.ndarray:
    """Return (n, m) similarity of objects of one label in height, length and box height; 0 of different labels."""
    alike = (np.array(query.labels)[:, None] == np.array(graph.labels)).astype(float)
    if not query.bearings_only:
        for values, half_at in (
            (lambda g: g.centroid_m[:, 2], 0.2),
            (lambda g: np.log(g.size_m[:, 0]), 0.8),
            (lambda g: np.log(g.size_m[:, 2]), 0.5),
        ):
            alike /= 1 + ((values(query)[:, None] - values(graph)) / half_at) ** 2
    return alike


def list_scores(query: SaliencyGraph, graphs: list[SaliencyGraph]) -> np.ndarray:
    """Return (S,) the Jaccard index of objects, label by label."""
    rarity, scores = rarities(query, graphs), []
    for graph in graphs:
        alike, shared = similarity(query, graph), 0.0
        for name in set(query.labels) & set(graph.labels):
            own = alike[np.ix_(np.array(query.labels) == name, np.array(graph.labels) == name)]
            shared += rarity[name] * min(own.max(1).sum(), own.max(0).sum())
        whole = sum(rarity[name] for name in (*query.labels, *graph.labels))
        scores.append(shared / (whole - shared) if whole else 0.0)
    return np.array(scores)


def pose_scores(query: SaliencyGraph, graphs: list[SaliencyGraph], max_shift_m: float = 6.0) -> np.ndarray:
    """Return (S,) the Jaccard index of objects that coincide under the best pose of each scene, of those that two pairs
    of objects give."""
    rarity, scores = rarities(query, graphs), []
    for graph in graphs:
        here, there = (np.array([rarity[name] for name in g.labels]) for g in (query, graph))
        kernel = _best_kernel(query, graph, here, max_shift_m)
        shared = min(kernel.max(1) @ here, kernel.max(0) @ there) if kernel.size else 0.0
        scores.append(shared / (here.sum() + there.sum() - shared) if shared else 0.0)
    return np.array(scores)


def _best_kernel(query: SaliencyGraph, graph: SaliencyGraph, weight: np.ndarray, max_shift_m: float) -> np.ndarray:
    """Return (n, m) how much each two objects coincide under the pose that explains most of the query."""
    alike = similarity(query, graph)
    alike[alike < 0.1] = 0
    ranges_m = np.hypot(query.range_m[:, None], graph.range_m)
    tolerance_m = 0.3 + 0.05 * ranges_m
    here, there = (g.centroid_m[:, 0] + 1j * g.centroid_m[:, 1] for g in (query, graph))
    best, best_kernel = 0.0, np.zeros(alike.shape)
    for (i, j), (k, m) in combinations(zip(*np.nonzero(alike), strict=True), 2):
        base, base_there = here[k] - here[i], there[m] - there[j]
        if i == k or j == m or min(abs(base), abs(base_there)) <= 0.3:
            continue
        if abs(abs(base) - abs(base_there)) >= tolerance_m[i, j] + tolerance_m[k, m]:
            continue
        turn = base_there / base / abs(base_there / base)
        shift = (there[j] + there[m]) / 2 - turn * (here[i] + here[k]) / 2
        if abs(shift) >= max_shift_m:
            continue
        apart_m = abs((turn * here + shift)[:, None] - there)
        kernel = alike * np.maximum(1 - (apart_m / tolerance_m) ** 2, 0)
        if kernel.max(1) @ weight > best:
            best, best_kernel = kernel.max(1) @ weight, kernel
    return best_kernel
