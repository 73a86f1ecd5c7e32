"""Settings of the dataset `house` that exclude one another."""

import pytest
from salframe_house.settings import HouseConfig

from salframe.framework.components.presets import configure
from salframe.framework.errors import ConfigError


def test_turned_views_of_tilted_queries_are_refused():
    views = {"query_views": 3, "query_fov_deg": 90, "query_tilt_deg": 8}
    assert isinstance(configure("dataset", "house", {}, [{**views, "query_motion": "driven"}]), HouseConfig)
    with pytest.raises(ConfigError, match="query_tilt_deg is 8, but the camera stays level with query_views=3"):
        configure("dataset", "house", {}, [views])
