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
"""Tracks in messages: layouts of clouds byte by byte, markers, and other stacks' types."""

import math
import struct
import uuid
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from support import foreign_messages
from support.raw_cloud import DATATYPES, raw_cloud
from visualization_msgs.msg import Marker

from msg_adapters import (
    MessageError,
    PlacedDetections,
    fixed_echo_markers,
    make_header,
    placed_detections_cloud,
    potential_track_markers,
    read_placed_detections,
    read_track_cloud,
    track_cloud,
    track_markers,
    tracker_report,
)
from msg_adapters.nav_messages import UNOBSERVED_VARIANCE
from msg_adapters.track_messages import (
    MAX_LABELS,
    POTENTIAL_COLORS,
    marker_sizes,
    radar_tracks,
    track_arrays,
    track_uuid,
    tracked_objects,
)
from tsepm_ros.tracker.scan import FEATURES
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays, TrackStatus

LAYOUT = [
    *(("x", 0, "f"), ("y", 4, "f"), ("z", 8, "f"), ("track_id", 12, "I")),
    *(("state_x", 16, "d"), ("state_vx", 24, "d"), ("state_y", 32, "d"), ("state_vy", 40, "d")),
    *((f"cov_{place // 4}{place % 4}", 48 + 8 * place, "d") for place in range(16)),
    *(("evaluation", 176, "d"), ("score", 184, "d"), ("hit_count", 192, "H")),
    *(("scan_count", 194, "H"), ("age", 200, "d"), ("stationary_probability", 208, "d")),
    *(("signal_to_clutter_db", 216, "d"), ("revision", 224, "H")),
    *(("existence_probability", 232, "d"), ("time_since_hit", 240, "d"), ("status", 248, "B")),
]

POINT_STEP = 256

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
            status=TrackStatus.COASTING,
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
        expected += [track.existence_probability, track.time_since_hit, track.status]
        np.testing.assert_array_equal(found, expected)
        assert data[start + 196 : start + 200] == bytes(4)
        assert data[start + 226 : start + 232] == bytes(6)
        assert data[start + 249 : start + 256] == bytes(7)


def test_of_several_sensors_a_field_at_the_end_says_which_saw_each_track(header, make_track):
    tracks = [make_track(), make_track(track_id=2)]
    plain, seen = track_cloud(header, tracks), track_cloud(header, tracks, np.array([5, 2**31]))
    *others, last = [(field.name, field.offset, field.datatype) for field in seen.fields]
    assert others == [(field.name, field.offset, field.datatype) for field in plain.fields]
    assert last == ("seen_by", 252, DATATYPES["I"]) and seen.point_step == POINT_STEP
    data, expected = bytearray(seen.data), [5, 2**31]
    for start in (0, POINT_STEP):
        assert struct.unpack_from("<I", data, start + 252)[0] == expected.pop(0)
        data[start + 252 : start + 256] = bytes(4)
    assert bytes(data) == bytes(plain.data), "all else is as without"
    assert read_track_cloud(seen).tobytes() == read_track_cloud(plain).tobytes()
    assert track_cloud(header, [], np.zeros(0)).fields == seen.fields


EARLIER = {
    "stationary_probability": math.nan,
    "signal_to_clutter_db": math.nan,
    "revision": 0,
    "existence_probability": math.nan,
    "time_since_hit": 0.0,
    "status": TrackStatus.CONFIRMED,
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


def test_of_several_sensors_the_last_field_of_placed_detections_names_the_sensor(header):
    plain = placed_detections_cloud(header, PLACED)
    named = placed_detections_cloud(header, replace(PLACED, sensor=2))
    *others, last = [(field.name, field.offset, field.datatype) for field in named.fields]
    assert others == [(field.name, field.offset, field.datatype) for field in plain.fields]
    assert last == ("sensor", 72, DATATYPES["B"])
    assert [bytes(named.data)[row * named.point_step + 72] for row in (0, 1)] == [2, 2]
    assert list(read_placed_detections(named).features) == [*PLACED.features]


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


def _covariance(position):
    covariance = np.zeros((4, 4))
    covariance[np.ix_([0, 2], [0, 2])] = position
    return covariance


def _by_kind(message):
    return {marker.ns: marker for marker in message.markers}


@pytest.mark.parametrize("track_id", [2**31 - 1, 2**31, 2**32 - 1])
def test_ids_beyond_a_marker_s_stay_apart_and_pass(header, make_track, over_the_wire, track_id):
    tracks = [make_track(track_id=track_id), make_track(track_id=0)]
    message = track_markers(header, tracks)
    ids = {marker.id for marker in message.markers}
    assert len(ids) == 2
    assert all(-(2**31) <= marker_id < 2**31 for marker_id in ids)
    assert {marker.id for marker in over_the_wire(message).markers} == ids


def _ellipse_of(header, make_track, position):
    track = make_track(covariance=_covariance(position))
    return _by_kind(track_markers(header, [track]))["ellipse"]


@pytest.mark.parametrize("degrees", [0.0, 30.0, 45.0, 90.0, 135.0, 170.0])
def test_ellipse_has_the_axes_of_the_covariance(header, make_track, degrees):
    turn = math.radians(degrees)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    covariance = rotation @ np.diag([120.0**2, 40.0**2]) @ rotation.T
    marker = _ellipse_of(header, make_track, covariance)
    variances, vectors = np.linalg.eigh(covariance)
    diameters = 2 * np.sqrt(chi2.ppf(0.95, 2) * variances)
    assert (marker.scale.y, marker.scale.x) == pytest.approx(tuple(diameters), rel=1e-9)
    angle = 2 * math.atan2(marker.pose.orientation.z, marker.pose.orientation.w)
    along = abs(vectors[:, 1] @ [math.cos(angle), math.sin(angle)])
    assert along == pytest.approx(1.0, abs=1e-12)
    assert (marker.pose.orientation.x, marker.pose.orientation.y) == (0.0, 0.0)


@pytest.mark.parametrize(
    "covariance",
    [
        pytest.param(np.zeros((2, 2)), id="zero"),
        pytest.param([[1.0, 1.0], [1.0, 1.0]], id="line"),
        pytest.param(np.outer([0.1, 1.5], [0.1, 1.5]), id="below-zero-by-rounding"),
    ],
)
def test_a_degenerate_ellipse_has_no_scale_of_zero(header, make_track, covariance):
    scale = _ellipse_of(header, make_track, covariance).scale
    assert min(scale.x, scale.y, scale.z) > 0


def test_the_ellipse_of_a_track_that_was_missed_is_dashed_and_its_markers_are_fainter(
    header, make_track, over_the_wire
):
    covariance = _covariance([[5.0, 4.0], [4.0, 5.0]])  # variances 9 and 1 at 45 degrees
    seen, missed = (
        _by_kind(over_the_wire(track_markers(header, [track])))
        for track in (make_track(covariance=covariance, time_since_hit=t) for t in (0.0, 0.1))
    )
    dashes = missed["ellipse"]
    assert (seen["ellipse"].type, dashes.type) == (Marker.CYLINDER, Marker.LINE_LIST)
    assert dashes.pose == seen["ellipse"].pose and dashes.scale.x > 0
    points = np.array([[point.x, point.y] for point in dashes.points])
    semi_axes = math.sqrt(chi2.ppf(0.95, 2)) * np.array([3.0, 1.0])
    np.testing.assert_allclose(np.hypot(*(points / semi_axes).T), 1.0)
    turns = np.unwrap(np.arctan2(*(points / semi_axes).T[::-1])).reshape(-1, 2)
    np.testing.assert_allclose(turns[1:, 0] - turns[:-1, 1], np.diff(turns[:-1], axis=1)[:, 0])
    for kind in ("position", "velocity", "label"):
        assert missed[kind].color.a < seen[kind].color.a


def test_markers_of_a_track_that_coasts_are_faintest_and_say_so_whenever_it_was_detected(
    header, make_track, over_the_wire
):
    vague = {"status": TrackStatus.COASTING, "existence_probability": 0.034}
    missed, *coasting = (
        _by_kind(over_the_wire(track_markers(header, [make_track(time_since_hit=t, **more)])))
        for t, more in ((0.1, {}), (0.1, vague), (0.0, vague))
    )
    for shown in coasting:
        assert shown["ellipse"].type == Marker.LINE_LIST
        assert shown["label"].text.endswith(", coasting, exists 3%")
        assert all(shown[kind].color.a < missed[kind].color.a for kind in shown)
    assert "coasting" not in missed["label"].text


def test_arrow_leads_where_the_velocity_takes_the_track(header, make_track):
    arrow = _by_kind(track_markers(header, [make_track()], lead_time=100.0))["velocity"]
    assert [(point.x, point.y) for point in arrow.points] == [(3000.25, 4000.5), (2550.25, 4225.5)]


@pytest.mark.parametrize(
    ("sigma", "size"),
    [pytest.param(300.0, 300.0, id="follows-sigma"), pytest.param(3.0, 50.0, id="minimum")],
)
def test_sizes_follow_sigma_down_to_a_minimum(header, make_track, sigma, size):
    track = make_track(covariance=_covariance(np.diag([sigma**2, 1.0])))
    shown = _by_kind(track_markers(header, [track], minimum_size=50.0))
    scale = shown["position"].scale
    assert (scale.x, scale.y, scale.z) == pytest.approx((size, size, size))
    assert shown["label"].scale.z == pytest.approx(3 * size)
    assert shown["velocity"].scale.x == pytest.approx(0.3 * size)
    # The ellipse says what is known: no minimum there.
    assert shown["ellipse"].scale.x == pytest.approx(2 * math.sqrt(chi2.ppf(0.95, 2)) * sigma)


@pytest.mark.parametrize(("reach", "max_speed"), [(10.0, 1.0), (9000.0, 15.0)])
def test_markers_are_a_share_of_the_sensor_s_reach(header, make_track, reach, max_speed):
    track = make_track(state=np.array([0.0, max_speed, 0.0, 0.0]), covariance=np.zeros((4, 4)))
    sizes = marker_sizes(reach, max_speed)
    shown = _by_kind(track_markers(header, [track], **sizes))
    assert shown["position"].scale.x == pytest.approx(reach / 100)
    assert shown["velocity"].points[1].x == pytest.approx(reach / 10)
    _, points, lines = potential_track_markers(header, [track], **sizes).markers
    assert points.scale.x == pytest.approx(reach / 100)
    assert lines.points[1].x == pytest.approx(reach / 10)
    size = sizes["minimum_size"]
    _, cubes, label = fixed_echo_markers(header, [track], minimum_size=size).markers
    assert (cubes.scale.x, label.scale.z) == pytest.approx((reach / 100, reach / 100))


@pytest.mark.parametrize(
    ("speed", "sigma", "label"),
    [
        (5.0, 124.0, "5.0 m/s, sigma 124 m"),
        (0.052, 0.0123, "0.052 m/s, sigma 0.012 m"),
        (12.34, 3.41, "12.3 m/s, sigma 3.4 m"),
        (0.0, 0.0, "0.000 m/s, sigma 0.000 m"),
    ],
)
def test_label_has_id_speed_sigma_along_the_major_axis_and_revision(
    header, make_track, speed, sigma, label
):
    covariance = _covariance(np.diag([sigma**2 / 64.0, sigma**2]))
    track = make_track(state=np.array([0.0, speed, 0.0, 0.0]), covariance=covariance)
    for revision, end in ((0, ""), (2, ", revision 2")):
        message = track_markers(header, [replace(track, revision=revision)])
        assert _by_kind(message)["label"].text == f"7: {label}{end}"


def _potential(header, make_track, scores, threshold, newest=None):
    """Markers of potential tracks whose newest hits are all different, or given."""
    tracks = [
        make_track(score=score, evaluation=score - threshold, hits=((0, 3), (1, hit)))
        for score, hit in zip(scores, newest or range(len(scores)), strict=True)
    ]
    return potential_track_markers(header, tracks).markers


def test_potential_tracks_are_points_and_lines_of_the_score_s_colour_that_lead_on(
    header, make_track, over_the_wire
):
    one = make_track(score=9.0, evaluation=-1.0, hits=((0, 3), (1, 0)))
    two = make_track(score=8.0, evaluation=-2.0, state=np.array([1.0, 2.0, 3.0, 4.0]))
    tracks = [two, one]
    message = over_the_wire(potential_track_markers(header, tracks, lead_time=10.0))
    clear, positions, velocities = message.markers
    assert clear.action == Marker.DELETEALL
    assert (positions.type, velocities.type) == (Marker.POINTS, Marker.LINE_LIST)
    assert [(point.x, point.y) for point in positions.points] == [(3000.25, 4000.5), (1.0, 3.0)]
    ends = [(point.x, point.y) for point in velocities.points]
    assert ends == [(3000.25, 4000.5), (2955.25, 4023.0), (1.0, 3.0), (21.0, 43.0)]
    assert [len(marker.colors) for marker in (positions, velocities)] == [2, 4]
    assert all(one.header == header for one in message.markers)
    assert min(positions.scale.x, positions.scale.y, velocities.scale.x) > 0
    _, positions, velocities = _potential(header, make_track, [12.0, 10.0, 5.0, 1e-9], 10.0)
    bare, full = np.array(POTENTIAL_COLORS)
    expected = [full, full, (bare + full) / 2, bare]
    found = [(color.r, color.g, color.b) for color in positions.colors]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert [color.a for color in velocities.colors[::2]] == [c.a for c in positions.colors]


def test_the_evidence_of_those_with_one_newest_hit_is_summed_and_the_best_is_drawn(
    header, make_track
):
    scores = [2.0, 2.0 - math.log(2.0), 2.0 - math.log(2.0), -1.0, -1.0]
    places = [make_track(score=score, evaluation=score - 10.0) for score in scores]
    tracks = [
        replace(track, hits=((0, index), (4, hit)), state=np.array([index, 0.0, 0.0, 0.0]))
        for index, (track, hit) in enumerate(zip(places, [5, 5, 5, 6, 7], strict=True))
    ]
    _, positions, _ = potential_track_markers(header, tracks).markers
    assert [point.x for point in positions.points] == [0.0]
    bare, full = np.array(POTENTIAL_COLORS)
    color = positions.colors[0]
    nearness = (2.0 + math.log(2.0)) / 10.0  # ln(e^2 + 2 e^2 / 2)
    np.testing.assert_allclose((color.r, color.g, color.b), bare + nearness * (full - bare), 1e-6)


def test_two_that_are_less_likely_than_clutter_may_be_a_target_together(header, make_track):
    assert len(_potential(header, make_track, [-0.5, -0.5], 10.0, newest=[4, 4])) == 3
    assert len(_potential(header, make_track, [-0.5, -0.5], 10.0)) == 1


def test_of_very_many_those_nearest_to_the_threshold_are_drawn(header, make_track):
    tracks = [
        make_track(
            score=score,
            evaluation=score - 2000.0,
            state=np.array([score, 0.0, 0.0, 0.0]),
            hits=((0, 0), (1, int(score))),
        )
        for score in np.arange(1.0, 1200.0)
    ]
    _, positions, _ = potential_track_markers(header, tracks).markers
    assert {point.x for point in positions.points} == set(np.arange(200.0, 1200.0))


@pytest.mark.parametrize("threshold", [math.nan, math.inf], ids=["no-score", "not-known-yet"])
def test_without_a_score_or_a_threshold_the_colour_is_the_bare_one(header, make_track, threshold):
    score = math.nan if math.isnan(threshold) else 3.0
    _, positions, _ = _potential(header, make_track, [score] * 3, threshold, newest=[1, 1, 1])
    assert len(positions.points) == (3 if math.isnan(score) else 1), "without scores all are drawn"
    color = positions.colors[0]
    np.testing.assert_allclose((color.r, color.g, color.b), POTENTIAL_COLORS[0], atol=1e-6)


def test_each_echo_has_a_cube_and_of_very_many_the_oldest_a_label_with_minutes(
    header, make_track, over_the_wire
):
    echoes = [
        make_track(state=np.array([10.0, 0.0, -20.0, 0.0]), age=90.0),
        make_track(track_id=2**32 - 1, state=np.array([5.0, 0.0, 7.0, 0.0]), age=600.0),
    ]
    _, cubes, *labels = over_the_wire(fixed_echo_markers(header, echoes)).markers
    assert (cubes.type, cubes.action, cubes.header) == (Marker.CUBE_LIST, Marker.ADD, header)
    assert [(point.x, point.y) for point in cubes.points] == [(10.0, -20.0), (5.0, 7.0)]
    assert min(cubes.scale.x, cubes.scale.y, cubes.scale.z, cubes.color.a) > 0.0
    assert [label.text for label in labels] == [f"{2**32 - 1}: 10.0 min", "7: 1.5 min"]
    assert [label.pose.position.x for label in labels] == [5.0, 10.0]
    names = [(marker.ns, marker.id) for marker in (cubes, *labels)]
    assert len(set(names)) == len(names)
    echoes = [make_track(track_id=number, age=float(number)) for number in range(MAX_LABELS + 5)]
    _, cubes, *labels = fixed_echo_markers(header, echoes).markers
    assert len(cubes.points) == MAX_LABELS + 5
    assert len(labels) == MAX_LABELS
    assert labels[0].text.startswith(f"{MAX_LABELS + 4}:")


INSTANCE = uuid.UUID(int=7)

HEADER = make_header(1_700_000_000_000_000_000, "odom")

SPREAD = np.array(
    [[4.0, 0.5, 1.0, 0.1], [0.5, 0.3, 0.2, 0.05], [1.0, 0.2, 9.0, 0.6], [0.1, 0.05, 0.6, 0.2]]
)


@pytest.fixture(autouse=True)
def _packages(monkeypatch):
    foreign_messages.install(monkeypatch)


def tracks(**more):
    state = np.array([100.0, 3.0, -50.0, 4.0])
    return TrackArrays.from_tracks([ConfirmedTrack(5, 1.7e9, state, SPREAD, (), 0.0, **more)])


def test_a_radar_track_has_state_covariances_and_a_uuid_of_its_run():
    message = radar_tracks(HEADER, tracks(), INSTANCE)
    (one,) = message.tracks
    assert message.header is HEADER
    assert (one.position.x, one.position.y) == (100.0, -50.0)
    assert (one.velocity.x, one.velocity.y) == (3.0, 4.0)
    assert one.position_covariance == [4.0, 1.0, 0.0, 9.0, 0.0, UNOBSERVED_VARIANCE]
    assert one.velocity_covariance == [0.3, 0.05, 0.0, 0.2, 0.0, UNOBSERVED_VARIANCE]
    assert bytes(one.uuid.uuid) == track_uuid(INSTANCE, 5).tobytes()
    assert track_uuid(INSTANCE, 5).tobytes() != track_uuid(INSTANCE, 6).tobytes()
    assert track_uuid(INSTANCE, 5).tobytes() != track_uuid(uuid.UUID(int=8), 5).tobytes()


@pytest.mark.parametrize(("probability", "kind"), [(math.nan, 0), (0.5, 0), (0.95, 1), (0.02, 2)])
def test_a_radar_track_is_static_or_dynamic_where_that_is_known(probability, kind):
    (one,) = radar_tracks(HEADER, tracks(stationary_probability=probability), INSTANCE).tracks
    assert one.classification == kind


def test_a_track_that_coasts_is_no_radar_track_but_an_object_with_its_existence():
    coasts = tracks(status=TrackStatus.COASTING, existence_probability=0.03)
    assert radar_tracks(HEADER, coasts, INSTANCE).tracks == []
    (one,) = tracked_objects(HEADER, coasts, INSTANCE).objects
    assert one.existence_probability == 0.03


def test_a_tracked_object_moves_along_its_own_x_axis():
    message = tracked_objects(HEADER, tracks(existence_probability=0.75), INSTANCE)
    (one,) = message.objects
    pose = one.kinematics.pose_with_covariance.pose
    course = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
    twist = one.kinematics.twist_with_covariance
    speed = twist.twist.linear.x
    assert (pose.position.x, pose.position.y) == (100.0, -50.0)
    assert (speed * math.cos(course), speed * math.sin(course)) == pytest.approx((3.0, 4.0))
    assert one.existence_probability == 0.75
    turned = np.reshape(twist.covariance, (6, 6))[:2, :2]
    axes = np.array([[0.6, -0.8], [0.8, 0.6]])
    np.testing.assert_allclose(axes @ turned @ axes.T, SPREAD[1::2, 1::2], atol=1e-12)
    position = np.reshape(one.kinematics.pose_with_covariance.covariance, (6, 6))[:2, :2]
    np.testing.assert_array_equal(position, SPREAD[0::2, 0::2])


@pytest.mark.parametrize(("speed", "available"), [(20.0, 1), (1.0, 0), (0.0, 0)])
def test_what_is_not_known_of_an_object_has_a_large_variance(speed, available):
    state = np.array([100.0, 0.6 * speed, -50.0, 0.8 * speed])
    covariance = np.diag([4.0, 1.0, 9.0, 1.0])
    held = TrackArrays.from_tracks([ConfirmedTrack(5, 1.7e9, state, covariance, (), 0.0)])
    (one,) = tracked_objects(HEADER, held, INSTANCE).objects
    found = one.kinematics
    assert found.orientation_availability == available
    pose, twist, acceleration = (
        np.diag(np.reshape(part.covariance, (6, 6)))
        for part in (
            found.pose_with_covariance,
            found.twist_with_covariance,
            found.acceleration_with_covariance,
        )
    )
    yaw = (1.0 / speed) ** 2 if available else UNOBSERVED_VARIANCE
    assert pose.tolist() == pytest.approx([4.0, 9.0, *[UNOBSERVED_VARIANCE] * 3, yaw])
    assert twist.tolist() == pytest.approx([1.0, 1.0, *[UNOBSERVED_VARIANCE] * 4])
    assert (acceleration == UNOBSERVED_VARIANCE).all()


DEFINITIONS = {
    "radar_msgs/msg/RadarTrack": """unique_identifier_msgs/UUID uuid
geometry_msgs/Point position
geometry_msgs/Vector3 velocity
geometry_msgs/Vector3 acceleration
geometry_msgs/Vector3 size
uint16 classification
float32[6] position_covariance
float32[6] velocity_covariance
float32[6] acceleration_covariance
float32[6] size_covariance
""",
    "radar_msgs/msg/RadarTracks": "std_msgs/Header header\nradar_msgs/RadarTrack[] tracks\n",
    "autoware_perception_msgs/msg/ObjectClassification": "uint8 label\nfloat32 probability\n",
    "autoware_perception_msgs/msg/Shape": """uint8 type
geometry_msgs/Polygon footprint
geometry_msgs/Vector3 dimensions
""",
    "autoware_perception_msgs/msg/TrackedObjectKinematics": """
geometry_msgs/PoseWithCovariance pose_with_covariance
geometry_msgs/TwistWithCovariance twist_with_covariance
geometry_msgs/AccelWithCovariance acceleration_with_covariance
uint8 orientation_availability
bool is_stationary
""",
    "autoware_perception_msgs/msg/TrackedObject": """unique_identifier_msgs/UUID object_id
float32 existence_probability
ObjectClassification[] classification
TrackedObjectKinematics kinematics
Shape shape
""",
    "autoware_perception_msgs/msg/TrackedObjects": """std_msgs/Header header
TrackedObject[] objects
""",
}


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (radar_tracks, "radar_msgs/msg/RadarTracks"),
        (tracked_objects, "autoware_perception_msgs/msg/TrackedObjects"),
    ],
)
def test_a_message_is_read_again_by_its_definition(make, name):
    rosbags = pytest.importorskip("rosbags.typesys", reason="rosbags makes types of definitions")
    from support.bag_files import of_definition

    store = rosbags.get_typestore(rosbags.Stores.ROS2_JAZZY)
    types = {}
    for one, text in DEFINITIONS.items():
        types.update(rosbags.get_types_from_msg(text, one))
    store.register(types)
    message = make(HEADER, tracks(existence_probability=0.75), INSTANCE)
    read = store.deserialize_cdr(
        store.serialize_cdr(of_definition(store, message, name), name), name
    )
    assert read.header.frame_id == "odom"
    (one,) = read.tracks if make is radar_tracks else read.objects
    if make is radar_tracks:
        np.testing.assert_allclose(one.velocity_covariance[[0, 1, 3]], [0.3, 0.05, 0.2], rtol=1e-6)
        assert bytes(one.uuid.uuid) == track_uuid(INSTANCE, 5).tobytes()
    else:
        assert one.existence_probability == 0.75
        assert one.kinematics.twist_with_covariance.twist.linear.x == 5.0
        assert one.kinematics.pose_with_covariance.covariance[7] == 9.0
        assert bytes(one.object_id.uuid) == track_uuid(INSTANCE, 5).tobytes()
