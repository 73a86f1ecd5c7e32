"""A generated building of two storeys: its derived map, routes, localization and navigation across."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.topology.building_map import build_map
from salframe.topology.routes import directions, find_route
from salframe.topology.store import open_topology
from training.floors.storeys import measure


@pytest.mark.slow
def test_the_derived_map_of_two_storeys_is_like_the_given_one():
    results = measure("house-6", 200, routes=50, episodes=6)
    assert results.routes == 50
    assert np.median(results.errors) < 0.01
    for right in results.localized.values():
        assert len(right) == 18
        assert np.mean(right) > 0.9
    for success in results.walked.values():
        assert len(success) == 6
        assert sum(success) >= 5


@pytest.mark.slow
def test_a_map_has_the_stairs_of_its_dataset(tmp_path):
    # with this seed, the frames in doorways look like a recorded walk up other stairs
    overrides = [
        "data.style=home",
        "data.rooms=4",
        "data.seed=6",
        "data.storeys=2",
        "data.rgb=false",
        "data.height=64",
        "data.queries_per_room=0",
    ]
    build_map("house", tmp_path / "map", "objects", calibrate=False, overrides=overrides)
    topology = open_topology(tmp_path / "map")
    (stairs,) = topology.connections
    route = find_route(topology, "1-living-room-01", "2-corridor-01")
    rides = [str(step) for step in directions(route) if step.floor is not None]
    assert len(rides) == 1
    assert rides[0].startswith("take the stairs to floor 2, to 2-")
    walked_m = sum(leg.length_m for leg in route.legs if not leg.storeys)
    assert route.length_m == pytest.approx(walked_m + stairs.length_m)
