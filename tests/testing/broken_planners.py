"""A planner that conforms to the rules of its role, and three that break one rule each."""

from __future__ import annotations

from dataclasses import replace

import networkx as nx

from salframe.framework.errors import NoRoute
from salframe.topology.planner import Planner, Route


class Dijkstra(Planner):
    """Shortest routes by networkx."""

    name = "dijkstra"
    version = "1"

    def prepare(self, map):
        self.graph = nx.Graph()
        self.graph.add_nodes_from(node.id for node in map.nodes)
        for edge in map.edges:
            self.graph.add_edge(
                edge.start, edge.end, **{edge.start: edge, edge.end: edge.reversed()}, length=edge.length_m
            )

    def route(self, start, goal):
        try:
            nodes = tuple(nx.shortest_path(self.graph, start, goal, "length"))
        except nx.NetworkXNoPath:
            raise NoRoute(f"no route from {start} to {goal}") from None
        legs = tuple(self.graph.edges[a, b][a] for a, b in nx.utils.pairwise(nodes))
        return Route(nodes, legs, sum(leg.length_m for leg in legs))


class OneWay(Dijkstra):
    """Broken."""

    def prepare(self, map):
        super().prepare(map)
        self.graph.remove_edge("door", "room")


class Swimming(Dijkstra):
    """Broken."""

    def route(self, start, goal):
        return Route((start, goal), (), 0.0) if goal == "island" else super().route(start, goal)


class Retracing(Dijkstra):
    """Broken."""

    def route(self, start, goal):
        route = super().route(start, goal)
        return replace(route, legs=tuple(replace(leg, path_m=tuple(sorted(leg.path_m))) for leg in route.legs))
