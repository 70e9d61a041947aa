"""The simulator and the player: what they publish, when, and that none of it is lost."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.qos import ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2, PointField
from support.boat import Boat, named
from support.expectation import STATE
from support.ros_world import World
from support.sonar_driver import START_NS, Ping, points, stamp_ns
from visualization_msgs.msg import MarkerArray

from tsepm_ros.nodes.node_parameters import ParameterError
from tsepm_ros.nodes.scan_player import ScanPlayer
from tsepm_ros.nodes.sonar_simulator import SonarSimulator
from tsepm_ros.nodes.track_initiator import TrackInitiator

SECOND = 10**9
FAST = 1e5

SCENARIO = """
scans: 5
period: 4.0
sound_speed: 1500.0
sensor: {range_std: 5.0, range_std_fraction: 0.0, azimuth_std: 0.005, max_range: 3000.0,
         detection_probability: 1.0, clutter_density: 1.0e-6}
own_ship: {x: 100.0, y: -50.0, yaw_deg: 40.0, speed: 5.0, turn_rate_deg: 2.0}
targets:
  - {state: [1500.0, 4.0, 700.0, -3.0]}
  - {state: [-900.0, 0.0, 1200.0, 5.0]}
"""

DETECTIONS = """time_s,range_m,azimuth_rad,intensity
10.0,1000.5,0.25,3
10.0,2000.25,-0.5,4
12.5,1010.125,0.2,5
15.000000001,1020.0,0.125,6
"""
OWN_SHIP = """time_s,east_m,north_m,east_mps,north_mps,heading_rad
10.0,5.0,6.0,1.0,2.0,0.5
12.5,7.5,11.0,1.0,2.0,0.6
20.0,15.0,26.0,1.0,2.0,0.7
"""
TARGET = """time_s,east_m,north_m,east_mps,north_mps,target
10.0,100.0,200.0,3.0,4.0,7
10.0,-100.0,-200.0,0.0,0.0,8
15.0,115.0,220.0,3.0,4.0,7
"""


@pytest.fixture
def scenario(tmp_path) -> str:
    path = tmp_path / "scene.yaml"
    path.write_text(SCENARIO)
    return str(path)


@pytest.fixture
def record(tmp_path) -> Callable[..., str]:
    """Write a recording and return its folder."""

    def write(**files: str) -> str:
        folder = tmp_path / "recording"
        folder.mkdir(exist_ok=True)
        for name, content in files.items():
            (folder / f"{name}.csv").write_text(content)
        return str(folder)

    return write


class Show:
    """A simulator or player whose every message is seen: it begins when told to."""

    def __init__(self, world: World, kind: type, **parameters: Any) -> None:
        self.world = world
        self.detections = world.listen(PointCloud2, "detections")
        self.own_ship = world.listen(Odometry, "own_ship/odometry")
        self.truth = world.listen(PointCloud2, "ground_truth")
        self.markers = world.listen(MarkerArray, "ground_truth/markers")
        self.clock = world.listen(Clock, "/clock")
        given = {"rate_factor": FAST, "settling_time": 0.0, "wait_for_subscribers": 2}
        self.node = world.make(kind, {**given, **parameters})
        world.until_connected()

    @property
    def topics(self) -> list[list[Any]]:
        return [self.detections, self.own_ship, self.truth, self.markers, self.clock]

    def begin(self) -> None:
        self.world.listen(PointCloud2, "detections")  # the second subscriber

    def play(self) -> Show:
        """Play to the end and take everything."""
        self.begin()
        self.world.until(self.node.finished.done, "the end")
        seen = -1
        while (now := sum(map(len, self.topics))) != seen:  # all is acknowledged, so it is here
            seen = now
            for _ in range(10):
                self.world.spin_once(0.01)
        return self

    @property
    def messages(self) -> list[Any]:
        return [message for topic in self.topics for message in topic]


def fields(message: PointCloud2) -> dict[str, int]:
    return {field.name: field.datatype for field in message.fields}


def heading(message: Odometry) -> float:
    return 2 * math.atan2(message.pose.pose.orientation.z, message.pose.pose.orientation.w)


# The simulator


def test_the_simulator_publishes_what_a_driver_would_and_the_truth(world, scenario):
    show = Show(world, SonarSimulator, scenario=scenario).play()
    assert len(show.detections) == len(show.truth) == 5
    for index, (scan, truth) in enumerate(zip(show.detections, show.truth, strict=True)):
        assert stamp_ns(scan) == stamp_ns(truth) == index * 4 * SECOND
        assert (scan.header.frame_id, truth.header.frame_id) == ("sonar", "odom")
        kinds = fields(scan)
        assert list(kinds)[:3] == ["x", "y", "z"]
        assert {kinds[name] for name in "xyz"} == {PointField.FLOAT32}
        assert {"range", "azimuth", "time_offset"} <= kinds.keys()
        for point in points(scan):
            assert point["x"] == pytest.approx(
                point["range"] * math.cos(point["azimuth"]), rel=1e-5
            )
            assert point["y"] == pytest.approx(
                point["range"] * math.sin(point["azimuth"]), rel=1e-5
            )
            assert point["time_offset"] == pytest.approx(point["range"] / 1500.0)
        states = [[point[name] for name in STATE] for point in points(truth)]
        time_s = 4.0 * index
        assert states == [
            [1500.0 + 4 * time_s, 4.0, 700.0 - 3 * time_s, -3.0],
            [-900.0, 0.0, 1200.0 + 5 * time_s, 5.0],
        ]


def test_the_simulated_truth_has_the_layout_of_tracks(world, scenario):
    boat = Boat(world)
    boat.driver.ping(Ping(START_NS, [], []))
    [track] = boat.take(1, 0)
    world.end(boat.driver)
    world.end(boat.node)
    show = Show(world, SonarSimulator, scenario=scenario).play()
    assert show.truth[0].fields == track.fields
    assert show.truth[0].point_step == track.point_step


def test_every_target_is_detected_where_the_moving_ship_sees_it(world, scenario):
    show = Show(world, SonarSimulator, scenario=scenario).play()
    poses = [
        (stamp_ns(m), m.pose.pose.position.x, m.pose.pose.position.y, heading(m))
        for m in show.own_ship
    ]
    times = np.array([pose[0] for pose in poses]) / SECOND
    x, y, yaw = (np.array([pose[axis] for pose in poses]) for axis in (1, 2, 3))
    yaw = np.unwrap(yaw)
    for scan, truth in zip(show.detections, show.truth, strict=True):
        stamp = stamp_ns(scan) / SECOND
        places = []
        for point in points(scan):
            back = stamp + 2 * point["time_offset"]
            angle = point["azimuth"] + np.interp(back, times, yaw)
            here = [
                np.interp(stamp + point["time_offset"], times, axis) for axis in (x, y)
            ]  # the middle of the ship's way is near enough
            places.append(
                (
                    here[0] + point["range"] * math.cos(angle),
                    here[1] + point["range"] * math.sin(angle),
                )
            )
        for target in points(truth):
            distances = [math.hypot(px - target["x"], py - target["y"]) for px, py in places]
            assert min(distances) < 60.0


def test_the_simulated_own_ship_is_known_for_all_of_each_scan(world, scenario):
    show = Show(world, SonarSimulator, scenario=scenario, own_ship_rate=2.0).play()
    stamps = [stamp_ns(message) for message in show.own_ship]
    assert np.diff(stamps).tolist() == [SECOND // 2] * (len(stamps) - 1)
    assert stamps[0] == 0
    last = max(2 * point["time_offset"] for point in points(show.detections[-1]))
    assert stamps[-1] >= stamp_ns(show.detections[-1]) + last * SECOND
    first = show.own_ship[0]
    assert (first.header.frame_id, first.child_frame_id) == ("odom", "sonar")
    assert (first.pose.pose.position.x, first.pose.pose.position.y) == (100.0, -50.0)
    assert heading(first) == pytest.approx(math.radians(40.0))
    assert first.twist.twist.linear.x == pytest.approx(5.0, rel=1e-3), "in the ship's own axes"
    assert first.twist.twist.angular.z == pytest.approx(math.radians(2.0))
    second = show.own_ship[2]
    assert heading(second) == pytest.approx(math.radians(42.0))


def test_the_simulators_frames_may_be_given(world, scenario):
    frames = {"fixed_frame": "map", "sensor_frame": "head"}
    show = Show(world, SonarSimulator, scenario=scenario, **frames).play()
    assert {message.header.frame_id for message in show.detections} == {"head"}
    assert {message.header.frame_id for message in show.truth} == {"map"}
    assert {(m.header.frame_id, m.child_frame_id) for m in show.own_ship} == {("map", "head")}
    markers = [marker for array in show.markers for marker in array.markers]
    assert {marker.header.frame_id for marker in markers} == {"map"}


def test_a_seed_makes_the_simulator_repeatable_bit_for_bit(world, scenario):
    shows = []
    for seed in (7, 7, 8):
        with World(world.domain) as own:
            shows.append(Show(own, SonarSimulator, scenario=scenario, seed=seed).play().messages)
    assert len(shows[0]) > 30
    assert shows[0] == shows[1]
    assert shows[0] != shows[2]


def test_the_shipped_scenario_is_the_default(world):
    show = Show(world, SonarSimulator).play()
    assert len(show.detections) == 16
    assert {message.width for message in show.truth} == {4}


def test_the_simulators_start_may_be_given_or_the_clocks_time(world, scenario):
    with World(world.domain) as own:
        show = Show(own, SonarSimulator, scenario=scenario, start_stamp=1.7e9).play()
        assert stamp_ns(show.detections[0]) == 1_700_000_000 * SECOND
        assert stamp_ns(show.own_ship[0]) == 1_700_000_000 * SECOND
    before = time.time_ns()
    show = Show(world, SonarSimulator, scenario=scenario, start_stamp=-1.0).play()
    assert before - SECOND < stamp_ns(show.detections[0]) < time.time_ns() + SECOND


def test_the_simulated_clock_goes_with_the_messages(world, scenario):
    show = Show(world, SonarSimulator, scenario=scenario, publish_clock=True).play()
    times = [message.clock.sec * SECOND + message.clock.nanosec for message in show.clock]
    assert times == sorted(times)
    assert {stamp_ns(message) for message in show.own_ship} <= set(times)
    last = max(2 * point["time_offset"] for point in points(show.detections[-1]))
    assert times[-1] >= stamp_ns(show.detections[-1]) + last * SECOND


def test_no_clock_is_published_unasked(world, scenario):
    show = Show(world, SonarSimulator, scenario=scenario).play()
    assert show.clock == []
    assert world.observer.count_publishers("/clock") == 0


def test_the_simulator_and_the_initiator_work_together_in_simulated_time(world, scenario):
    tracks = world.listen(PointCloud2, "tracks")
    given = {"own_ship_source": "odometry", "use_sim_time": True, "tsepm.min_hits": 4}
    world.make(TrackInitiator, named({**given, "sensor.range_std": 5.0}))
    show = Show(
        world,
        SonarSimulator,
        scenario=scenario,
        publish_clock=True,
        wait_for_subscribers=3,
    )
    world.until(lambda: world.observer.count_subscribers("/detections") == 2, "the initiator")
    world.until_connected()
    show.play()
    world.until(lambda: len(tracks) == 5, "tracks")
    assert {message.header.frame_id for message in tracks} == {"odom"}
    for target in points(show.truth[-1]):
        found = [
            math.hypot(p["x"] - target["x"], p["y"] - target["y"])
            for m in tracks[3:]
            for p in points(m)
        ]
        assert min(found) < 100.0
    assert world.dropped() == {}


# The player


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


def test_a_file_names_a_recording_as_well_as_its_folder(world, record):
    folder = record(detections=DETECTIONS)
    show = Show(world, ScanPlayer, recording=f"{folder}/detections.csv").play()
    assert len(show.detections) == 3


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


# Both


def make(world: World, kind: type, scenario: str, record: Any, **parameters: Any) -> Show:
    if kind is SonarSimulator:
        return Show(world, kind, scenario=scenario, **parameters)
    recording = record(detections=DETECTIONS, own_ship=OWN_SHIP, target=TARGET)
    return Show(world, kind, recording=recording, **parameters)


BOTH = pytest.mark.parametrize("kind", [SonarSimulator, ScanPlayer])


@BOTH
def test_everything_is_offered_reliably(world, kind, scenario, record):
    make(world, kind, scenario, record)
    for topic in ("/detections", "/own_ship/odometry", "/ground_truth", "/ground_truth/markers"):
        [publisher] = world.observer.get_publishers_info_by_topic(topic)
        assert publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        assert publisher.qos_profile.depth == 0 or publisher.qos_profile.depth >= 10


@BOTH
def test_nothing_is_published_before_there_are_enough_subscribers(world, kind, scenario, record):
    show = make(world, kind, scenario, record)
    world.until_logged("waiting for 2 subscriber(s) of /detections")
    for _ in range(20):
        world.spin_once(0.01)
    assert list(map(len, show.topics)) == [0] * 5
    show.play()
    number = 5 if kind is SonarSimulator else 3
    assert len(show.detections) == number


@BOTH
def test_it_may_start_without_any_subscriber(world, kind, scenario, record):
    show = make(world, kind, scenario, record, wait_for_subscribers=0)
    world.until(show.node.finished.done, "the end")
    world.until_logged("finished")


@BOTH
def test_it_settles_before_the_first_message(world, kind, scenario, record):
    show = make(world, kind, scenario, record, settling_time=0.3)
    begin = time.monotonic()
    show.begin()
    world.until(lambda: show.detections, "the first scan")
    assert time.monotonic() - begin >= 0.3


@BOTH
def test_the_rate_factor_sets_the_pace(world, kind, scenario, record):
    show = make(world, kind, scenario, record, rate_factor=40.0)
    begin = time.monotonic()
    show.begin()
    number = 5 if kind is SonarSimulator else 3
    world.until(lambda: len(show.detections) == number, "the last scan")
    took = time.monotonic() - begin
    span = (stamp_ns(show.detections[-1]) - stamp_ns(show.detections[0])) / SECOND
    assert span / 40.0 <= took < span / 40.0 + 3.0


@BOTH
def test_a_loop_begins_again_with_the_same_messages(world, kind, scenario, record):
    show = make(world, kind, scenario, record, loop=True)
    show.begin()
    number = 5 if kind is SonarSimulator else 3
    world.until(lambda: len(show.detections) >= 2 * number + 1, "the third round")
    rounds = [show.detections[number * n : number * (n + 1)] for n in range(2)]
    assert rounds[0] == rounds[1]
    assert not show.node.finished.done()


@BOTH
def test_a_loop_makes_the_initiator_start_over(world, kind, scenario, record):
    boat = Boat(world, restart_jump=3.0)
    world.end(boat.driver)
    show = make(world, kind, scenario, record, loop=True, wait_for_subscribers=3)
    world.until(lambda: world.observer.count_subscribers("/detections") == 2, "the initiator")
    world.until_connected()
    show.begin()
    number = 5 if kind is SonarSimulator else 3
    world.until(lambda: len(boat.tracks) >= 2 * number + 1, "the third round")
    world.until_logged("starting over")
    assert world.dropped() == {}


def test_a_recording_longer_than_what_goes_unacknowledged_arrives_whole(world, record):
    number = 700
    rows = [f"{scan},{1000 + scan},0.5" for scan in range(number)]
    content = "\n".join(["time_s,range_m,azimuth_rad", *rows, ""])
    show = Show(world, ScanPlayer, recording=record(detections=content), rate_factor=1e6).play()
    assert [stamp_ns(message) for message in show.detections] == [
        scan * SECOND for scan in range(number)
    ]


# What cannot be played

UNPLAYABLE = {
    "empty": {"detections": ""},
    "no_time": {"detections": "range_m,azimuth_rad\n1,2\n"},
    "no_range": {"detections": "time_s,azimuth_rad\n1,2\n"},
    "no_angle": {"detections": "time_s,range_m\n1,2\n"},
    "two_angles": {"detections": "time_s,range_m,azimuth_rad,bearing_rad\n1,100,0.1,0.2\n"},
    "a_word": {"detections": "time_s,range_m,azimuth_rad\n1,far,0.1\n"},
    "short_line": {"detections": "time_s,range_m,azimuth_rad\n1,100\n"},
    "time_nan": {"detections": "time_s,range_m,azimuth_rad\nnan,100,0.1\n"},
    "time_beyond_ros": {"detections": "time_s,range_m,azimuth_rad\n1.7e12,100,0.1\n"},
    "huge_cell": {"detections": f"time_s,range_m,azimuth_rad\n1,{'9' * 140_000},0.1\n"},
    "own_ship_without_north": {"detections": DETECTIONS, "own_ship": "time_s,east_m\n1,2\n"},
    "own_ship_time_beyond_ros": {
        "detections": DETECTIONS,
        "own_ship": "time_s,east_m,north_m\n1e10,1,2\n",
    },
    "target_nan": {
        "detections": DETECTIONS,
        "target": "time_s,east_m,north_m,target\n1,1,2,nan\n",
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


UNKNOWABLE = {
    "no_mapping": ("- 1\n", "mapping"),
    "no_yaml": ("{: [\n", "YAML"),
    "unknown_key": ("scanz: 3\n", "scanz"),
    "no_scans": ("scans: 0\n", "scans"),
    "scans_in_words": ("scans: many\n", "scans"),
    "half_a_scan": ("scans: 2.5\n", "scans"),
    "period_in_words": ("period: fast\n", "period"),
    "period_that_yaml_reads_as_text": ("period: 1e1\n", "period"),
    "infinite_period": ("period: .inf\n", "period"),
    "no_sound_speed": ("sound_speed: null\n", "sound_speed"),
    "bad_sensor": ("sensor: {range_std: -1.0}\n", "range_std"),
    "own_ship_in_words": ("own_ship: {speed: fast}\n", "own_ship.speed"),
    "no_own_ship": ("own_ship:\n", "own_ship"),
    "targets_by_number": ("targets: 5\n", "targets"),
    "no_targets": ("targets:\n", "targets"),
    "short_state": ("targets: [{state: [1.0, 2.0]}]\n", "state"),
    "speed_in_words": (
        "targets: [{ranges: [1.0, 2.0], azimuths_deg: [0.0, 90.0], speed: fast}]\n",
        "speed",
    ),
    "angles_in_words": (
        "targets: [{ranges: [1.0, 2.0], azimuths_deg: [a, b], speed: 1.0}]\n",
        "azimuths",
    ),
    "count_in_words": (
        "targets: [{ranges: [1.0, 2.0], azimuths_deg: [0.0, 9.0], speed: 0.0, count: two}]\n",
        "count",
    ),
    "target_that_cannot_be": (
        "targets: [{ranges: [100.0, 101.0], azimuths_deg: [0.0, 90.0], speed: 50.0}]\n",
        "targets",
    ),
    "ranges_the_wrong_way": (
        "targets: [{ranges: [200.0, 100.0], azimuths_deg: [0.0, 90.0], speed: 1.0}]\n",
        "ranges",
    ),
}


@pytest.mark.parametrize("name", UNKNOWABLE)
def test_a_bad_scenario_is_refused_with_a_sentence(world, tmp_path, name):
    content, named_in_it = UNKNOWABLE[name]
    path = tmp_path / "bad.yaml"
    path.write_text(content)
    with pytest.raises(ParameterError) as error:
        world.make(SonarSimulator, {"scenario": str(path)})
    assert named_in_it in str(error.value)
    assert "\n" not in str(error.value)


# Real data

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
