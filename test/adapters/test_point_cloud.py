"""Reading and writing PointCloud2 in every layout, and clouds of any layout and content."""

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

from msg_adapters import MessageError, read_detections, read_fields, write_cloud
from tsepm_ros.session.drop_reasons import DROP_REASONS, reason_of

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
        assert reason_of(error.reason).lost == "scan"
        assert error.reason in DROP_REASONS
        return
    scan = ping.sensor_scan.scan
    assert set(ping.dropped) <= set(DROP_REASONS)
    assert len(scan) + sum(ping.dropped.values()) == cloud.width * cloud.height
    for values in (scan.range, scan.azimuth, scan.range_std, scan.azimuth_std, scan.time_offset):
        assert values is None or np.isfinite(values).all()
    assert (scan.range > 0).all() and (np.abs(scan.azimuth) <= np.pi).all()
