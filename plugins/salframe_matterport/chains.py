"""Random walks between neighbouring viewpoints. The viewpoints of a walk are the views of a driven query."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.sparse.csgraph import dijkstra

from salframe_matterport.readers import connectivity_path, read_connectivity, read_ways
from salframe_matterport.scenes import ViewpointScene, generator, object_key


class Walks:
    """Generates random walks through a building, from one viewpoint to the next along unobstructed ways."""

    def __init__(self, root: Path, scan: str, seed: int) -> None:
        """Read the ways between viewpoints of a building. Raises DataError if the connectivity file is malformed."""
        path = connectivity_path(root, scan)
        poses = read_connectivity(path)
        self._seed, self._number = seed, {f"{scan}/{viewpoint}": i for i, viewpoint in enumerate(poses)}
        position_m = np.array([pose[:3, 3] for pose in poses.values()]).reshape(-1, 3)
        self._length_m = np.zeros((len(poses), len(poses)))
        for start, end in read_ways(path):
            if start in poses and end in poses:
                a, b = self._number[f"{scan}/{start}"], self._number[f"{scan}/{end}"]
                self._length_m[a, b] = self._length_m[b, a] = np.linalg.norm(position_m[a] - position_m[b])
        self._distance_m = dijkstra(self._length_m)

    def walk(self, query: ViewpointScene, scenes: Sequence[ViewpointScene], num_views: int) -> list[ViewpointScene]:
        """Return the scenes of a walk that ends at a query, in the order in which they are visited.

        The walk is generated backwards from the query. The scene before each scene is a random scene that an
        unobstructed way connects with it. If there is no such scene, it is the nearest scene along the ways. The walk
        visits no scene twice. It has fewer than `num_views` scenes if no other scene can be reached. A larger
        `num_views` adds scenes at the start of the same walk.

        Args:
            query: The last scene.
            scenes: The scenes that the walk may visit.
            num_views: Number of scenes of the walk.
        """
        random = generator(self._seed, "walk", query.id)
        free = [scene for scene in scenes if scene is not query]
        walk = [query]
        while len(walk) < num_views:
            here, others = self._number[walk[0].id], [self._number[scene.id] for scene in free]
            distance_m = self._distance_m[here, others]
            if not np.isfinite(distance_m).any():
                break
            neighbours = np.flatnonzero(self._length_m[here, others])
            number = int(random.choice(neighbours)) if len(neighbours) else int(distance_m.argmin())
            walk.insert(0, free.pop(number))
        return walk


def with_query_keys(query: ViewpointScene, view: ViewpointScene) -> ViewpointScene:
    """Return the scene of a view with the object keys of the query's viewpoint.

    The keys seed the simulated errors. An object can thus have the same errors in all views of a query.
    """
    scan, _, viewpoint = query.id.partition("/")
    return replace(view, keys=tuple(object_key(scan, viewpoint, number) for number in view.object_id.tolist()))
