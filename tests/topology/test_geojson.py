"""The geographic anchor of a map, against tabulated lengths of degrees of the WGS 84 ellipsoid."""

from __future__ import annotations

import numpy as np
import pytest

from salframe.framework.errors import ConfigError
from salframe.topology.geojson import GeoAnchor


def test_a_degree_has_its_tabulated_length():
    """At a latitude of 45 deg, a degree of latitude is 111,131.75 m long and a degree of longitude 78,846.81 m."""
    longitude, latitude = GeoAnchor(45.0, 10.0, 0.0).geographic(np.array([78.84681, 111.13175]))
    assert longitude == pytest.approx(10.001, abs=1e-8)
    assert latitude == pytest.approx(45.001, abs=1e-8)


def test_the_bearing_is_that_of_the_y_axis():
    east = GeoAnchor(45.0, 10.0, 90.0).geographic(np.array([0.0, 78.84681]))
    assert east == pytest.approx([10.001, 45.0], abs=1e-8)
    south = GeoAnchor(45.0, 10.0, 90.0).geographic(np.array([111.13175, 0.0]))
    assert south == pytest.approx([10.0, 44.999], abs=1e-8)


@pytest.mark.parametrize("text", ["52.5,13.4", "north,0,0", "95,0,0", "nan,0,0", "0,200,0"])
def test_a_wrong_anchor_is_refused(text):
    with pytest.raises(ConfigError, match="expected LATITUDE,LONGITUDE,BEARING"):
        GeoAnchor.parse(text)
