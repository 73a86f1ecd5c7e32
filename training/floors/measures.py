"""Compare the topology of derived floors with the topology of floor masks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from salframe.topology.topological_map import NodeKind, TopologicalMap

MAX_DOOR_M = 0.75
"""Maximum distance between a doorway of the masks and the same doorway of the derived floors."""
MIN_ROUTE_M = 1.0
"""Minimum length of a compared route."""


@dataclass(frozen=True)
class TopologyComparison:
    """Comparison of a derived topology with the topology of floor masks.

    Attributes:
        mask_doorways: Number of doorways of the masks.
        derived_doorways: Number of doorways of the derived floors.
        common_doorways: Number of doorways that both have: between the same two regions, at most MAX_DOOR_M apart.
        route_errors: Relative errors of the lengths of routes between scene nodes that both topologies have.
        lost_routes: Number of routes of the masks that the derived topology does not have.
        false_routes: Number of routes that only the derived topology has.
    """

    mask_doorways: int
    derived_doorways: int
    common_doorways: int
    route_errors: np.ndarray
    lost_routes: int
    false_routes: int


def compare_topologies(from_masks: TopologicalMap, derived: TopologicalMap) -> TopologyComparison:
    """Compare a derived topology with the topology of floor masks."""
    doors, derived_doors = _doors(from_masks), _doors(derived)
    common = 0
    for pair, positions_m in doors.items():
        if pair in derived_doors:
            distance_m = cdist(positions_m, derived_doors[pair])
            rows, columns = linear_sum_assignment(np.where(distance_m <= MAX_DOOR_M, distance_m, 1e6))
            common += int((distance_m[rows, columns] <= MAX_DOOR_M).sum())
    scenes = [node.id for node in from_masks.nodes if node.kind is NodeKind.SCENE]
    both = [id for id in scenes if any(node.id == id for node in derived.nodes)]
    first, second = (_lengths_m(topology, both) for topology in (from_masks, derived))
    first, second = (lengths[np.triu_indices(len(both), 1)] for lengths in (first, second))
    is_compared = np.isfinite(first) & np.isfinite(second) & (first >= MIN_ROUTE_M)
    errors = np.abs(second[is_compared] / first[is_compared] - 1)
    return TopologyComparison(
        sum(map(len, doors.values())),
        sum(map(len, derived_doors.values())),
        common,
        errors,
        int((np.isfinite(first) & ~np.isfinite(second)).sum()),
        int((~np.isfinite(first) & np.isfinite(second)).sum()),
    )


def _doors(topology: TopologicalMap) -> dict[frozenset[str], np.ndarray]:
    """Return the positions (N, 2) of the transition nodes between each pair of regions."""
    doors: dict[frozenset[str], list[tuple[float, float]]] = {}
    for node in topology.nodes:
        if node.kind is NodeKind.TRANSITION:
            doors.setdefault(frozenset(node.regions), []).append(node.xyz_m[:2])
    return {pair: np.array(positions) for pair, positions in doors.items()}


def _lengths_m(topology: TopologicalMap, ids: list[str]) -> np.ndarray:
    """Return the lengths of the shortest routes between N nodes, (N, N) in metres, inf if there is no route."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    number = {node.id: index for index, node in enumerate(topology.nodes)}
    ends = np.array([(number[edge.start], number[edge.end]) for edge in topology.edges]).T
    lengths = [edge.length_m for edge in topology.edges]
    matrix = coo_matrix((lengths, tuple(ends)), (len(number),) * 2).tocsr()
    rows = [number[id] for id in ids]
    return dijkstra(matrix, directed=False, indices=rows)[:, rows]  # type: ignore[no-any-return]


def adjusted_rand_index(first: np.ndarray, second: np.ndarray) -> float:
    """Return the adjusted Rand index of two labellings (N,) (Hubert and Arabie 1985, equation 5)."""
    _, rows = np.unique(first, return_inverse=True)
    _, columns = np.unique(second, return_inverse=True)
    table = np.zeros((rows.max() + 1, columns.max() + 1))
    np.add.at(table, (rows, columns), 1)
    pairs = lambda counts: float((counts * (counts - 1) / 2).sum())  # noqa: E731
    both, one, other, all_pairs = pairs(table), pairs(table.sum(1)), pairs(table.sum(0)), pairs(table.sum())
    expected = one * other / all_pairs
    return (both - expected) / ((one + other) / 2 - expected)
