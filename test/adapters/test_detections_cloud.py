"""Detections written as PointCloud2: read again to the bit, and shown by viewers."""

import math

import numpy as np
import pytest

from msg_adapters import detections_cloud, make_header, read_detections

NAN, INF = math.nan, math.inf


def test_built_cloud_gives_back_every_bit(header, over_the_wire):
    random = np.random.default_rng(2)
    given = {
        name: random.uniform(0.1, 3.0, 50)
        for name in (
            *("range", "azimuth", "range_std", "azimuth_std", "time_offset"),
            *("intensity", "range_width", "azimuth_width", "range_rate"),
        )
    }
    found = read_detections(over_the_wire(detections_cloud(header, **given)))
    assert (found.sensor_scan.stamp_ns, found.sensor_scan.frame_id) == (
        1_700_000_000_123_456_789,
        "map",
    )
    for name, values in given.items():
        read = (
            found.scan.features[name] if name in found.scan.features else getattr(found.scan, name)
        )
        np.testing.assert_array_equal(read, values, err_msg=name)


def test_built_cloud_gives_back_elevations_and_shows_them(header):
    cloud = detections_cloud(header, range=[100.0], azimuth=[1.0], elevation=[-0.5])
    x, y, z = np.frombuffer(cloud.data, np.float32)[:3]
    level = 100.0 * math.cos(0.5)
    expected = [level * math.cos(1.0), level * math.sin(1.0), -100.0 * math.sin(0.5)]
    np.testing.assert_allclose([x, y, z], expected, rtol=1e-6)
    found = read_detections(cloud)
    assert (found.scan.range[0], found.sensor_scan.height[0]) == (level, expected[2])


@pytest.mark.parametrize("angle", [{"azimuth": [0.0, 1.0]}, {"bearing": [0.0, -1.0]}], ids=list)
def test_built_cloud_shows_in_rviz(header, angle):
    cloud = detections_cloud(header, range=[100.0, 200.0], **angle)
    fields = [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields[:3]]
    assert fields == [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]  # 7 is FLOAT32
    assert len(cloud.data) == cloud.width * cloud.height * cloud.point_step
    points = np.frombuffer(cloud.data, np.float32).reshape(2, -1)
    expected = [[100.0, 0.0, 0.0], [200.0 * math.cos(1.0), 200.0 * math.sin(1.0), 0.0]]
    np.testing.assert_allclose(points[:, :3], expected, rtol=1e-6)


def test_built_cloud_of_true_bearings_claims_no_place_in_the_sensor_frame(header):
    cloud = detections_cloud(header, range=[5.0], bearing=[0.25], bearing_reference="north")
    assert [field.name for field in cloud.fields] == ["range", "bearing"]
    found = read_detections(cloud, bearing_reference="north")
    assert found.scan.azimuth[0] == math.pi / 2 - 0.25


@pytest.mark.filterwarnings("error")
def test_built_cloud_carries_bad_values_as_they_are(header):
    cloud = detections_cloud(header, range=[NAN, -1.0, 5.0], azimuth=[1.0, 1.0, INF])
    assert read_detections(cloud).dropped == {
        "range_not_finite": 1,
        "range_not_positive": 1,
        "azimuth_not_finite": 1,
    }
    assert not cloud.is_dense


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({}, "exactly one of azimuth and bearing"),
        ({"azimuth": [1.0], "bearing": [1.0]}, "exactly one of azimuth"),
        ({"azimuth": [1.0, 2.0]}, "azimuth must have .* the length of range"),
        ({"azimuth": 1.0}, "azimuth must have one dimension"),
        ({"azimuth": [1.0], "depth": [1.0]}, "depth is not a field"),
        ({"bearing": [1.0], "bearing_reference": "grid"}, "bearing_reference"),
    ],
)
def test_built_cloud_refuses_what_it_cannot_say(header, given, sentence):
    with pytest.raises(ValueError, match=sentence):
        detections_cloud(header, range=[1.0], **given)


def test_a_bearing_whose_reference_is_not_known_is_written_without_a_place():
    header = make_header(0, "sonar")
    cloud = detections_cloud(header, bearing_reference=None, range=[100.0], bearing=[0.5])
    assert [field.name for field in cloud.fields] == ["range", "bearing"]
    for reference in ("bow", "north"):
        expected = detections_cloud(
            header, bearing_reference=reference, range=[100.0], bearing=[0.5]
        )
        found, wanted = (
            read_detections(one, bearing_reference=reference) for one in (cloud, expected)
        )
        assert found.scan.azimuth.tolist() == wanted.scan.azimuth.tolist()
