"""Places on the earth by the geodesic from a reference."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Geod

from tsepm_ros.tools.bridge.geographic import GeographicReference


def test_a_position_is_found_by_the_geodesic_from_the_reference_also_across_180_degrees():
    reference = GeographicReference(59.65, 10.63, east=500.0, north=-200.0)
    (latitude, longitude), *_ = reference.geographic(np.array([[500.0, 1800.0]])).tolist()
    azimuth, _, distance = Geod(ellps="WGS84").inv(10.63, 59.65, longitude, latitude)
    assert (azimuth, distance) == pytest.approx((0.0, 2000.0), abs=1e-6)
    east = GeographicReference(10.0, 179.999).geographic(np.array([[1000.0, 0.0]]))[0, 1]
    assert -180.0 <= east < -179.98
