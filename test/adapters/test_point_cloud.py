# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""PointCloud2 in every layout, and detections in it: read, refused and written."""

import math
import struct
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import ClassVar

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st
from sensor_msgs.msg import PointField
from support.raw_cloud import raw_cloud

from msg_adapters import MessageError, detections_cloud, read_detections, read_fields, write_cloud
from tsepm_ros.session.drop_reasons import DROP_REASONS, drop_reason_of
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, wrap

POINTS = [(1.5, -2.25, 30.0), (4.0, 5.5, -6.75), (7.0, -8.125, 9.5), (10.0, 11.5, 12.25)]


@pytest.mark.parametrize("big_endian", [False, True], ids=["little-endian", "big-endian"])
@pytest.mark.parametrize(
    "layout",
    [
        pytest.param({}, id="packed"),
        pytest.param({"gap": 3}, id="unaligned-padding"),
        pytest.param({"height": 2}, id="organised"),
        pytest.param({"height": 2, "row_padding": 5}, id="organised-row-padding"),
        pytest.param({"height": 4, "row_padding": 1, "gap": 2}, id="one-column"),
    ],
)
@pytest.mark.parametrize("codes", ["fff", "ddd", "fdf"], ids=["float32", "float64", "mixed"])
def test_fields_are_read_from_every_layout(codes, layout, big_endian):
    cloud = raw_cloud(list(zip("abc", codes, strict=True)), POINTS, big_endian=big_endian, **layout)
    values = read_fields(cloud, ["c", "a"])
    assert list(values) == ["c", "a"]
    for name, column in (("a", 0), ("c", 2)):
        assert values[name].dtype == np.float64
        np.testing.assert_array_equal(values[name], [point[column] for point in POINTS])


def test_offsets_count_not_the_order_of_descriptions_nor_bytes_after_the_last_row():
    cloud = raw_cloud(list(zip("abc", "fdf", strict=True)), POINTS)
    cloud.fields = list(reversed(cloud.fields))
    np.testing.assert_array_equal(read_fields(cloud, ["a"])["a"], [1.5, 4.0, 7.0, 10.0])
    cloud = raw_cloud([("a", "d")], [(1.0,), (2.0,)])
    cloud.data = bytes(cloud.data) + b"rest"
    np.testing.assert_array_equal(read_fields(cloud, ["a"])["a"], [1.0, 2.0])


@pytest.mark.filterwarnings("error")
def test_a_signalling_nan_is_a_nan():
    cloud = raw_cloud([("a", "f")], [(0.0,)])
    cloud.data = struct.pack("<I", 0x7F800001)
    assert math.isnan(read_fields(cloud, ["a"])["a"][0])


def _first_field(**values):
    def change(cloud):
        for name, value in values.items():
            setattr(cloud.fields[0], name, value)

    return change


def _cloud(**values):
    def change(cloud):
        for name, value in values.items():
            setattr(cloud, name, value)

    return change


BAD_FIELDS = [
    pytest.param(_first_field(name="other"), "missing_field", "'a' is missing", id="missing"),
    pytest.param(_cloud(fields=[]), "missing_field", "the cloud has no fields", id="no-fields"),
    pytest.param(
        lambda cloud: cloud.fields.append(cloud.fields[0]),
        "duplicate_field",
        "'a' occurs 2 times",
        id="duplicate",
    ),
    *(
        pytest.param(
            _first_field(datatype=getattr(PointField, name)),
            "wrong_datatype",
            f"'a' must be .* {name}",
            id=f"datatype-{name}",
        )
        for name in ("INT8", "UINT8", "INT16", "UINT16", "INT32", "UINT32")
    ),
    pytest.param(
        _first_field(datatype=0), "wrong_datatype", "'a' must be .* number 0", id="datatype-0"
    ),
    pytest.param(
        _first_field(datatype=9), "wrong_datatype", "'a' must be .* number 9", id="datatype-9"
    ),
    pytest.param(_first_field(count=0), "wrong_count", "'a' must have the count 1", id="count-0"),
    pytest.param(_first_field(count=2), "wrong_count", "'a' must have the count 1", id="count-2"),
]

BAD_SIZES = [
    (_first_field(offset=13), "bad_offset", "'a' ends at byte 17"),
    (_first_field(offset=2), "bad_offset", "'a' and 'b' overlap"),
    (_cloud(point_step=0), "bad_offset", "beyond point_step = 0"),
    (_cloud(point_step=14), "bad_offset", "'c' ends at byte 16"),
    (_cloud(row_step=63), "bad_row_step", "row_step = 63"),
    (_cloud(row_step=0), "bad_row_step", "row_step = 0"),
    (_cloud(data=bytes(63)), "short_data", "data has 63 bytes"),
    (_cloud(data=b""), "short_data", "data has 0 bytes"),
    (_cloud(height=2), "short_data", "height .* = 128"),
    (_cloud(height=2**32 - 1, width=2**32 - 1), "bad_row_step", "row_step"),
]


@pytest.mark.parametrize(("spoil", "reason", "sentence"), BAD_FIELDS + BAD_SIZES)
def test_a_malformed_cloud_is_refused_with_its_reason(spoil, reason, sentence):
    fields = [("a", "f"), ("b", "d"), ("c", "f")]
    for points in ([], POINTS) if (spoil, reason, sentence) not in BAD_SIZES else (POINTS,):
        cloud = raw_cloud(fields, points)
        read_fields(cloud, ["a", "b", "c"])  # good before it is spoilt
        spoil(cloud)
        with pytest.raises(MessageError, match=sentence) as error:
            read_fields(cloud, ["a", "b", "c"])
        assert error.value.reason == reason
        assert isinstance(error.value, ValueError)


@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(_first_field(datatype=PointField.UINT8), id="datatype"),
        pytest.param(_first_field(count=33), id="count"),
        pytest.param(_first_field(offset=4000), id="offset"),
        pytest.param(lambda cloud: cloud.fields.append(cloud.fields[0]), id="duplicate"),
    ],
)
def test_a_malformed_field_that_is_not_asked_for_does_no_harm(spoil):
    cloud = raw_cloud([("a", "f"), ("b", "d"), ("c", "f")], POINTS)
    spoil(cloud)
    np.testing.assert_array_equal(read_fields(cloud, ["b"])["b"], [-2.25, 5.5, -8.125, 11.5])


def test_written_cloud_has_the_dtype_s_offsets_in_little_endian_and_zeros_between(
    header, over_the_wire
):
    dtype = np.dtype([("a", "f4"), ("b", "f8"), ("c", "u2"), ("d", "i1")], align=True)
    points = np.array([(1.5, -2.5, 3, -4), (5.5, 6.5, 65535, 8)], dtype)
    cloud = over_the_wire(write_cloud(header, points))
    assert [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields] == [
        ("a", 0, PointField.FLOAT32, 1),
        ("b", 8, PointField.FLOAT64, 1),
        ("c", 16, PointField.UINT16, 1),
        ("d", 18, PointField.INT8, 1),
    ]
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (1, 2, 24, 48)
    assert not cloud.is_bigendian
    assert cloud.is_dense
    assert cloud.header == header
    expected = struct.pack("<f4xdHb5x", 1.5, -2.5, 3, -4)
    expected += struct.pack("<f4xdHb5x", 5.5, 6.5, 65535, 8)
    assert bytes(cloud.data) == expected
    dtype = np.dtype({"names": ["a", "b"], "formats": [">f4", ">u2"], "itemsize": 12})
    points = np.frombuffer(b"\xff" * 12, dtype).copy()
    points["a"], points["b"] = 1.5, 258
    assert bytes(write_cloud(header, points).data) == struct.pack("<fH6x", 1.5, 258)


@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        (np.zeros(3), "structured array"),
        (np.zeros((2, 2), [("a", "f4")]), "one dimension"),
        (np.zeros(2, [("a", "i8")]), "'a' has the type int64"),
        (np.zeros(2, [("a", "f4", (3,))]), "'a' has the type"),
    ],
)
def test_what_a_cloud_cannot_hold_is_not_written(header, points, sentence):
    with pytest.raises(ValueError, match=sentence):
        write_cloud(header, points)


NAMES = ["range", "azimuth", "bearing", "x", "y", "z", "time_offset", "range_std", "intensity", ""]

STEPS = st.one_of(st.integers(0, 64), st.sampled_from([2**16, 2**31, 2**32 - 1]))


@dataclass
class Cloud:
    """A PointCloud2 by its attributes, which may contradict each other."""

    __msgtype__: ClassVar[str] = "sensor_msgs/msg/PointCloud2"
    height: int
    width: int
    fields: list
    is_bigendian: bool
    point_step: int
    row_step: int
    data: bytes
    is_dense: bool = True
    header: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(
            stamp=SimpleNamespace(sec=5, nanosec=0), frame_id="sonar"
        )
    )


fields = st.builds(
    SimpleNamespace,
    name=st.sampled_from(NAMES),
    offset=st.one_of(st.sampled_from([0, 4, 8, 12, 16, 24]), STEPS),
    datatype=st.one_of(st.sampled_from([7, 8]), st.integers(0, 255)),
    count=st.one_of(st.just(1), STEPS),
)

clouds = st.builds(
    Cloud,
    height=st.one_of(st.just(1), STEPS),
    width=STEPS,
    fields=st.lists(fields, max_size=6),
    is_bigendian=st.booleans(),
    point_step=STEPS,
    row_step=STEPS,
    data=st.binary(max_size=400),
)


@st.composite
def fitting(draw):
    """Clouds whose sizes agree, with any bytes as numbers."""
    names = draw(st.lists(st.sampled_from(NAMES[:-1]), min_size=2, max_size=6, unique=True))
    names = [*{"range": 0, "azimuth": 0, **dict.fromkeys(names, 0)}]
    width = draw(st.integers(0, 6))
    made = [
        SimpleNamespace(name=name, offset=8 * i, datatype=8, count=1)
        for i, name in enumerate(names)
    ]
    step = 8 * len(names)
    size = width * step
    data = draw(st.binary(min_size=size, max_size=size))
    return Cloud(1, width, made, draw(st.booleans()), step, size, data)


@hypothesis.settings(max_examples=400, deadline=None, derandomize=True, database=None)
@hypothesis.given(cloud=st.one_of(clouds, fitting()), speed=st.sampled_from([0.0, 1500.0]))
def test_any_cloud_is_read_or_refused(cloud, speed):
    try:
        ping = read_detections(cloud, sound_speed=speed)
    except MessageError as error:
        assert drop_reason_of(error.reason).lost == "scan"
        assert error.reason in DROP_REASONS
        return
    scan = ping.sensor_scan.scan
    assert set(ping.dropped) <= set(DROP_REASONS)
    assert len(scan) + sum(ping.dropped.values()) == cloud.width * cloud.height
    for values in (scan.range, scan.azimuth, scan.range_std, scan.azimuth_std, scan.time_offset):
        assert values is None or np.isfinite(values).all()
    assert (scan.range > 0).all() and (np.abs(scan.azimuth) <= np.pi).all()


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


def test_an_angle_to_starboard_of_z_is_shown_and_read_in_a_frame_with_z_ahead(header):
    cloud = detections_cloud(header, range=[100.0], rx_angle=[0.5], elevation=[0.25])
    level = 100.0 * math.cos(0.25)
    expected = [100.0 * math.sin(0.25), level * math.sin(0.5), level * math.cos(0.5)]
    np.testing.assert_allclose(np.frombuffer(cloud.data, np.float32)[:3], expected, rtol=1e-6)
    empty = detections_cloud(header, range=[], rx_angle=[])
    for message, azimuth in ((cloud, [-0.5]), (empty, [])):
        found = read_detections(message)
        assert found.sensor_scan.axes == "sonar" and found.assumptions[1:] == ()
        assert found.scan.azimuth.tolist() == azimuth


@pytest.mark.parametrize("angle", [{"azimuth": [0.0, 1.0]}, {"bearing": [0.0, -1.0]}], ids=list)
def test_built_cloud_shows_in_rviz(header, angle):
    cloud = detections_cloud(header, range=[100.0, 200.0], **angle)
    fields = [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields[:3]]
    assert fields == [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]  # 7 is FLOAT32
    assert len(cloud.data) == cloud.width * cloud.height * cloud.point_step
    points = np.frombuffer(cloud.data, np.float32).reshape(2, -1)
    expected = [[100.0, 0.0, 0.0], [200.0 * math.cos(1.0), 200.0 * math.sin(1.0), 0.0]]
    np.testing.assert_allclose(points[:, :3], expected, rtol=1e-6)


@pytest.mark.parametrize("written", ["north", None])
def test_a_bearing_that_is_not_known_to_be_from_the_bow_has_no_place_in_the_cloud(header, written):
    cloud = detections_cloud(header, range=[5.0], bearing=[0.25], bearing_reference=written)
    assert [field.name for field in cloud.fields] == ["range", "bearing"]
    assert read_detections(cloud, bearing_reference="north").scan.azimuth[0] == math.pi / 2 - 0.25
    assert read_detections(cloud).scan.azimuth[0] == -0.25


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({}, "exactly one of azimuth, bearing and rx_angle"),
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


RANGE = [1000.5, 2500.25, 7071.0]

ANGLE = [0.25, -2.5, 4.75]


def _rows(*columns):
    return list(zip(*columns, strict=True))


@pytest.mark.parametrize("code", ["f", "d"], ids=["float32", "float64"])
def test_range_and_azimuth_are_read_in_any_order_beside_other_fields(code):
    fields = [("label", "H"), ("azimuth", code), ("z", "f"), ("range", code)]
    found = read_detections(raw_cloud(fields, _rows([1, 2, 3], ANGLE, [9.0] * 3, RANGE)))
    np.testing.assert_array_equal(found.scan.range, RANGE)  # every value is exact in float32
    np.testing.assert_array_equal(found.scan.azimuth, wrap(ANGLE))
    np.testing.assert_array_equal(found.index, [0, 1, 2])
    assert found.scan.range.dtype == found.scan.azimuth.dtype == np.float64
    assert (len(found), found.dropped, found.scan.features) == (3, {}, {})
    assert found.scan.range_std is found.scan.azimuth_std is found.scan.time_offset is None


@pytest.mark.parametrize("reference", ["bow", "north"])
@pytest.mark.parametrize("fields", [("range", "azimuth"), ("x", "y")], ids=["azimuth", "xy"])
def test_only_bearings_are_referenced_to_north(fields, reference):
    cloud = raw_cloud([(name, "d") for name in fields], [(3.0, 0.5)])
    first = read_detections(cloud)
    found = read_detections(cloud, bearing_reference=reference)
    assert not found.sensor_scan.north_referenced
    assert found.scan.azimuth[0] == first.scan.azimuth[0]


@pytest.mark.parametrize("z", [-50.0, 1e30, math.nan, math.inf])
@pytest.mark.filterwarnings("error")
def test_the_horizontal_place_does_not_depend_on_z(z):
    fields = [(name, "f") for name in ("x", "y", "z", "intensity")]
    found = read_detections(raw_cloud(fields, [(3.0, 4.0, z, 7.0)]))
    assert (found.scan.range[0], found.scan.azimuth[0]) == (5.0, math.atan2(4.0, 3.0))
    assert (found.scan.features["intensity"][0], found.dropped) == (7.0, {})
    assert found.sensor_scan.height[0] == (z if abs(z) <= MAX_MAGNITUDE["range"] else 0.0)


def test_z_is_the_height_beside_x_and_y_alone():
    rows = [[VALUES.get(name, 5.0) for name in ("x", "y", "z", "range", "azimuth")]]
    fields = [(name, "d") for name in ("x", "y", "z", "range", "azimuth")]
    assert read_detections(raw_cloud(fields, rows)).sensor_scan.height is None
    assert read_detections(raw_cloud(fields[:3], [rows[0][:3]])).sensor_scan.height[0] == 5.0
    assert read_detections(raw_cloud(fields[:2], [rows[0][:2]])).sensor_scan.height is None


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("elevation", "reason"),
    [
        (math.nan, "elevation_not_finite"),
        (math.inf, "elevation_not_finite"),
        (math.pi / 2, "range_too_small"),
        (2.0, "range_not_positive"),
    ],
)
def test_a_bad_elevation_drops_its_detection(elevation, reason):
    fields = [("range", "d"), ("azimuth", "d"), ("elevation", "d")]
    found = read_detections(raw_cloud(fields, [(9.0, 0.0, 0.0), (9.0, 0.0, elevation)]))
    assert found.dropped == {reason: 1}
    assert (len(found), found.sensor_scan.height.tolist()) == (1, [0.0])


VALUES = {"range": 100.0, "azimuth": 0.5, "bearing": 0.25, "x": 30.0, "y": 40.0}


@pytest.mark.parametrize(
    ("names", "range_", "azimuth"),
    [
        ("x y bearing azimuth range", 100.0, 0.5),
        ("x y bearing range", 100.0, -0.25),
        ("x y range", 50.0, math.atan2(40, 30)),
        ("x y azimuth bearing", 50.0, math.atan2(40, 30)),
    ],
)
def test_the_first_complete_form_of_a_position_is_used(names, range_, azimuth):
    names = names.split()
    cloud = raw_cloud([(name, "d") for name in names], [[VALUES[name] for name in names]])
    found = read_detections(cloud)
    assert found.scan.range[0] == pytest.approx(range_, rel=1e-15)
    assert found.scan.azimuth[0] == pytest.approx(azimuth, rel=1e-15)


@pytest.mark.parametrize("code", ["B", "H"], ids=["uint8", "uint16"])
def test_intensity_may_be_an_integer(code):
    fields = [("x", "f"), ("y", "f"), ("intensity", code)]
    found = read_detections(raw_cloud(fields, [(1.0, 1.0, 200)]))
    np.testing.assert_array_equal(found.scan.features["intensity"], [200.0])


FIELDS = ("range", "azimuth", "range_std", "azimuth_std", "time_offset", "intensity")

GOOD = (1000.0, 0.5, 10.0, 0.02, 0.5, 3.0)


def _with(**values):
    return [values.get(name, good) for name, good in zip(FIELDS, GOOD, strict=True)]


BAD_DETECTIONS = [
    ("range_not_finite", "range", NAN),
    ("range_not_finite", "range", INF),
    ("range_not_finite", "range", -INF),
    ("range_not_positive", "range", 0.0),
    ("range_not_positive", "range", -5.0),
    ("azimuth_not_finite", "azimuth", NAN),
    ("azimuth_not_finite", "azimuth", INF),
    ("azimuth_not_finite", "azimuth", -INF),
    *(
        (f"{name}_not_positive", name, value)
        for name in ("range_std", "azimuth_std")
        for value in (0.0, -1.0, NAN, INF)
    ),
    ("time_offset_not_finite", "time_offset", NAN),
    ("time_offset_not_finite", "time_offset", -INF),
    *(
        (f"{name}_too_large", name, 2.0 * MAX_MAGNITUDE[name])
        for name in FIELDS
        if name in MAX_MAGNITUDE
    ),
]


@pytest.mark.parametrize("code", ["f", "d"], ids=["float32", "float64"])
@pytest.mark.parametrize(
    ("reason", "name", "value"),
    [pytest.param(*case, id=f"{case[1]}={case[2]}") for case in BAD_DETECTIONS],
)
@pytest.mark.filterwarnings("error")
def test_a_bad_detection_is_dropped_and_counted_and_the_rest_kept(reason, name, value, code):
    rows = [_with(range=100.0), _with(**{name: value}), _with(range=300.0)]
    found = read_detections(raw_cloud([(field, code) for field in FIELDS], rows))
    assert found.dropped == {reason: 1}
    np.testing.assert_array_equal(found.scan.range, [100.0, 300.0])
    np.testing.assert_array_equal(found.index, [0, 2])
    for array in (
        found.scan.azimuth,
        found.scan.range_std,
        found.scan.azimuth_std,
        found.scan.time_offset,
    ):
        assert len(array) == 2
    assert len(found.scan.features["intensity"]) == 2


def test_a_detection_counts_once_under_its_first_reason():
    rows = [
        _with(range=NAN, azimuth=NAN, range_std=-1.0),
        _with(range=-1.0, azimuth=NAN),
        _with(azimuth=NAN, range_std=0.0),
        _with(range_std=0.0, azimuth_std=0.0),
        _with(azimuth_std=0.0, time_offset=NAN),
        _with(time_offset=NAN),
        _with(time_offset=INF),
    ]
    found = read_detections(raw_cloud([(name, "d") for name in FIELDS], rows))
    assert found.dropped == {
        "range_not_finite": 1,
        "range_not_positive": 1,
        "azimuth_not_finite": 1,
        "range_std_not_positive": 1,
        "azimuth_std_not_positive": 1,
        "time_offset_not_finite": 2,
    }
    assert len(found) == 0


@pytest.mark.parametrize("value", [NAN, INF])
@pytest.mark.parametrize("name", ["intensity", "range_width", "azimuth_width", "range_rate"])
def test_a_feature_that_is_not_finite_drops_nothing(name, value):
    cloud = raw_cloud([("range", "f"), ("azimuth", "f"), (name, "f")], [(1.0, 1.0, value)])
    found = read_detections(cloud)
    assert found.dropped == {}
    np.testing.assert_array_equal(found.scan.features[name], [value])


@pytest.mark.parametrize(
    ("x", "y", "reason"),
    [
        (0.0, 0.0, "range_not_positive"),
        (NAN, 1.0, "range_not_finite"),
        (1.0, -INF, "range_not_finite"),
        (NAN, INF, "range_not_finite"),
        (1.7e308, 1.7e308, "range_not_finite"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_bad_x_or_y_is_a_bad_range(x, y, reason):
    found = read_detections(raw_cloud([("x", "d"), ("y", "d")], [(x, y), (3.0, 4.0)]))
    assert found.dropped == {reason: 1}
    np.testing.assert_array_equal(found.scan.range, [5.0])


@pytest.mark.parametrize("points", [0, 1], ids=["empty", "one-point"])
@pytest.mark.parametrize("names", ["range", "azimuth bearing", "range x", "x z", "y"])
def test_a_cloud_without_a_complete_position_is_refused(names, points):
    names = names.split()
    cloud = raw_cloud([(name, "f") for name in names], [[1.0] * len(names)] * points)
    with pytest.raises(MessageError, match="'range' and 'azimuth', or") as error:
        read_detections(cloud)
    assert error.value.reason == "missing_field"


@pytest.mark.parametrize(
    "name", ["range", "azimuth", "range_std", "azimuth_std", "time_offset", "range_rate"]
)
def test_an_integer_where_the_unit_matters_is_refused(name):
    names = list(dict.fromkeys(["range", "azimuth", name]))
    cloud = raw_cloud(
        [(field, "i" if field == name else "f") for field in names], [[1] * len(names)]
    )
    with pytest.raises(MessageError, match=f"'{name}' must be FLOAT32 or FLOAT64") as error:
        read_detections(cloud)
    assert error.value.reason == "wrong_datatype"


TRAVEL = [("range", "d"), ("azimuth", "d"), ("two_way_travel_time", "d")]


@pytest.mark.parametrize(
    ("names", "times", "expected"),
    [
        (["time_offset"], [(0.25,), (0.0,)], [0.25, 0.0]),
        (["two_way_travel_time"], [(2.5,), (0.0,)], [1.25, 0.0]),  # the half of it counts
        (["two_way_travel_time", "time_offset"], [(2.5, 1.25), (4.0, NAN)], [1.25]),
    ],
    ids=str,
)
def test_times_of_the_message_count_whatever_the_sound_speed_is(names, times, expected):
    fields = [(name, "d") for name in ("range", "azimuth", *names)]
    cloud = raw_cloud(fields, [(1500.0 * (k + 1), 0.1, *one) for k, one in enumerate(times)])
    found = read_detections(cloud, sound_speed=1000.0)
    np.testing.assert_array_equal(found.scan.time_offset, expected)
    assert found.dropped == ({"time_offset_not_finite": 1} if len(expected) == 1 else {})
    assert found.assumptions == read_detections(cloud).assumptions == ()


def test_both_times_tell_when_a_bearing_was_sent():
    fields = [*TRAVEL, ("time_offset", "d")]
    cloud = raw_cloud(fields, [(1500.0, 0.1, 2.0, 4.0), (1500.0, 0.2, NAN, 5.0)])
    found = read_detections(cloud)
    np.testing.assert_array_equal(found.sensor_scan.transmit_offset, [3.0])
    assert found.dropped == {"transmit_offset_not_finite": 1}


@pytest.mark.parametrize(
    ("value", "reason"),
    [(NAN, "not_finite"), (INF, "not_finite"), (2.1 * MAX_MAGNITUDE["time_offset"], "too_large")],
)
def test_a_bad_two_way_travel_time_is_counted_as_a_time_offset(value, reason):
    found = read_detections(raw_cloud(TRAVEL, [(1500.0, 0.1, value), (3000.0, 0.2, 4.0)]))
    assert found.dropped == {f"time_offset_{reason}": 1}
    np.testing.assert_array_equal(found.scan.time_offset, [2.0])


@pytest.mark.parametrize("speed", [-1.0, math.nan, math.inf])
def test_a_sound_speed_that_is_none_is_refused(speed):
    with pytest.raises(ValueError, match="sound_speed must be"):
        read_detections(raw_cloud([("range", "f"), ("azimuth", "f")], []), sound_speed=speed)


def test_an_echo_time_from_the_sound_speed_is_checked_like_one_of_the_message():
    fields = [(name, "d") for name in ("x", "y", "z")]
    rows = [(3.0, 4.0, 0.0), (1e8, 0.0, 1e8)]
    found = read_detections(raw_cloud(fields, rows), sound_speed=100.0)
    assert found.dropped == {"time_offset_too_large": 1}
    np.testing.assert_array_equal(found.scan.time_offset, [0.05])
