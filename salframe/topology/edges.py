"""Edges between the nodes of a floor: by sight, and along the shortest way where sight does not join them."""

from __future__ import annotations

import numpy as np

from salframe.topology.grid import FloorGrid, pixel_graph, sees
from salframe.topology.topological_map import MapEdge


def sight_pairs(grid: FloorGrid, pixels: np.ndarray) -> np.ndarray:
    """(E, 2) pairs i < j of the positions (row, column) in pixels (N, 2) that see each other over clear floor."""
    first, second = np.triu_indices(len(pixels), 1)
    seen = sees(grid.clear, pixels[first], pixels[second])
    return np.column_stack([first[seen], second[seen]])


def components(count: int, pairs: np.ndarray) -> np.ndarray:
    """(count,) int component of each of `count` nodes joined by pairs (E, 2)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    joined = coo_matrix((np.ones(len(pairs)), tuple(pairs.T)), (count, count))
    return connected_components(joined, directed=False)[1]


def make_edge(grid: FloorGrid, start: str, end: str, corners: np.ndarray) -> MapEdge:
    """The edge along corners (K, 2), pixels (row, column); straight where there are two."""
    path = grid.to_metres(corners)
    x, y = path[-1] - path[0]
    length_m = float(np.hypot(*np.diff(path, axis=0).T).sum())
    path_m = tuple((float(x), float(y)) for x, y in path) if len(path) > 2 else ()
    return MapEdge(start, end, length_m, float(np.arctan2(y, x)), path_m)


def joining_paths(grid: FloorGrid, pixels: np.ndarray, component: np.ndarray) -> list[tuple[int, int, np.ndarray]]:
    """The shortest ways that join the components of nodes at pixels (N, 2) wherever clear floor does: the minimum
    spanning tree of them.

    Each is (i, j, corners), corners (K, 2) the pixels (row, column) of a line from node i to node j over clear floor,
    pulled straight between its corners. Ways are found from where the nodes' neighbourhoods (pixels nearest to walk to)
    meet: a tree of shortest ways crosses no other neighbourhood.
    """
    from scipy import ndimage
    from scipy.sparse.csgraph import dijkstra

    floor = ndimage.label(grid.clear, np.ones((3, 3), bool))[0]
    cells = np.floor(pixels).astype(int)
    part = floor[tuple(cells.T)]
    split = [number for number in np.unique(part) if len(np.unique(component[part == number])) > 1]
    if not split:
        return []
    mask = np.isin(floor, split)
    nodes = np.flatnonzero(np.isin(part, split))
    number = np.full(mask.shape, -1)
    number[mask] = np.arange(mask.sum())
    graph = pixel_graph(mask)
    start = number[tuple(cells[nodes].T)]
    distance, before, nearest = dijkstra(graph, indices=start, min_only=True, return_predecessors=True)
    node_at = np.full(len(distance), -1)
    node_at[start] = nodes
    owner = np.where(nearest >= 0, node_at[np.maximum(nearest, 0)], -1)

    steps = graph.tocoo()
    a, b = owner[steps.row], owner[steps.col]
    meets = (a >= 0) & (b >= 0) & (component[a] < component[b])
    row, column = steps.row[meets], steps.col[meets]
    length = distance[row] + steps.data[meets] + distance[column]
    middle = np.argwhere(mask) + 0.5
    paths = []
    for way in _spanning_ways(component[a[meets]], component[b[meets]], length, int(component.max()) + 1):
        forth, back = _trace(before, int(row[way])), _trace(before, int(column[way]))
        line = middle[[*reversed(forth), *back]]
        i, j = int(owner[row[way]]), int(owner[column[way]])
        line[0], line[-1] = pixels[i], pixels[j]
        paths.append((i, j, _pull_straight(grid.clear, line)))
    return paths


def _spanning_ways(first: np.ndarray, second: np.ndarray, length: np.ndarray, count: int) -> list[int]:
    """Positions of the ways between components (first < second) that make their minimum spanning tree."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import minimum_spanning_tree

    order = np.lexsort((length, second, first))
    _, unique = np.unique(np.column_stack([first, second])[order], axis=0, return_index=True)
    shortest = order[unique]
    tree = minimum_spanning_tree(
        coo_matrix((length[shortest], (first[shortest], second[shortest])), (count, count)).tocsr()
    ).tocoo()
    position = {(int(first[way]), int(second[way])): int(way) for way in shortest}
    return [position[int(i), int(j)] for i, j in zip(tree.row, tree.col, strict=True)]


def _trace(before: np.ndarray, pixel: int) -> list[int]:
    """From a pixel back to the node it is nearest to."""
    line = [pixel]
    while before[line[-1]] >= 0:
        line.append(int(before[line[-1]]))
    return line


def _pull_straight(clear: np.ndarray, line: np.ndarray) -> np.ndarray:
    """The corners (K, 2) that remain of a line (L, 2) when each goes straight to the farthest point it sees."""
    corners = [0]
    while corners[-1] < len(line) - 1:
        ahead = np.arange(corners[-1] + 1, len(line))
        seen = sees(clear, np.broadcast_to(line[corners[-1]], (len(ahead), 2)), line[ahead])
        corners.append(int(ahead[seen].max()))
    return line[corners]
