"""Detections in PointCloud2, written and read: every form and bad one, and times of echoes."""

import math

import numpy as np
import pytest
from support.raw_cloud import raw_cloud

from msg_adapters import MessageError, detections_cloud, read_detections
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, wrap

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


@pytest.mark.parametrize("written", ["north", None])
def test_a_bearing_that_is_not_known_to_be_from_the_bow_has_no_place_in_the_cloud(header, written):
    cloud = detections_cloud(header, range=[5.0], bearing=[0.25], bearing_reference=written)
    assert [field.name for field in cloud.fields] == ["range", "bearing"]
    assert read_detections(cloud, bearing_reference="north").scan.azimuth[0] == math.pi / 2 - 0.25
    assert read_detections(cloud).scan.azimuth[0] == -0.25


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
