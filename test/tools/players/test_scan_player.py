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
"""The player of recordings and bags: messages as recorded, and what it refuses."""

import math
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image, PointCloud2, PointField
from support import foreign_messages
from support.bag_files import (
    GRID,
    ODOMETRY,
    PARAMETERS,
    POINTS,
    STORAGES,
    STORE,
    Entry,
    grid,
    header,
    serialized,
    simulated,
    write_bag,
)
from support.boat import named
from support.expectation import STATE
from support.live_and_offline import FAST, assert_same_live_and_offline, listen_raw
from support.ros_world import World
from support.show import (
    DETECTIONS,
    OWN_SHIP,
    SECOND,
    TARGET,
    Show,
    fields,
    heading,
    write_recording,
)
from support.sonar_driver import points, stamp_ns

from tsepm_ros.nodes.base_node import ParameterError
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.settings.parameter_files import parse_parameter_file_values
from tsepm_ros.tools.players.scan_player import ScanPlayer


@pytest.fixture
def record(tmp_path) -> Callable[..., str]:
    """Write a recording and return its folder."""
    return partial(write_recording, tmp_path)


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


def test_the_player_needs_detections_only_and_may_begin_at_the_clocks_time(world, record):
    before = time.time_ns()
    show = Show(world, ScanPlayer, recording=record(detections=DETECTIONS), start_stamp=-1.0).play()
    assert before - SECOND < stamp_ns(show.detections[0]) < time.time_ns() + SECOND
    assert list(map(len, show.topics)) == [3, 0, 0, 0, 0]
    assert show.node.count_publishers("own_ship/odometry") == 0


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


def test_the_players_start_is_added_to_recorded_stamps_and_to_the_clock(world, record):
    folder = record(detections=DETECTIONS, own_ship=OWN_SHIP)
    show = Show(world, ScanPlayer, recording=folder, start_stamp=1e9, publish_clock=True).play()
    assert stamp_ns(show.detections[0]) == (10**9 + 10) * SECOND
    assert stamp_ns(show.own_ship[0]) == (10**9 + 10) * SECOND
    times = show.times()
    assert times == sorted(times)
    assert {stamp_ns(m) for topic in (show.detections, show.own_ship) for m in topic} == set(times)


def test_the_player_may_begin_within_the_recording(world, record):
    folder = record(detections=DETECTIONS, own_ship=OWN_SHIP, target=TARGET)
    show = Show(world, ScanPlayer, recording=folder, start_offset=2.5).play()
    assert [stamp_ns(m) / SECOND for m in show.own_ship] == [12.5, 20.0]
    assert [stamp_ns(m) for m in show.detections] == [12 * SECOND + SECOND // 2, 15 * SECOND + 1]
    assert [stamp_ns(m) / SECOND for m in show.truth] == [15.0]


def test_a_recording_longer_than_what_goes_unacknowledged_arrives_whole(world, record):
    number = 700
    rows = [f"{scan},{1000 + scan},0.5" for scan in range(number)]
    content = "\n".join(["time_s,range_m,azimuth_rad", *rows, ""])
    show = Show(world, ScanPlayer, recording=record(detections=content), rate_factor=1e6).play()
    assert [stamp_ns(message) for message in show.detections] == [
        scan * SECOND for scan in range(number)
    ]


BEYOND_ROS = "time_s,range_m,azimuth_rad\n1.7e12,100,0.1\n"

LATE = "time_s,range_m,azimuth_rad\n1.7e9,100,0.1\n"

HUGE = f"time_s,range_m,azimuth_rad\n1,{'9' * 140_000},0.1\n"

TOO_LATE = "time_s,east_m,north_m\n1e10,1,2\n"

UNPLAYABLE = {
    "no_angle": ({"detections": "time_s,range_m\n1,2\n"}, {}, "recording"),
    "time_beyond_ros": ({"detections": BEYOND_ROS}, {}, "recording"),
    "huge_cell": ({"detections": HUGE}, {}, "recording"),
    "own_ship_time": ({"detections": DETECTIONS, "own_ship": TOO_LATE}, {}, "recording"),
    "no_text": ({"detections": b"\xff\xfe\x00\x01"}, {}, "recording"),
    "start_beyond_ros": ({"detections": LATE}, {"start_stamp": 1.9e9}, "start_stamp"),
    "beyond_the_end": (
        {"detections": DETECTIONS},
        {"start_offset": 6.0},
        "start_offset: 6 s is beyond the end",
    ),
}


def test_what_cannot_be_played_is_refused_with_a_sentence(world, tmp_path):
    for name, (files, parameters, said) in UNPLAYABLE.items():
        (tmp_path / name).mkdir()
        recording = write_recording(tmp_path / name, **files)
        with pytest.raises(ParameterError) as error:
            world.make(ScanPlayer, {"recording": recording, **parameters})
        assert said in str(error.value)
        assert "\n" not in str(error.value)


BOTH = pytest.mark.parametrize("storage", STORAGES)


def play(world: World, path, subscribers: int = 1, **parameters) -> ScanPlayer:
    """Play a bag to its end."""
    given = {**FAST, "wait_for_subscribers": subscribers + 1, "recording": str(path)}
    player = world.make(ScanPlayer, {**given, **parameters})
    world.until_connected()
    world.listen(PointCloud2, "detections")  # the last subscriber
    world.until(player.finished.done, "the end")
    return player


def recorded(entries, kind: str, name: str = "") -> list[bytes]:
    return [
        serialized(entry)
        for entry in entries
        if entry.type_name == kind and entry.topic.endswith(name)
    ]


@BOTH
def test_messages_are_played_byte_for_byte_under_the_nodes_names(world, tmp_path, storage):
    entries = simulated(namespace="/boat/sonar")
    detections = listen_raw(world, PointCloud2, "detections")
    own_ship = listen_raw(world, Odometry, "own_ship/odometry")
    play(world, write_bag(tmp_path / "bag", entries, storage))
    world.until(lambda: len(own_ship) == len(recorded(entries, ODOMETRY)), "the own ship")
    world.until(lambda: len(detections) == 10, "the detections")
    assert detections == recorded(entries, POINTS)
    assert own_ship == recorded(entries, ODOMETRY)


@pytest.mark.parametrize(("storage", "method"), [*zip(STORAGES, ("score", "tsepm"), strict=True)])
def test_a_bag_gives_the_same_tracks_through_the_node_and_offline(world, tmp_path, storage, method):
    path = write_bag(tmp_path / "bag", simulated(), storage)
    offline = assert_same_live_and_offline(world, path, tmp_path, *PARAMETERS, f"method:={method}")
    widths = [STORE.deserialize_cdr(data, POINTS).width for data in offline["/tracks"]]
    assert len(widths) == 10
    assert sum(widths) >= 2
    assert world.dropped() == {}


def test_a_bag_is_played_in_a_loop_without_its_corrupt_messages_from_topics_that_are_named(
    world, tmp_path
):
    entries = simulated(namespace="/a") + simulated(seed=9, namespace="/b")
    entries.append(Entry(entries[-1].time + 0.1, "/b/detections", POINTS, b"\x00\x01\x00"))
    entries.sort(key=lambda entry: entry.time)
    heard = listen_raw(world, PointCloud2, "detections")
    path = write_bag(tmp_path / "bag", entries)
    given = {"detections_topic": "/b/detections", "odometry_topic": "/a/own_ship/odometry"}
    world.make(ScanPlayer, {**FAST, **given, "recording": str(path), "loop": True})
    world.until(lambda: len(heard) >= 20, "a second time")
    assert heard[:10] == heard[10:20] == recorded(entries, POINTS, "/b/detections")[:10]
    world.until_logged("left out: ", "/b/detections", "(1 so far: ")


def test_the_images_of_a_bag_are_played_where_the_detector_hears_them(world, tmp_path):
    kind = "sensor_msgs/msg/Image"
    pixels = {"height": 2, "width": 2, "step": 2, "encoding": "mono8", "is_bigendian": 0}
    image = STORE.types[kind](header=header(1.0, "sonar"), data=np.arange(4, dtype="u1"), **pixels)
    images = [Entry(1.0, "/sonar/picture", kind, image)]
    heard = listen_raw(world, Image, "image")
    world.make(ScanPlayer, {"recording": str(write_bag(tmp_path / "bag", images))})
    world.until(lambda: heard, "the image")
    assert heard == recorded(images, kind)


def test_a_start_offset_leaves_out_what_came_before(world, tmp_path):
    entries = simulated()
    path = write_bag(tmp_path / "bag", entries)
    detections = listen_raw(world, PointCloud2, "detections")
    clock = world.listen(Clock, "/clock")
    play(world, path, start_offset=15.0, publish_clock=True)
    begin = entries[0].time + 15.0
    expected = recorded([entry for entry in entries if entry.time >= begin], POINTS)
    world.until(lambda: len(detections) == len(expected), "the detections")
    assert detections == expected
    assert 0 < len(expected) < 10
    world.until(lambda: clock, "the clock")
    times = np.array([message.clock.sec + 1e-9 * message.clock.nanosec for message in clock])
    assert times.min() >= begin - 1e-6
    assert (np.diff(times) >= 0).all()


IMPOSSIBLE = [
    ({"detections_topic": "/other"}, "recording: the bag has no topic /other"),
    ({"start_offset": 1e6}, r"start_offset: 1e\+06 s is beyond the end of the bag of"),
    ({"start_stamp": 10.0}, "start_stamp: the messages of a bag are published with"),
    ({"recording": "bag.mcap"}, r"recording: .*is no bag, whatever its name says"),
]


def test_what_a_bag_cannot_do_is_refused_with_a_sentence(world, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "bag", simulated())
    (tmp_path / "bag.mcap").write_bytes(b"no bag")
    for parameters, sentence in IMPOSSIBLE:
        with pytest.raises(ParameterError, match=sentence):
            world.make(ScanPlayer, {**FAST, "recording": "bag", **parameters})


def test_a_type_whose_package_is_not_here_is_refused_with_its_topic(world, tmp_path, monkeypatch):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    foreign_messages.remove(monkeypatch)
    store, name = get_typestore(Stores.ROS2_JAZZY), "radar_msgs/msg/RadarScan"
    store.register(get_types_from_msg("std_msgs/Header header\n", name))
    path = write_bag(tmp_path / "bag", [Entry(1.0, "/radar", name, b"")], store=store)
    with pytest.raises(ParameterError, match=f"/radar is of type {name}, whose package is not"):
        world.make(ScanPlayer, {**FAST, "recording": str(path)})


def test_a_chart_is_played_latched_and_from_the_start(world, tmp_path):
    occupied = np.ones((100, 100), bool)
    message = grid(999.0, "odom", occupied, 100.0, -5000.0, -5000.0)
    entries = [Entry(999.0, "/land", GRID, message), *simulated()]
    path = write_bag(tmp_path / "bag", entries)
    values = {
        **parse_parameter_file_values(PARAMETERS),
        "method": "score",
        "own_ship_source": "odometry",
    }
    world.make(TrackInitiator, named(values))
    tracks = world.listen(PointCloud2, "tracks")
    play(world, path, start_offset=5.0)
    world.until(lambda: len(tracks) >= 8, "the scans")
    assert sum(one.width for one in tracks) == 0
    figures = world.figures()  # of one moment: further scans may still be on their way
    assert int(figures["dropped.on_land"]) == int(figures["on_land"]) > 0
