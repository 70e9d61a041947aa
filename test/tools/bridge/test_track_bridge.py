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
"""The node that hands tracks on to plotters and navigation stacks."""

from __future__ import annotations

import json
import math
import select
import socket
import sys
from dataclasses import replace

import numpy as np
import pynmea2
import pytest
from nav_msgs.msg import Odometry
from pyproj import Geod
from rclpy.serialization import serialize_message
from sensor_msgs.msg import NavSatFix, NavSatStatus, PointCloud2
from support.ros_world import BEST_EFFORT, LATCHED
from support.sonar_driver import START_NS
from support.transforms import Transforms

pytest.importorskip("pyproj")

from msg_adapters import make_header, odometry_message, track_cloud
from tsepm_ros.nodes.base_node import ParameterError
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tools.bridge.track_bridge import TrackBridge
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackStatus

STAMP = 1_700_000_000.0


class LocalSocket(socket.socket):
    """A socket that sends to this machine alone."""

    def sendto(self, data, address):
        assert address[0].startswith("127."), "a test sends nothing to other machines"
        return super().sendto(data, address)


@pytest.fixture(autouse=True)
def _this_machine(monkeypatch):
    monkeypatch.setattr(socket, "socket", LocalSocket)


class Plotter:
    """Receives sentences, or deltas, on this machine."""

    def __init__(self, host="127.0.0.1"):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((host, 0))
        self.address = f"127.0.0.1:{self.socket.getsockname()[1]}"
        self.messages = []

    def read(self):
        while select.select([self.socket], [], [], 0.0)[0]:
            text = self.socket.recv(2000).decode("ascii")
            is_delta = text.startswith("{")
            self.messages.append(
                json.loads(text) if is_delta else pynmea2.parse(text.strip(), check=True)
            )
        return self.messages


@pytest.fixture
def plotter():
    made = Plotter()
    yield made
    made.socket.close()


def track(track_id, x, vx, y, vy, **more):
    return ConfirmedTrack(track_id, STAMP, np.array([x, vx, y, vy]), np.eye(4), (), 0.0, **more)


class Boat:
    """Publishes confirmed tracks, own ship and fixes."""

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
        with np.errstate(over="ignore"):  # x and y of a point are float32
            cloud = track_cloud(header, [one.predicted(stamp) for one in held])
        self.tracks.publish(cloud)

    def sail(self, x=0.0, y=0.0, vx=0.0, vy=0.0, stamp=STAMP):
        sample = PoseSample(stamp, x, y, 0.3, rates=(vx, vy, 0.0), frame_id=self.frame)
        self.odometry.publish(odometry_message(sample))

    def fix(self, *given, **more):
        self.fixes.publish(fix(*given, **more))


def fix(
    latitude, longitude, status=NavSatStatus.STATUS_FIX, nanosec=None, std=0.0, kind=0, sec=STAMP
):
    message = NavSatFix(latitude=latitude, longitude=longitude)
    message.header = make_header(round(sec * 1e9), "gps")
    message.header.stamp.nanosec = message.header.stamp.nanosec if nanosec is None else nanosec
    message.status.status = status
    message.position_covariance[0] = message.position_covariance[4] = std**2
    message.position_covariance_type = kind
    return message


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


def test_own_ship_without_a_stated_velocity_has_that_of_its_poses(world, plotter):
    boat = connected(world, plotter)
    stamps = iter(STAMP + 0.5 * np.arange(1e6))

    def send():
        stamp = next(stamps)
        boat.sail(5.0 * (stamp - STAMP), 0.0, stamp=stamp)  # all of its twist is 0
        still = track(8, 5.0 * (stamp - STAMP) + 926.0, 0.0, 0.0, 0.0)
        boat.hold(replace(still, stamp=stamp, age=stamp - STAMP + 9.0), stamp=stamp)

    def ahead():
        return [one.data[1:3] + one.data[7:9] for one in plotter.read()][-1:]

    wanted = ["0.500", "90.0", "0.000", "3.1"]  # miles, degrees, miles, minutes
    world.until(lambda: ahead() == [wanted], "the closest approach", send)


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


def test_a_track_that_coasts_is_lost_once_and_tracked_again_under_its_number(world, plotter):
    boat = connected(world, plotter, own_ship_source="none")
    sure = track(8, 50.0, 1.0, 0.0, 0.0)
    sentences(world, plotter, 1, lambda: boat.hold(sure))

    def told():
        return [(one.data[0], one.data[11]) for one in plotter.read()]

    for status, word in ((TrackStatus.COASTING, "L"), (TrackStatus.CONFIRMED, "T")):
        boat.hold(replace(sure, status=status))
        world.until(lambda word=word: told()[-1] == ("00", word), word)
    assert told().count(("00", "L")) == 1


def test_of_more_than_100_tracks_the_others_are_counted(world, plotter):
    boat = connected(world, plotter, own_ship_source="none")
    held = [track(k, 50.0 + k, 1.0, 0.0, 0.0) for k in range(103)]
    said(world, "tracks beyond 100 are not sent (3 so far: ", lambda: boat.hold(*held))
    sentences(world, plotter, 100, lambda: boat.hold(*held))
    assert {one.data[0] for one in plotter.read()} == {f"{k:02d}" for k in range(100)}


def test_of_tracks_those_with_a_finite_state_are_handed_on(world, plotter):
    boat = connected(world, plotter, own_ship_source="none")
    bad = ([50.0, 1.0, math.nan, 0.0], [1e154, 1.0, 0.0, 0.0], [1.0, -1.7e308, 0.0, 0.0])
    held = [*(track(k, *state) for k, state in enumerate(bad)), track(9, 1852.0, 1.0, 0.0, 0.0)]
    said(world, "a track whose state or covariance is not finite", lambda: boat.hold(*held))
    assert {one.data[1] for one in sentences(world, plotter, 1, lambda: None)} == {"1.000"}


def test_of_tracks_those_on_earth_are_handed_on_in_all_sentences(world, plotter):
    given = {"nmea_sentences": "both", "origin": "59.65,10.63", "own_ship_source": "none"}
    boat = connected(world, plotter, **given)
    near = track(9, 1852.0, 1.0, 0.0, 0.0)
    wide = ConfirmedTrack(10, STAMP, near.state, 1e300 * np.eye(4), (), 0.0)
    beyond = [track(k, *state) for k, state in enumerate(np.vstack([np.eye(4), -np.eye(4)]) * 1e30)]
    said(
        world,
        "on no place of the earth, is not handed on (9 so far: ",
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
    ("no TTM: there is no message on own_ship/odometry", {}, lambda boat: None),
    ("60 s after that of own ship", {}, lambda boat: boat.sail(stamp=STAMP - 60.0)),
    ("own_ship/odometry is not used", {}, lambda boat: boat.sail(math.nan)),
    ("fix is not used: its status says", TLL, lambda boat: boat.fix(10.0, 10.0, *LOST)),
    ("own_ship/odometry is not used", {}, lambda boat: boat.bridge._keep(b"none")),
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


def test_a_broadcast_address_reaches_what_listens_on_all_addresses(world):
    plotter = Plotter("")
    port = plotter.address.partition(":")[2]
    given = {"nmea_address": f"127.255.255.255:{port}", "own_ship_source": "none"}
    boat = connected(world, plotter, **given)
    (one,) = sentences(world, plotter, 1, lambda: boat.hold(track(8, 1852.0, 1.0, 0.0, 0.0)))
    assert one.data[1] == "1.000"
    plotter.socket.close()


class Bench:
    """A bridge with odometry at rest at the origin; fixes are handed to it."""

    def __init__(self, world, plotter, **parameters):
        given = {"nmea_sentences": "TLL", "nmea_address": plotter.address, "nmea_period": 0.0}
        self.bridge = world.make(TrackBridge, given | parameters)
        self.plotter = plotter

    def sail(self, x=0.0, y=0.0, stamp=STAMP, frame="odom", vx=0.0):
        sample = PoseSample(stamp, x, y, 0.3, rates=(vx, 0.0, 0.0), frame_id=frame)
        self.bridge._keep(serialize_message(odometry_message(sample)))

    def place(self, *given, **more):
        """Latitude and longitude of a track at the origin after a fix; none: no sentence."""
        if given:
            self.bridge._take_fix(fix(*given, **more))
        self.hold([track(8, 0.0, 0.0, 0.0, 0.0)])
        self.plotter.messages.clear()
        return [(one.latitude, one.longitude) for one in self.plotter.read()]

    def hold(self, held, frame="odom"):
        self.bridge._take(track_cloud(make_header(round(STAMP * 1e9), frame), held))

    @property
    def dropped(self):
        return self.bridge.dropped


GOOD = [(pytest.approx(59.65, abs=1e-5), pytest.approx(10.63, abs=1e-5))]
NO_POSITION = {
    "0, 0 as many receivers begin": ("no_fix", (0.0, 0.0), {}),
    "0, 0 with a covariance of no type": ("no_fix", (0.0, -0.0), {"std": 1.0}),
    "0, 0 with a covariance of zeros": ("no_fix", (1e-9, 0.0), {"kind": 2}),
    "a standard deviation of 100 km": ("fix_vague", (59.0, 10.63), {"std": 1e5, "kind": 2}),
    "one of 150 m, at the right place": ("fix_vague", (59.65, 10.63), {"std": 150.0, "kind": 1}),
    "one that is infinite": ("fix_vague", (59.65, 10.63), {"std": math.inf, "kind": 3}),
    "no stamp": ("fix_stamp", (59.65, 10.64), {"sec": 0.0}),
    "6000 km away": ("fix_jump", (0.0, 0.0), {"std": 2.0, "kind": 2}),
    "1 km away": ("fix_jump", (59.659, 10.63), {"std": 2.0, "kind": 2}),
    "from another time": ("own_ship_stale", (59.65, 10.64), {"sec": STAMP - 600.0}),
}


@pytest.mark.parametrize("fault", NO_POSITION)
def test_a_fix_that_is_no_position_moves_no_target_and_is_named(world, plotter, fault):
    reason, place, more = NO_POSITION[fault]
    bench = Bench(world, plotter)
    bench.sail()
    assert bench.place(59.65, 10.63, std=2.0, kind=2) == GOOD
    for _ in range(3):
        assert bench.place(*place, **more) == GOOD
    assert bench.dropped == {reason: 3}
    world.until(lambda: any("fix is not used: " in one.msg for one in world.log), "the sentence")
    assert bench.place(59.65, 10.63) == GOOD, "an unknown covariance alone is no fault"
    assert bench.dropped == {reason: 3}


def test_a_first_fix_that_is_no_position_ties_nothing(world, plotter):
    bench = Bench(world, plotter)
    bench.sail()
    assert bench.place(0.0, 0.0) == []
    assert bench.dropped == {"no_fix": 1, "no_position": 1}


def test_an_origin_that_jumps_is_used_once_fixes_in_a_row_agree(world, plotter):
    bench = Bench(world, plotter)
    bench.sail()
    bench.place(59.65, 10.63)
    for _ in range(3):  # now there, now here: nothing stays
        assert bench.place(59.0, 10.63) == GOOD
        assert bench.place(58.0, 10.63) == GOOD
        assert bench.place(59.65, 10.63) == GOOD
    found = [bench.place(59.0, 10.63)[0][0] for _ in range(6)]
    assert found == pytest.approx([59.65] * 4 + [59.0] * 2, abs=1e-5)
    assert bench.dropped["fix_jump"] == 10
    assert bench.place(59.0, 10.63)[0][0] == pytest.approx(59.0, abs=1e-5)


def test_what_odometry_explains_is_no_jump_also_across_180_degrees(world, plotter):
    bench = Bench(world, plotter)
    bench.sail()
    bench.place(10.0, 179.99)
    east = GeographicReference(10.0, 179.99).geographic(np.array([[5000.0, 0.0]]))[0]
    bench.sail(5000.0, stamp=STAMP + 1.0)
    ((latitude, longitude),) = bench.place(*east.tolist(), sec=STAMP + 1.0)
    assert (latitude, longitude) == pytest.approx((10.0, 179.99), abs=1e-4)
    assert bench.dropped == {}


def test_own_ship_and_tracks_in_other_frames_are_refused_with_the_remedy(world, plotter):
    bench = Bench(world, plotter, nmea_sentences="both", signal_k_address=plotter.address)
    bench.sail(frame="map")
    bench.bridge._take_fix(fix(59.65, 10.63))
    bench.hold([track(8, 50.0, 1.0, 0.0, 0.0)])
    assert plotter.read() == []
    assert bench.dropped == {"frames": 3}
    remedy = "or give own_ship_source:=tf"
    world.until(lambda: any(remedy in one.msg for one in world.log), remedy)
    bench.hold([track(8, 50.0, 1.0, 0.0, 0.0)], "/map")
    assert len(plotter.read()) == 3


def test_own_ship_comes_from_tf_in_the_frame_of_the_tracks(world, plotter, monkeypatch):
    def pose(seconds):
        return (100.0 + 5.0 * seconds, -40.0), [0.0, 0.0, 0.0, 1.0]

    start = START_NS * 1e-9
    tf = Transforms(pose, first=-20.0, last=2.0, frames=("odom", "hull"))
    tf.install(monkeypatch)
    given = {"own_ship_source": "tf", "own_ship_frame": "hull", "nmea_sentences": "both"}
    bench = Bench(world, plotter, **given)
    held = [track(8, 1952.0 + 5.0, 5.0, -40.0, 0.0)]
    cloud = track_cloud(make_header(START_NS + 10**9, "odom"), held)
    bench.bridge._take(cloud)
    (one,) = plotter.read()
    assert one.data[:3] == ["00", "1.000", "90.0"]
    assert one.data[7:9] == ["1.000", "0.0"], "it moves as own ship does"
    bench.bridge._take_fix(fix(10.0, 20.0, sec=start + 4.0))  # 2 s after the newest pose
    bench.bridge._take(cloud)
    on_earth = plotter.read()[-1]
    expected = GeographicReference(10.0, 20.0, 120.0, -40.0).geographic(np.array([1957.0, -40.0]))
    assert (on_earth.latitude, on_earth.longitude) == pytest.approx(tuple(expected[0]), abs=2e-6)
    assert bench.dropped == {"no_position": 1}
    for later, reason in ((60, "own_ship_stale"), (61, "own_ship_stale")):
        bench.bridge._take(track_cloud(make_header(START_NS + later * 10**9, "odom"), held))
        assert bench.dropped[reason] == later - 59
    bench.bridge._take(track_cloud(make_header(START_NS + 62 * 10**9, "map"), held))
    assert bench.dropped["no_own_ship"] == 1


def test_without_tf2_ros_own_ship_from_tf_is_refused(world, plotter, monkeypatch):
    monkeypatch.setitem(sys.modules, "tf2_ros", None)
    with pytest.raises(ParameterError, match="tf2_ros is not installed"):
        Bench(world, plotter, own_ship_source="tf")


def test_signal_k_gets_deltas_and_null_at_the_end_of_a_track_and_of_the_bridge(world, plotter):
    given = {"nmea_address": "", "origin": "59.65,10.63", "own_ship_source": "none"}
    bench = Bench(world, plotter, signal_k_address=plotter.address, **given)
    bench.hold([track(k, 100.0 * k, 0.0, 0.0, 2.0) for k in range(120)])
    deltas = list(plotter.read())
    assert len({one["context"] for one in deltas}) == 120, "no limit of numbers"
    assert bench.dropped == {}
    values = {one["path"]: one["value"] for one in deltas[3]["updates"][0]["values"]}
    assert values[""] == {"name": "Track 3"}
    assert values["navigation.speedOverGround"] == 2.0
    assert values["navigation.courseOverGroundTrue"] == 0.0
    plotter.messages.clear()
    bench.hold([track(k, 100.0 * k, 0.0, 0.0, 2.0) for k in range(119)])
    ends = [one for one in plotter.read() if one["updates"][0]["values"][0]["value"] is None]
    assert [one["context"] for one in ends] == [deltas[119]["context"]]
    plotter.messages.clear()
    world.end(bench.bridge)
    last = [one["context"] for one in plotter.read()]
    assert last == [one["context"] for one in deltas[:119]]


def test_ids_that_a_restarted_track_initiator_gives_again_are_other_vessels(world, plotter):
    given = {"nmea_address": "", "origin": "59.65,10.63", "own_ship_source": "none"}
    boat = connected(world, plotter, signal_k_address=plotter.address, **given)
    before = track(0, 50.0, 0.0, 0.0, 2.0, age=20.0)
    sentences(world, plotter, 1, lambda: boat.hold(before))
    boat.hold(before, stamp=STAMP + 5.0)
    after = replace(track(0, 90.0, 0.0, 0.0, 2.0), stamp=STAMP + 10.0, age=4.0)
    found = sentences(world, plotter, 4, lambda: boat.hold(after, stamp=STAMP + 10.0))
    ends = [one["updates"][0]["values"][0]["value"] is None for one in found]
    assert ends == [False, False, True, False]
    assert len({one["context"] for one in found[:3]}) == 1
    assert found[3]["context"] != found[0]["context"]


def test_a_report_that_cannot_be_sent_is_counted_with_its_address(world, plotter):
    bench = Bench(world, plotter, nmea_sentences="TTM", own_ship_source="none")

    class Full:
        def sendto(self, *_):
            raise OSError(101, "Network is unreachable")

        def close(self):
            pass

    bench.bridge._socket.close()
    bench.bridge._socket = Full()
    bench.hold([track(k, 50.0, 1.0, 0.0, 0.0) for k in range(3)])
    assert bench.dropped == {"not_sent": 3}


def test_the_bridge_says_on_diagnostics_whether_it_hands_tracks_on(world):
    world.make(TrackBridge)

    def states(task="tracks"):
        return [
            (status.level[0], status.message)
            for message in world.diagnostics
            for status in message.status
            if status.name == f"/track_bridge: {task}"
        ]

    world.until(lambda: (1, "no publisher of /tracks/current yet") in states(), "a warning")
    publisher = world.observer.create_publisher(PointCloud2, "tracks/current", LATCHED)
    said = (1, "no track message yet, though /tracks/current is published")
    world.until(lambda: said in states(), "that there is a publisher")
    header = make_header(START_NS, "odom")
    publisher.publish(track_cloud(header, [track(1, 100.0, 1.0, 200.0, 0.0)]))
    world.until(lambda: states()[-1][0] == 0, "that tracks are handed on")
    dropped = (1, "no publisher of /own_ship/odometry yet; dropped: 1 no_own_ship")
    world.until(lambda: dropped in states("own ship"), "that there is no own ship")
    world.diagnostics.clear()
    alone = (1, "no publisher of /own_ship/odometry yet")
    world.until(lambda: alone in states("own ship"), "that nothing is dropped any more")
