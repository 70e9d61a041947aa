"""The layouts of the track cloud and of placed detections, byte by byte, and their inverses."""

import math
import struct

import numpy as np
import pytest
from support.raw_cloud import DATATYPES, raw_cloud

from msg_adapters import (
    MessageError,
    PlacedDetections,
    placed_detections_cloud,
    read_placed_detections,
    read_track_cloud,
    track_cloud,
    tracker_report,
)
from msg_adapters.track_messages import track_arrays
from tsepm_ros.tracker.scan import FEATURES

LAYOUT = [
    *(("x", 0, "f"), ("y", 4, "f"), ("z", 8, "f"), ("track_id", 12, "I")),
    *(("state_x", 16, "d"), ("state_vx", 24, "d"), ("state_y", 32, "d"), ("state_vy", 40, "d")),
    *((f"cov_{place // 4}{place % 4}", 48 + 8 * place, "d") for place in range(16)),
    *(("evaluation", 176, "d"), ("score", 184, "d"), ("hit_count", 192, "H")),
    *(("scan_count", 194, "H"), ("age", 200, "d"), ("stationary_probability", 208, "d")),
    *(("signal_to_clutter_db", 216, "d"), ("revision", 224, "H")),
    *(("existence_probability", 232, "d"), ("time_since_hit", 240, "d")),
]
POINT_STEP = 248
UNSYMMETRIC = np.arange(16.0).reshape(4, 4) + 0.125
"""No covariance, but it shows rows and columns that were exchanged."""


def test_fields_and_bytes_stand_at_the_offsets_of_the_contract(header, make_track, over_the_wire):
    tracks = [
        make_track(
            covariance=UNSYMMETRIC,
            stationary_probability=0.25,
            signal_to_clutter_db=7.5,
            revision=2,
            existence_probability=0.75,
            time_since_hit=3.5,
        ),
        make_track(track_id=2**32 - 1, score=math.nan),
    ]
    cloud = over_the_wire(track_cloud(header, tracks))
    assert [(field.name, field.offset, field.datatype, field.count) for field in cloud.fields] == [
        (name, offset, DATATYPES[code], 1) for name, offset, code in LAYOUT
    ]
    assert all(offset % struct.calcsize(code) == 0 for _, offset, code in LAYOUT)
    assert (cloud.point_step, cloud.row_step) == (POINT_STEP, 2 * POINT_STEP)
    assert (cloud.height, cloud.width, cloud.is_bigendian) == (1, 2, False)
    assert track_cloud(header, tracks[:1]).is_dense and not cloud.is_dense  # no score is nan
    data = bytes(cloud.data)
    assert len(data) == 2 * POINT_STEP
    for start, track in zip((0, POINT_STEP), tracks, strict=True):
        found = [
            struct.unpack_from("<" + code, data, start + offset)[0] for _, offset, code in LAYOUT
        ]
        expected = [track.state[0], track.state[2], 0.0, track.track_id, *track.state]
        expected += [*track.covariance.ravel(), track.evaluation, track.score, 5, 7, 72.0]
        expected += [track.stationary_probability, track.signal_to_clutter_db, track.revision]
        expected += [track.existence_probability, track.time_since_hit]
        np.testing.assert_array_equal(found, expected)
        assert data[start + 196 : start + 200] == bytes(4)
        assert data[start + 226 : start + 232] == bytes(6)


EARLIER = {
    "stationary_probability": math.nan,
    "signal_to_clutter_db": math.nan,
    "revision": 0,
    "existence_probability": math.nan,
    "time_since_hit": 0.0,
}


@pytest.mark.parametrize(("field", "given"), EARLIER.items())
def test_a_cloud_of_an_earlier_version_lacks_a_field(field, given):
    names = [(name, code) for name, _, code in LAYOUT if name != field]
    rows = [[float(value) if code in "fd" else value for _, code in names] for value in (1, 2)]
    records = read_track_cloud(raw_cloud(names, rows))
    assert records["age"].tolist() == [1.0, 2.0]
    np.testing.assert_array_equal(records[field], given)
    np.testing.assert_array_equal(getattr(track_arrays(records, 0.0), field), given)


@pytest.mark.parametrize(
    ("count", "written"), [(65534, 65534), (65535, 65535), (65536, 65535), (10**6, 65535)]
)
def test_counts_saturate(header, make_track, count, written):
    track = make_track(hits=((0, 0),) * count, scan_count=count)
    records = read_track_cloud(track_cloud(header, [track]))
    assert (records["hit_count"][0], records["scan_count"][0]) == (written, written)


@pytest.mark.parametrize("track_id", [-1, 2**32])
def test_an_id_that_does_not_fit_is_refused(header, make_track, track_id):
    with pytest.raises(ValueError, match=f"track_id must be from 0 to .*; got {track_id}"):
        track_cloud(header, [make_track(track_id=track_id)])


@pytest.mark.parametrize("name", ["x", "track_id", "cov_12", "age"])
def test_a_cloud_that_lacks_a_field_is_refused(header, make_track, name):
    cloud = track_cloud(header, [make_track()])
    cloud.fields = [field for field in cloud.fields if field.name != name]
    with pytest.raises(MessageError, match=f"'{name}' is missing") as error:
        read_track_cloud(cloud)
    assert error.value.reason == "missing_field"


@pytest.mark.parametrize("track_id", [-1.0, 0.5, 2.0**32, math.nan, math.inf])
def test_a_number_that_is_no_id_is_refused(track_id):
    names = [(name, "d" if name == "track_id" else code) for name, _, code in LAYOUT]
    row = [track_id if name == "track_id" else 0 for name, _ in names]
    with pytest.raises(MessageError, match="track_id must be an integer") as error:
        read_track_cloud(raw_cloud(names, [row]))
    assert error.value.reason == "bad_id"


def test_a_tracker_s_report_has_what_the_cloud_has(header, make_track, over_the_wire):
    tracks = [make_track(), make_track(track_id=2**32 - 1, state=np.arange(4.0), hits=())]
    report = tracker_report(over_the_wire(track_cloud(header, tracks)))
    assert (report.frame_id, report.stamp) == ("map", 1_700_000_000.123456789)
    assert report.tracks.track_id.tolist() == [7, 2**32 - 1]
    assert report.tracks.hit_count.tolist() == [5, 0]
    for found, track in zip(report.tracks, tracks, strict=True):
        assert found.stamp == report.stamp
        np.testing.assert_array_equal(found.state, track.state)
        np.testing.assert_array_equal(found.covariance, track.covariance)
        assert (found.evaluation, found.score, found.age) == (1.25, 6.5, 72.0)


@pytest.mark.parametrize("age", [1e300, -1e300, math.inf])
def test_an_age_that_overflows_is_bounded(header, make_track, age):
    report = tracker_report(track_cloud(header, [make_track(age=age)]))
    assert 0.0 <= report.tracks.age[0] <= 1e9


def test_a_report_in_a_ned_frame_is_read_in_east_and_north(header, make_track):
    header.frame_id = "/map_ned"
    report = tracker_report(track_cloud(header, [make_track(state=np.arange(4.0))]))
    assert (report.frame_id, report.tracks.state.tolist()) == ("map_ned", [[2.0, 3.0, 0.0, 1.0]])


PLACED_LAYOUT = [
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
PLACED_STEP = 64
FAR = 4_200_000.1
"""A northing, m, of which float32 keeps a quarter of a metre."""
PLACED = PlacedDetections(
    position=np.array([[1.0, FAR], [-3.5, 4.25]]),
    covariance=np.array([[[900.0, -30.5], [-30.5, 400.25]], [[1.0, 0.5], [0.5, 2.0]]]),
    time_offset=np.array([0.1, 11.9]),
    features={"intensity": np.array([5.0, np.nan]), "range_rate": np.array([1e300, -2.0])},
)
NOTHING = PlacedDetections(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))


def test_fields_and_bytes_of_placed_detections_stand_at_the_offsets_of_the_contract(
    header, over_the_wire
):
    cloud = over_the_wire(placed_detections_cloud(header, PLACED))
    features = [("intensity", 64, "f"), ("range_rate", 68, "f")]
    assert [(field.name, field.offset, field.datatype, field.count) for field in cloud.fields] == [
        (name, offset, DATATYPES[code], 1) for name, offset, code in PLACED_LAYOUT + features
    ]
    assert (cloud.header, cloud.point_step, cloud.width) == (header, PLACED_STEP + 8, 2)
    for row, start in enumerate((0, cloud.point_step)):
        found = [
            struct.unpack_from("<" + code, bytes(cloud.data), start + offset)[0]
            for _, offset, code in PLACED_LAYOUT
        ]
        x, y = PLACED.position[row]
        (xx, xy), (_, yy) = PLACED.covariance[row]
        expected = [np.float32(x), np.float32(y), 0.0, x, y, xx, xy, yy, PLACED.time_offset[row]]
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("number", range(len(FEATURES) + 1))
def test_every_float64_of_every_point_is_aligned(header, number):
    features = {name: np.zeros(2) for name in FEATURES[:number]}
    placed = PlacedDetections(PLACED.position, PLACED.covariance, PLACED.time_offset, features)
    assert placed_detections_cloud(header, placed).point_step % 8 == 0


def test_reading_placed_detections_is_the_exact_inverse(header, over_the_wire):
    found = read_placed_detections(over_the_wire(placed_detections_cloud(header, PLACED)))
    np.testing.assert_array_equal(found.position, PLACED.position)
    np.testing.assert_array_equal(found.covariance, PLACED.covariance)
    np.testing.assert_array_equal(found.time_offset, PLACED.time_offset)
    assert list(found.features) == ["intensity", "range_rate"]
    np.testing.assert_array_equal(found.features["intensity"], [5.0, np.nan])
    np.testing.assert_array_equal(found.features["range_rate"], [np.inf, -2.0])


def test_a_ping_without_detections_is_an_empty_cloud_with_all_fields(header, over_the_wire):
    cloud = over_the_wire(placed_detections_cloud(header, NOTHING))
    assert (cloud.width, cloud.point_step) == (0, PLACED_STEP)
    assert [field.name for field in cloud.fields] == [name for name, _, _ in PLACED_LAYOUT]
    found = read_placed_detections(cloud)
    assert (found.position.shape, found.covariance.shape) == ((0, 2), (0, 2, 2))
