"""The layout of placed detections, byte by byte, and its inverse."""

import struct

import numpy as np
import pytest
from support.raw_cloud import DATATYPES, raw_cloud

from msg_adapters import PlacedDetections, placed_detections_cloud, read_placed_detections
from tsepm_ros.tracker.scan import FEATURES

LAYOUT = [
    ("x", 0, "f"),
    ("y", 4, "f"),
    ("z", 8, "f"),
    ("position_x", 16, "d"),
    ("position_y", 24, "d"),
    ("cov_xx", 32, "d"),
    ("cov_xy", 40, "d"),
    ("cov_yy", 48, "d"),
    ("time_offset", 56, "d"),
]
POINT_STEP = 64
FAR = 4_200_000.1
"""A northing, m, of which float32 keeps a quarter of a metre."""
PLACED = PlacedDetections(
    position=np.array([[1.0, FAR], [-3.5, 4.25]]),
    covariance=np.array([[[900.0, -30.5], [-30.5, 400.25]], [[1.0, 0.5], [0.5, 2.0]]]),
    time_offset=np.array([0.1, 11.9]),
    features={"intensity": np.array([5.0, np.nan]), "range_rate": np.array([1e300, -2.0])},
)
NOTHING = PlacedDetections(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))


def test_fields_stand_in_the_order_and_at_the_offsets_of_the_contract(header):
    cloud = placed_detections_cloud(header, PLACED)
    features = [("intensity", 64, "f"), ("range_rate", 68, "f")]
    assert [(field.name, field.offset, field.datatype, field.count) for field in cloud.fields] == [
        (name, offset, DATATYPES[code], 1) for name, offset, code in LAYOUT + features
    ]
    assert (cloud.header, cloud.point_step, cloud.width) == (header, POINT_STEP + 8, 2)


@pytest.mark.parametrize("number", range(len(FEATURES) + 1))
def test_every_float64_of_every_point_is_aligned(header, number):
    features = {name: np.zeros(2) for name in FEATURES[:number]}
    placed = PlacedDetections(PLACED.position, PLACED.covariance, PLACED.time_offset, features)
    assert placed_detections_cloud(header, placed).point_step % 8 == 0


def test_bytes_are_those_of_the_detections(header, over_the_wire):
    cloud = over_the_wire(placed_detections_cloud(header, PLACED))
    for row, start in enumerate((0, cloud.point_step)):
        found = [
            struct.unpack_from("<" + code, bytes(cloud.data), start + offset)[0]
            for _, offset, code in LAYOUT
        ]
        x, y = PLACED.position[row]
        (xx, xy), (_, yy) = PLACED.covariance[row]
        expected = [np.float32(x), np.float32(y), 0.0, x, y, xx, xy, yy, PLACED.time_offset[row]]
        np.testing.assert_array_equal(found, expected)


def test_reading_is_the_exact_inverse(header, over_the_wire):
    found = read_placed_detections(over_the_wire(placed_detections_cloud(header, PLACED)))
    np.testing.assert_array_equal(found.position, PLACED.position)
    np.testing.assert_array_equal(found.covariance, PLACED.covariance)
    np.testing.assert_array_equal(found.time_offset, PLACED.time_offset)
    assert list(found.features) == ["intensity", "range_rate"]
    np.testing.assert_array_equal(found.features["intensity"], [5.0, np.nan])
    np.testing.assert_array_equal(found.features["range_rate"], [np.inf, -2.0])


def test_reading_takes_the_layout_from_the_message():
    needed = LAYOUT[3:]
    names = [("extra", "B"), *((name, code) for name, _, code in reversed(needed))]
    cloud = raw_cloud(names, [[9, *range(len(needed), 0, -1)]], big_endian=True, gap=1)
    found = read_placed_detections(cloud)
    np.testing.assert_array_equal(found.position, [[1.0, 2.0]])
    np.testing.assert_array_equal(found.covariance, [[[3.0, 4.0], [4.0, 5.0]]])
    np.testing.assert_array_equal(found.time_offset, [6.0])
    assert found.features == {}


def test_a_ping_without_detections_is_an_empty_cloud_with_all_fields(header, over_the_wire):
    cloud = over_the_wire(placed_detections_cloud(header, NOTHING))
    assert (cloud.width, cloud.point_step) == (0, POINT_STEP)
    assert [field.name for field in cloud.fields] == [name for name, _, _ in LAYOUT]
    found = read_placed_detections(cloud)
    assert (found.position.shape, found.covariance.shape) == ((0, 2), (0, 2, 2))
