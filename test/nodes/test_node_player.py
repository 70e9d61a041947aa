"""The player of CSV recordings: what it publishes, and the recordings that it refuses."""

import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2, PointField
from support.boat import named
from support.expectation import STATE
from support.show import DETECTIONS, OWN_SHIP, SECOND, TARGET, Show, write_recording
from support.sonar_driver import points, stamp_ns

from tsepm_ros.nodes.node_parameters import ParameterError
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.scan_player import ScanPlayer


@pytest.fixture
def record(tmp_path) -> Callable[..., str]:
    """Write a recording and return its folder."""
    return partial(write_recording, tmp_path)


def fields(message: PointCloud2) -> dict[str, int]:
    return {field.name: field.datatype for field in message.fields}


def heading(message: Odometry) -> float:
    return 2 * math.atan2(message.pose.pose.orientation.z, message.pose.pose.orientation.w)


def test_the_player_publishes_what_was_recorded(world, record):
    folder = record(detections=DETECTIONS, own_ship=OWN_SHIP, target=TARGET)
    show = Show(world, ScanPlayer, recording=folder).play()
    assert [stamp_ns(message) for message in show.detections] == [
        10 * SECOND,
        12 * SECOND + SECOND // 2,
        15 * SECOND + 1,
    ]
    assert {message.header.frame_id for message in show.detections} == {"sonar"}
    first = points(show.detections[0])
    assert [(p["range"], p["azimuth"], p["intensity"]) for p in first] == [
        (1000.5, 0.25, 3.0),
        (2000.25, -0.5, 4.0),
    ]
    kinds = fields(show.detections[0])
    assert {kinds[name] for name in "xyz"} == {PointField.FLOAT32}

    assert [stamp_ns(m) / SECOND for m in show.own_ship] == [10.0, 12.5, 20.0]
    ship = show.own_ship[1]
    assert (ship.header.frame_id, ship.child_frame_id) == ("odom", "sonar")
    assert (ship.pose.pose.position.x, ship.pose.pose.position.y) == (7.5, 11.0)
    assert heading(ship) == pytest.approx(math.pi / 2 - 0.6), "from clockwise from north to ENU"
    forward, port = ship.twist.twist.linear.x, ship.twist.twist.linear.y
    east = forward * math.cos(heading(ship)) - port * math.sin(heading(ship))
    assert east == pytest.approx(1.0)

    assert [stamp_ns(m) / SECOND for m in show.truth] == [10.0, 15.0]
    states = [[[p[name] for name in STATE] for p in points(m)] for m in show.truth]
    assert states == [
        [[100.0, 3.0, 200.0, 4.0], [-100.0, 0.0, -200.0, 0.0]],
        [[115.0, 3.0, 220.0, 4.0]],
    ]
    assert {message.header.frame_id for message in show.truth} == {"odom"}


def test_the_player_needs_detections_only(world, record):
    show = Show(world, ScanPlayer, recording=record(detections=DETECTIONS)).play()
    assert list(map(len, show.topics)) == [3, 0, 0, 0, 0]


def test_bearings_stay_bearings_and_a_heading_that_is_not_known_is_said(world, record):
    folder = record(
        detections="scan,time_s,range_m,bearing_rad\n0,0,100,0.5\n2,2,101,0.25\n",
        own_ship="scan,time_s,east_m,north_m\n0,0,1,2\n1,1,1,2\n2,2,1,2\n",
    )
    show = Show(world, ScanPlayer, recording=folder).play()
    assert [message.width for message in show.detections] == [1, 0, 1], "scan 1 was empty"
    [point] = points(show.detections[0])
    assert point == {"range": 100.0, "bearing": 0.5}
    yaw_variances = [message.pose.covariance[35] for message in show.own_ship]
    assert min(yaw_variances) > 100.0


def test_elevation_and_attitude_are_played(world, record):
    detections = (
        "time_s,range_m,azimuth_rad,elevation_rad,two_way_travel_time_s\n1,100,0.5,-0.25,2\n"
    )
    own_ship = "time_s,east_m,north_m,heading_rad,roll_rad,pitch_rad\n1,5,6,0.5,0.1,-0.2\n"
    show = Show(
        world, ScanPlayer, recording=record(detections=detections, own_ship=own_ship)
    ).play()
    [[point]] = map(points, show.detections)
    assert (point["elevation"], point["two_way_travel_time"]) == (-0.25, 2.0)
    turn = show.own_ship[0].pose.pose.orientation
    found = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_euler("ZYX")
    np.testing.assert_allclose(found, [math.pi / 2 - 0.5, -0.2, 0.1], atol=1e-12)


@pytest.mark.parametrize("own_ship", [OWN_SHIP, None])
def test_the_own_ship_has_a_topic_only_where_it_was_recorded(world, record, own_ship):
    given = {"detections": DETECTIONS} | ({} if own_ship is None else {"own_ship": own_ship})
    show = Show(world, ScanPlayer, recording=record(**given))
    assert show.node.count_publishers("own_ship/odometry") == (own_ship is not None)


def test_the_players_start_is_added_to_recorded_stamps(world, record):
    folder = record(detections=DETECTIONS, own_ship=OWN_SHIP)
    show = Show(world, ScanPlayer, recording=folder, start_stamp=1e9).play()
    assert stamp_ns(show.detections[0]) == (10**9 + 10) * SECOND
    assert stamp_ns(show.own_ship[0]) == (10**9 + 10) * SECOND


def test_the_player_may_begin_within_the_recording(world, record):
    folder = record(detections=DETECTIONS, own_ship=OWN_SHIP, target=TARGET)
    show = Show(world, ScanPlayer, recording=folder, start_offset=2.5).play()
    assert [stamp_ns(m) / SECOND for m in show.own_ship] == [12.5, 20.0]
    assert [stamp_ns(m) for m in show.detections] == [12 * SECOND + SECOND // 2, 15 * SECOND + 1]
    assert [stamp_ns(m) / SECOND for m in show.truth] == [15.0]


def test_a_start_beyond_the_end_is_refused(world, record):
    with pytest.raises(ParameterError, match="start_offset: 6 s is beyond the end"):
        Show(world, ScanPlayer, recording=record(detections=DETECTIONS), start_offset=6.0)


def test_a_negative_start_lets_the_recording_begin_at_the_clocks_time(world, record):
    before = time.time_ns()
    show = Show(world, ScanPlayer, recording=record(detections=DETECTIONS), start_stamp=-1.0).play()
    assert before - SECOND < stamp_ns(show.detections[0]) < time.time_ns() + SECOND


def test_the_recorded_clock_goes_with_the_messages(world, record):
    folder = record(detections=DETECTIONS, own_ship=OWN_SHIP)
    show = Show(world, ScanPlayer, recording=folder, publish_clock=True).play()
    times = [message.clock.sec * SECOND + message.clock.nanosec for message in show.clock]
    assert times == sorted(times)
    assert {stamp_ns(m) for topic in (show.detections, show.own_ship) for m in topic} == set(times)


def test_a_recording_longer_than_what_goes_unacknowledged_arrives_whole(world, record):
    number = 700
    rows = [f"{scan},{1000 + scan},0.5" for scan in range(number)]
    content = "\n".join(["time_s,range_m,azimuth_rad", *rows, ""])
    show = Show(world, ScanPlayer, recording=record(detections=content), rate_factor=1e6).play()
    assert [stamp_ns(message) for message in show.detections] == [
        scan * SECOND for scan in range(number)
    ]


UNPLAYABLE = {
    "no_angle": {"detections": "time_s,range_m\n1,2\n"},
    "time_beyond_ros": {"detections": "time_s,range_m,azimuth_rad\n1.7e12,100,0.1\n"},
    "huge_cell": {"detections": f"time_s,range_m,azimuth_rad\n1,{'9' * 140_000},0.1\n"},
    "own_ship_time_beyond_ros": {
        "detections": DETECTIONS,
        "own_ship": "time_s,east_m,north_m\n1e10,1,2\n",
    },
}


@pytest.mark.parametrize("name", UNPLAYABLE)
def test_a_bad_recording_is_refused_with_a_sentence(world, record, name):
    with pytest.raises(ParameterError) as error:
        world.make(ScanPlayer, {"recording": record(**UNPLAYABLE[name])})
    assert str(error.value).startswith("recording")
    assert "\n" not in str(error.value)


def test_a_recording_that_is_no_text_is_refused(world, tmp_path):
    (tmp_path / "detections.csv").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ParameterError, match="recording"):
        world.make(ScanPlayer, {"recording": str(tmp_path)})


def test_a_start_beyond_the_stamps_of_ros_is_refused(world, record):
    folder = record(detections="time_s,range_m,azimuth_rad\n1.7e9,100,0.1\n")
    with pytest.raises(ParameterError, match="start_stamp"):
        world.make(ScanPlayer, {"recording": folder, "start_stamp": 1.9e9})


JOYRIDE = Path(__file__).resolve().parents[3] / "shared" / "data" / "joyride"


@pytest.mark.skipif(not JOYRIDE.is_dir(), reason="the recording joyride is not here")
def test_the_vessel_of_the_recording_joyride_is_started_early_and_near(world, tmp_path):
    scans = 25
    last = np.loadtxt(JOYRIDE / "own_ship.csv", delimiter=",", skiprows=1)[scans - 1, 1]
    for source in JOYRIDE.glob("*.csv"):  # the beginning is enough, and quick
        header, *rows = source.read_text().splitlines()
        kept = [row for row in rows if float(row.split(",")[1]) <= last]
        (tmp_path / source.name).write_text("\n".join([header, *kept]) + "\n")
    tracks = world.listen(PointCloud2, "tracks")
    given = {
        "own_ship_source": "odometry",
        "bearing_reference": "north",
        "sensor.range_std": 15.0,
        "sensor.range_std_fraction": 0.0,
        "max_speed": 15.0,
    }
    world.make(TrackInitiator, named(given))
    show = Show(world, ScanPlayer, recording=str(tmp_path), wait_for_subscribers=3)
    world.until(lambda: world.observer.count_subscribers("/detections") == 2, "the initiator")
    world.until_connected()
    show.play()
    world.until(lambda: len(tracks) == scans, "the tracks of every scan")
    assert {message.header.frame_id for message in tracks} == {"odom"}
    assert world.dropped() == {}

    truth = np.loadtxt(JOYRIDE / "target.csv", delimiter=",", skiprows=1)
    errors = []
    for number, message in enumerate(tracks, 1):
        now = stamp_ns(message) / SECOND
        north, east = (np.interp(now, truth[:, 1], truth[:, column]) for column in (2, 4))
        errors += [(number, math.hypot(p["x"] - east, p["y"] - north)) for p in points(message)]
    near = [number for number, error in errors if error < 60.0]
    assert near, errors
    assert near[0] <= 20
