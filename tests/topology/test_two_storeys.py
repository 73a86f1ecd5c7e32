"""Two generated buildings as the storeys of one folder: routes, localization and navigation across."""

from __future__ import annotations

import numpy as np
import pytest

from training.floors.storeys import measure


@pytest.mark.slow
def test_two_buildings_above_each_other_are_one_map(tmp_path):
    results = measure("house-6", (200, 201), tmp_path, routes=50, episodes=6)
    assert results.routes == 50
    assert np.median(results.errors) < 0.01
    for right in results.localized.values():
        assert len(right) == 18
        assert np.mean(right) > 0.9
    assert sum(results.walked) >= 5
