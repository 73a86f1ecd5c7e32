"""The topological map of a building (method.md 1): made from floor masks, stored, drawn, exported, walked."""

from salframe.topology.build import TopologySettings, build_topology

__all__ = ["TopologySettings", "build_topology"]
