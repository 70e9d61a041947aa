"""Placed detections as a cloud."""

from __future__ import annotations

import numpy as np

from msg_adapters import placed_detections_cloud, read_fields


def test_positions_and_features_are_there(header, over_the_wire):
    features = {"intensity": np.array([5.0, np.nan]), "range_rate": np.array([1e300, -2.0])}
    position = np.array([[1.0, 2.0], [-3.5, 4.25]])
    cloud = over_the_wire(placed_detections_cloud(header, position, features))
    assert cloud.header == header
    found = read_fields(cloud, ("x", "y", "z", "intensity", "range_rate"))
    np.testing.assert_array_equal(found["x"], [1.0, -3.5])
    np.testing.assert_array_equal(found["y"], [2.0, 4.25])
    np.testing.assert_array_equal(found["z"], [0.0, 0.0])
    np.testing.assert_array_equal(found["intensity"], [5.0, np.nan])
    np.testing.assert_array_equal(found["range_rate"], [np.inf, -2.0])
    assert {field.datatype for field in cloud.fields} == {7}


def test_a_ping_without_detections_is_an_empty_cloud(header):
    cloud = placed_detections_cloud(header, np.zeros((0, 2)), {})
    assert (cloud.width, [field.name for field in cloud.fields]) == (0, ["x", "y", "z"])
