"""Sources of a topology, and edges in both directions."""

from __future__ import annotations

import pytest

from salframe.topology.topological_map import EdgeKind, MapEdge, PartSource, TopologySources

DERIVED = TopologySources(free_space=PartSource.RANGE, regions=PartSource.PLACES)


@pytest.mark.parametrize(
    ("first", "second", "joined"),
    [
        (DERIVED, DERIVED, DERIVED),
        (TopologySources(), TopologySources(), TopologySources()),
        (DERIVED, TopologySources(), TopologySources(free_space=PartSource.MIXED, regions=PartSource.MIXED)),
        (
            DERIVED,
            TopologySources(free_space=PartSource.MAP_FILE, regions=PartSource.PLACES),
            TopologySources(free_space=PartSource.MIXED, regions=PartSource.PLACES),
        ),
    ],
)
def test_joined_maps_have_the_common_source_of_each_part(first, second, joined):
    assert first.joined(second) == joined
    assert second.joined(first) == joined


def test_only_floors_without_masks_have_a_note():
    assert TopologySources().note is None
    robot = TopologySources(free_space=PartSource.MAP_FILE, regions=PartSource.PLACES)
    assert robot.note == (
        "floors without masks: the free space is from an occupancy map, the regions are derived from places"
    )
    mixed = robot.joined(TopologySources(free_space=PartSource.RANGE, regions=PartSource.PLACES))
    assert mixed.note == (
        "floors without masks: the free space is from several sources, the regions are derived from places"
    )


def test_stairs_lead_back_to_the_storey_where_they_begin():
    up = MapEdge("hall", "landing", 6.0, 0.5, kind=EdgeKind.STAIRS, storeys=(1, 2))
    down = up.reversed()
    assert (down.start, down.end, down.kind, down.storeys) == ("landing", "hall", EdgeKind.STAIRS, (2, 1))
    assert down.reversed() == up
