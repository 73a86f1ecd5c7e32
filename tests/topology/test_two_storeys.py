"""A generated building of two storeys: its derived map, routes, localization and navigation across."""

from __future__ import annotations

import numpy as np
import pytest

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
