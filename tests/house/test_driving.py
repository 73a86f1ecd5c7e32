"""Driven queries: views at equal steps along free floor, in the direction of the motion."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from salframe_house.building import change_building, generate_building
from salframe_house.driving import STEP_M, drive_all
from salframe_house.frames import CLEARANCE_M, choose_frames

VIEWS = 6


@lru_cache
def drives():
    house = generate_building("office", 12, 3)
    changed = change_building(house, 0.1, 3)
    queries = [frame for frame in choose_frames(house, changed, 3) if frame.is_query]
    return changed, queries, drive_all(changed, queries, VIEWS, 3)


def test_the_last_view_stands_where_the_query_stood():
    _, queries, driven = drives()
    for query, views in zip(queries, driven, strict=True):
        last = views[-1]
        assert (last.id, last.place, last.x_m, last.y_m, last.z_m) == (
            query.id,
            query.place,
            query.x_m,
            query.y_m,
            query.z_m,
        )
        assert len({view.id for view in views}) == VIEWS


def test_views_are_half_a_metre_apart_and_look_ahead():
    _, _, driven = drives()
    turns = []
    for views in driven:
        xy = np.array([(view.x_m, view.y_m) for view in views])
        step = np.diff(xy, axis=0)
        length = np.linalg.norm(step, axis=1)
        assert length.max() <= STEP_M + 0.06  # the last step ends at the query, off the centre of its pixel
        assert np.median(length) > 0.8 * STEP_M  # paths bend, and steps are measured along them
        ahead = np.arctan2(step[:, 1], step[:, 0])
        turns += np.abs(np.angle(np.exp(1j * (ahead - [view.yaw_rad for view in views[:-1]])))).tolist()
    assert np.median(turns) < np.radians(15)
    assert np.quantile(turns, 0.9) < np.radians(50)


def test_views_stand_on_free_floor_of_their_place():
    changed, _, driven = drives()
    masks = changed.floor_masks()
    free = masks.free & ~masks.obstacle
    names = {name: label for label, name in masks.regions.items()}
    for views in driven:
        for view in views[:-1]:
            row = int((masks.origin_m[1] - view.y_m) / masks.resolution_m)
            column = int((view.x_m - masks.origin_m[0]) / masks.resolution_m)
            reach = int(CLEARANCE_M / masks.resolution_m) - 1
            assert free[row - reach : row + reach + 1, column - reach : column + reach + 1].all()
            if masks.region[row, column]:  # thresholds have no region
                assert names[view.place] == masks.region[row, column]


def test_some_paths_lead_through_doors():
    _, _, driven = drives()
    assert sum(len({view.place for view in views}) > 1 for views in driven) >= 3


@pytest.mark.parametrize("number", [0, 7])
def test_a_path_depends_on_the_query_alone(number):
    changed, queries, driven = drives()
    (alone,) = drive_all(changed, [queries[number]], VIEWS, 3)
    assert alone == driven[number]


def test_few_views_are_the_last_ones_of_the_path():
    changed, queries, driven = drives()
    for views, few in zip(driven, drive_all(changed, queries, 3, 3), strict=True):
        assert few == views[-3:]
