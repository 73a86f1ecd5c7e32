"""Edges between the nodes of a floor: along lines of sight, and along shortest paths where lines of sight do not
connect the nodes."""

from __future__ import annotations

import numpy as np

from salframe.topology.grid import FloorGrid, has_line_of_sight, pixel_graph
from salframe.topology.topological_map import MapEdge


def sight_pairs(grid: FloorGrid, pixels: np.ndarray) -> np.ndarray:
    """Return the pairs of positions with a line of sight over clear floor.

    Args:
        grid: The floor.
        pixels: (N, 2) float64 positions (row, column).

    Returns:
        (E, 2) int64, indices i < j of the positions of each pair.
    """
    first, second = np.triu_indices(len(pixels), 1)
    visible = has_line_of_sight(grid.clear, pixels[first], pixels[second])
    return np.column_stack([first[visible], second[visible]])


def components(count: int, pairs: np.ndarray) -> np.ndarray:
    """Return the index of the connected component of each of `count` nodes, (count,) int. The pairs (E, 2) of node
    indices are connected."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    matrix = coo_matrix((np.ones(len(pairs)), tuple(pairs.T)), (count, count))
    return connected_components(matrix, directed=False)[1]


def make_edge(grid: FloorGrid, start: str, end: str, corners: np.ndarray) -> MapEdge:
    """Return the edge between two nodes along a path.

    Args:
        grid: The floor.
        start: Id of the first node.
        end: Id of the second node.
        corners: (K, 2) corners of the path as (row, column), including both ends. Two corners give a straight edge.
    """
    path = grid.to_metres(corners)
    x, y = path[-1] - path[0]
    length_m = float(np.hypot(*np.diff(path, axis=0).T).sum())
    path_m = tuple((float(x), float(y)) for x, y in path) if len(path) > 2 else ()
    return MapEdge(start, end, length_m, float(np.arctan2(y, x)), path_m)


def joining_paths(grid: FloorGrid, pixels: np.ndarray, component: np.ndarray) -> list[tuple[int, int, np.ndarray]]:
    """Return shortest paths over clear floor that connect components of nodes, as far as clear floor connects them.

    The paths form a minimum spanning tree of the components. The neighbourhood of a node contains the pixels from which
    this node has the shortest walking distance. Only paths between two nodes whose neighbourhoods touch are considered,
    so that a path does not cross the neighbourhood of a third node.

    Args:
        grid: The floor.
        pixels: (N, 2) float64 positions (row, column) of the nodes.
        component: (N,) int, the component of each node.

    Returns:
        Paths (i, j, corners) from node i to node j. `corners` (K, 2) are positions (row, column); a path is straight
        between its corners.
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
    for path in _spanning_paths(component[a[meets]], component[b[meets]], length, int(component.max()) + 1):
        forth, back = _trace(before, int(row[path])), _trace(before, int(column[path]))
        line = middle[[*reversed(forth), *back]]
        i, j = int(owner[row[path]]), int(owner[column[path]])
        line[0], line[-1] = pixels[i], pixels[j]
        paths.append((i, j, _pull_straight(grid.clear, line)))
    return paths


def _spanning_paths(first: np.ndarray, second: np.ndarray, length: np.ndarray, count: int) -> list[int]:
    """Return the indices of the paths between components (first < second) that form the minimum spanning tree."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import minimum_spanning_tree

    order = np.lexsort((length, second, first))
    _, unique = np.unique(np.column_stack([first, second])[order], axis=0, return_index=True)
    shortest = order[unique]
    tree = minimum_spanning_tree(
        coo_matrix((length[shortest], (first[shortest], second[shortest])), (count, count)).tocsr()
    ).tocoo()
    position = {(int(first[path]), int(second[path])): int(path) for path in shortest}
    return [position[int(i), int(j)] for i, j in zip(tree.row, tree.col, strict=True)]


def _trace(before: np.ndarray, pixel: int) -> list[int]:
    """Return the pixels on the shortest path from a pixel to its nearest node."""
    line = [pixel]
    while before[line[-1]] >= 0:
        line.append(int(before[line[-1]]))
    return line


def _pull_straight(clear: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Return the corners (K, 2) of a straightened line (L, 2): after each corner, the next corner is the last point of
    the line that is visible from it."""
    corners = [0]
    while corners[-1] < len(line) - 1:
        ahead = np.arange(corners[-1] + 1, len(line))
        visible = has_line_of_sight(clear, np.broadcast_to(line[corners[-1]], (len(ahead), 2)), line[ahead])
        corners.append(int(ahead[visible].max()))
    return line[corners]
