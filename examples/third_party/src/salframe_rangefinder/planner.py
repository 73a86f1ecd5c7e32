"""Routes by networkx."""

from itertools import pairwise

import salframe


class NetworkxPlanner(salframe.Planner):
    """Shortest routes by networkx."""

    name = "networkx"
    version = "1"
    requires = ("networkx",)

    def prepare(self, map):
        import networkx

        self._graph = networkx.Graph()
        self._graph.add_nodes_from(node.id for node in map.nodes)
        for edge in sorted(
            map.edges, key=lambda edge: -edge.length_m
        ):  # add the shortest of parallel edges last, because it replaces the others
            self._graph.add_edge(edge.start, edge.end, length_m=edge.length_m, edge=edge)

    def route(self, start, goal):
        import networkx

        try:
            nodes = networkx.shortest_path(self._graph, start, goal, weight="length_m")
        except networkx.NetworkXNoPath:
            raise salframe.NoRoute(f"no route from {start} to {goal}: the map has no path between them") from None
        edges = [self._graph.edges[pair]["edge"] for pair in pairwise(nodes)]
        legs = tuple(edge if edge.start == node else edge.reversed() for node, edge in zip(nodes, edges, strict=False))
        return salframe.Route(tuple(nodes), legs, sum(edge.length_m for edge in edges))
