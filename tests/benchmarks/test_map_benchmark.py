"""The topological map of a building of 106 rooms: at most 10 s, the routes between all nodes at most 0.5 s. `make
benchmark`."""

import networkx as nx
import pytest
from salframe_house.building import generate_building
from salframe_house.frames import choose_frames
from salframe_planners.planners import Dijkstra, FloydWarshall

from salframe.panoramas.frames import ReferenceFrame
from salframe.panoramas.geometry import pose_2d
from salframe.topology.build import build_topology

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def masks_and_frames():
    building = generate_building("office", 106, 7)
    kinds = {"map": "scene", "transition": "transition"}
    specs = [spec for spec in choose_frames(building, building, 7, queries_per_room=1) if spec.role in kinds]
    frames = [ReferenceFrame(s.id, s.place, pose_2d(s.x_m, s.y_m, s.yaw_rad, s.z_m), kinds[s.role]) for s in specs]
    return building.floor_masks(), frames


def test_map_of_106_rooms(benchmark, masks_and_frames):
    floor, frames = masks_and_frames
    topology = benchmark.pedantic(build_topology, ([floor], frames), rounds=3)
    assert len(topology.nodes) > 212


@pytest.fixture(scope="module")
def topology(masks_and_frames):
    floor, frames = masks_and_frames
    return build_topology([floor], frames)


def test_routes_between_all_nodes_of_106_rooms(benchmark, topology):
    """Floyd and Warshall's table and every route read off it; nodes that furniture shuts in have none."""
    reached = max(nx.connected_components(nx.Graph([(edge.start, edge.end) for edge in topology.edges])), key=len)

    def plan():
        planner = FloydWarshall()
        planner.prepare(topology)
        return [planner.route(start, goal) for start in reached for goal in reached]

    assert len(benchmark.pedantic(plan, rounds=3)) > 200**2


def test_one_route_by_dijkstra(benchmark, topology):
    planner = Dijkstra()
    planner.prepare(topology)
    ends = [node.id for node in topology.nodes if node.kind == "transition"]
    assert benchmark(planner.route, ends[0], ends[-1]).length_m > 20
