"""The node that hands tracks on to plotters and navigation stacks."""

from __future__ import annotations

import math
import select
import socket

import numpy as np
import pynmea2
import pytest
from nav_msgs.msg import Odometry
from pyproj import Geod
from sensor_msgs.msg import NavSatFix, NavSatStatus, PointCloud2
from support.ros_world import BEST_EFFORT, LATCHED

pytest.importorskip("pyproj")

from msg_adapters import make_header, odometry_message, track_cloud
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.tools.bridge.track_bridge import TrackBridge
from tsepm_ros.tracker.tracks import ConfirmedTrack

STAMP = 1_700_000_000.0


class LocalSocket(socket.socket):
    """A socket that sends to this machine alone."""

    def sendto(self, data, address):
        assert address[0] == "127.0.0.1", "a test sends nothing to other machines"
        return super().sendto(data, address)


@pytest.fixture(autouse=True)
def _this_machine(monkeypatch):
    monkeypatch.setattr(socket, "socket", LocalSocket)


class Plotter:
    """Receives sentences on this machine."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.socket.getsockname()[1]}"
        self.messages = []

    def read(self):
        while select.select([self.socket], [], [], 0.0)[0]:
            self.messages.append(pynmea2.parse(self.socket.recv(200).decode("ascii"), check=True))
        return self.messages


@pytest.fixture
def plotter():
    made = Plotter()
    yield made
    made.socket.close()


def track(track_id, x, vx, y, vy):
    return ConfirmedTrack(track_id, STAMP, np.array([x, vx, y, vy]), np.eye(4), (), 0.0)


class Boat:
    """Publishes held tracks, own ship and fixes."""

    def __init__(self, world, frame="odom"):
        self.world, self.frame = world, frame
        self.tracks = world.observer.create_publisher(PointCloud2, "tracks/current", LATCHED)
        self.odometry = world.observer.create_publisher(Odometry, "own_ship/odometry", BEST_EFFORT)
        self.fixes = world.observer.create_publisher(NavSatFix, "fix", BEST_EFFORT)

    def end(self):
        """End the bridge, and what it heard."""
        self.world.end(self.bridge)
        for one in (self.tracks, self.odometry, self.fixes):
            self.world.observer.destroy_publisher(one)

    def hold(self, *held, stamp=STAMP):
        header = make_header(round(stamp * 1e9), self.frame)
        self.tracks.publish(track_cloud(header, [one.predicted(stamp) for one in held]))

    def sail(self, x=0.0, y=0.0, vx=0.0, vy=0.0, stamp=STAMP):
        sample = PoseSample(stamp, x, y, 0.3, rates=(vx, vy, 0.0), frame_id=self.frame)
        self.odometry.publish(odometry_message(sample))

    def fix(self, latitude, longitude, status=NavSatStatus.STATUS_FIX, nanosec=0):
        message = NavSatFix(latitude=latitude, longitude=longitude)
        message.header = make_header(round(STAMP * 1e9), "gps")
        message.header.stamp.nanosec = nanosec
        message.status.status = status
        self.fixes.publish(message)


def connected(world, plotter, frame="odom", **parameters):
    boat = Boat(world, frame)
    defaults = {"nmea_address": plotter.address, "nmea_period": 0.0}
    boat.bridge = world.make(TrackBridge, defaults | parameters)
    world.until_connected()
    return boat


def sentences(world, plotter, number, send):
    """The first messages, parsed."""
    world.until(lambda: len(plotter.read()) >= number, "sentences", send)
    return plotter.messages[:number]


def said(world, words, send):
    before = len(world.log)
    world.until(lambda: any(words in one.msg for one in world.log[before:]), words, send)


def test_a_plotter_gets_tracks_to_port_and_starboard_of_a_moving_boat(world, plotter):
    boat = connected(world, plotter)

    def send():
        boat.sail(100.0, 0.0, vx=5.0, stamp=STAMP - 2.0)  # at (110, 0) at the tracks' stamp
        boat.hold(track(8, 110.0, 5.0, 1852.0, 0.0), track(9, 110.0, 0.0, -926.0, 0.0))

    port, starboard = sentences(world, plotter, 2, send)
    assert (port.sentence_type, *port.data[:3]) == ("TTM", "00", "1.000", "0.0")
    assert starboard.data[:3] == ["01", "0.500", "180.0"]
    assert port.data[7:9] == ["1.000", "0.0"], "it moves as own ship does"


def test_axes_of_a_frame_with_z_down_are_those_that_its_name_states(world, plotter):
    boat = connected(world, plotter, "map_ned")

    def send():
        boat.sail()
        boat.hold(track(8, 0.0, 0.0, 1852.0, 1.0))  # y is east

    (one,) = sentences(world, plotter, 1, send)
    assert (one.data[1], one.data[2], one.data[5]) == ("1.000", "90.0", "90.0")


def test_reports_keep_their_period_and_a_track_that_is_gone_is_lost_once(world, plotter):
    boat = connected(world, plotter, own_ship_source="none", nmea_period=1.0)
    said(world, "tracks/current is not used", lambda: boat.tracks.publish(PointCloud2()))
    held = track(8, 50.0, 1.0, 0.0, 0.0)
    sentences(world, plotter, 1, lambda: boat.hold(held))
    boat.hold(held, stamp=STAMP + 0.5)
    sentences(world, plotter, 2, lambda: boat.hold(held, stamp=STAMP + 1.0))
    assert [one.data[13] for one in plotter.messages[:2]] == ["221320.0", "221321.0"]
    known = len(plotter.messages)
    sentences(world, plotter, known + 1, lambda: boat.hold(stamp=STAMP + 2.0))
    world.until_connected()
    ends = [one for one in plotter.read() if "L" in one.data]
    assert [one.data[0] for one in ends] == ["00"]


def test_of_more_than_100_tracks_the_others_are_counted(world, plotter):
    boat = connected(world, plotter, own_ship_source="none")
    held = [track(k, 50.0 + k, 1.0, 0.0, 0.0) for k in range(103)]
    said(world, "tracks beyond 100 are not sent (3 so far)", lambda: boat.hold(*held))
    sentences(world, plotter, 100, lambda: boat.hold(*held))
    assert {one.data[0] for one in plotter.read()} == {f"{k:02d}" for k in range(100)}


def test_of_tracks_those_with_a_finite_state_are_handed_on(world, plotter):
    boat = connected(world, plotter, own_ship_source="none")
    held = [track(8, 50.0, 1.0, math.nan, 0.0), track(9, 1852.0, 1.0, 0.0, 0.0)]
    said(world, "a track whose state is not finite is not handed on", lambda: boat.hold(*held))
    assert {one.data[1] for one in sentences(world, plotter, 1, lambda: None)} == {"1.000"}


def test_of_tracks_those_on_earth_are_handed_on_in_all_sentences(world, plotter):
    given = {"nmea_sentences": "both", "origin": "59.65,10.63", "own_ship_source": "none"}
    boat = connected(world, plotter, **given)
    near = track(9, 1852.0, 1.0, 0.0, 0.0)
    wide = ConfirmedTrack(10, STAMP, near.state, 1e300 * np.eye(4), (), 0.0)
    beyond = [track(k, *state) for k, state in enumerate(np.vstack([np.eye(4), -np.eye(4)]) * 1e30)]
    said(
        world,
        "is not handed on, nor one beyond 1e+09 m (9 so far)",
        lambda: boat.hold(*beyond, wide),
    )
    both = sentences(world, plotter, 2, lambda: boat.hold(*beyond, near))
    assert [one.sentence_type for one in both] == ["TTM", "TLL"]


def test_tll_is_where_the_fix_and_own_ship_say(world, plotter):
    boat = connected(world, plotter, nmea_sentences="TLL")

    def send():
        boat.sail(500.0, 300.0)
        boat.fix(59.65, 10.63)
        boat.hold(track(8, 1500.0, 0.0, 300.0, 0.0))  # 1000 m east of own ship

    (one,) = sentences(world, plotter, 1, send)
    assert one.sentence_type == "TLL"
    azimuth, _, distance = Geod(ellps="WGS84").inv(10.63, 59.65, one.longitude, one.latitude)
    assert distance == pytest.approx(1000.0, abs=0.3)
    assert azimuth == pytest.approx(90.0, abs=0.05)


def test_the_origin_by_parameter_needs_neither_fix_nor_own_ship(world, plotter):
    given = {"nmea_sentences": "both", "origin": "-33.9,151.2", "own_ship_source": "none"}
    boat = connected(world, plotter, **given)
    relative, on_earth = sentences(
        world, plotter, 2, lambda: boat.hold(track(8, 0.0, 0.0, -1852.0, 0.0))
    )
    assert (relative.data[1], relative.data[2], relative.data[3]) == ("1.000", "180.0", "T")
    assert on_earth.latitude == pytest.approx(-33.9 - 1852.0 / 110_922.0, abs=1e-4)


LOST = NavSatStatus.STATUS_NO_FIX, 0
NO_CLOCK = NavSatStatus.STATUS_FIX, 2_000_000_000
TLL = {"nmea_sentences": "TLL", "own_ship_source": "none"}


SILENT = [
    ("there is no message on own_ship/odometry", {}, lambda boat: None),
    ("more than own_ship_timeout of 5 s", {}, lambda boat: boat.sail(stamp=STAMP - 60.0)),
    ("own_ship/odometry is not used", {}, lambda boat: boat.sail(math.nan)),
    ("own_ship/odometry is not used", {}, lambda boat: boat.bridge._keep(b"none")),
    ("fix says that it has no position", TLL, lambda boat: boat.fix(10.0, 10.0, *LOST)),
    ("near a pole", TLL, lambda boat: boat.fix(89.9, 10.0)),
    ("fix is not used", TLL, lambda boat: boat.fix(math.nan, math.nan)),
    ("fix is not used: nanosec", TLL, lambda boat: boat.fix(10.0, 10.0, *NO_CLOCK)),
]


def test_without_own_ship_or_fix_nothing_is_sent_and_the_log_says_why(world, plotter):
    for words, parameters, prepare in SILENT:
        boat = connected(world, plotter, **parameters)

        def send(boat=boat, prepare=prepare):
            prepare(boat)
            boat.hold(track(8, 50.0, 1.0, 0.0, 0.0))

        said(world, words, send)
        assert plotter.read() == []
        boat.end()
