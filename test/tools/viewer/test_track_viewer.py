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
"""The node that shows the live topics on a page."""

from __future__ import annotations

import array
import base64
import itertools
import json
import math
import os
import re
import threading
import time
import urllib.request
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from support.boat import Boat, named
from support.pages import Watcher, confirmed_track
from support.ros_world import BEST_EFFORT, LATCHED, RELIABLE, WARN, remapped
from support.sonar_driver import cloud, pings

pytest.importorskip("tornado")

from msg_adapters import diagnostics, make_header, odometry_message, track_cloud
from tsepm_ros.diagnostics.health_figures import Level, Status
from tsepm_ros.nodes.base_node import ParameterError
from tsepm_ros.nodes.sonar_detector import SonarDetector
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.tools.viewer import track_viewer
from tsepm_ros.tools.viewer.track_viewer import TrackViewer

REMAPPED = remapped(
    "__ns:=/boat", "tracks/current:=/elsewhere/held", "own_ship/odometry:=/navigation"
)


@pytest.fixture(autouse=True)
def ros_home(tmp_path, monkeypatch):
    """A folder of its own for what the viewer keeps."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))


def tracks(stamp: float, *confirmed_tracks):
    header = make_header(round(stamp * 1e9), "odom")
    return track_cloud(header, [track.predicted(stamp) for track in confirmed_tracks])


def live(world, **node_options):
    """A viewer, and what a page of it gets."""
    viewer = world.make(TrackViewer, {"port": 0}, **node_options)
    return viewer, Watcher(viewer.url)


def test_the_page_shows_what_the_track_initiator_publishes(world):
    boat = Boat(world, publish_potential_tracks=True)
    viewer = world.make(TrackViewer, {"port": 0})
    world.until_connected()
    with Watcher(viewer.url) as watcher:
        for number, ping in enumerate(pings(12), 1):
            boat.driver.ping(ping)
            world.until(
                lambda number=number: len(watcher.frames) == number, "the frame of this ping"
            )
        world.until(lambda: watcher.frames[-1]["tracks"], "the tracks of the last ping")
        world.until(lambda: watcher.health, "the health")
        last = watcher.frames[-1]
    assert len(last["detections"]) == 2 * 11
    assert any(frame["potential"] for frame in watcher.frames)
    target = 100.0 * (3000.0 + 4.0 * 132.0), 100.0 * (1500.0 - 2.0 * 132.0)  # cm
    near = [row for row in last["tracks"] if row[1:3] == pytest.approx(target, abs=15_000.0)]
    facts = watcher.facts[str(near[0][0])]
    assert facts["confirmed"] in [frame["stamp"] for frame in watcher.frames]
    assert re.match(r"\d hits in \d pings", facts["reason"])
    tasks = {entry["task"] for entry in watcher.health["entries"]}
    assert {"track initiation", "detections", "clutter"} <= tasks


def test_a_viewer_that_joins_late_shows_the_present_tracks_at_once(world):
    publisher = world.observer.create_publisher(PointCloud2, "tracks/current", LATCHED)
    publisher.publish(tracks(100.0, confirmed_track(3, 1.0, 2.0)))
    viewer = world.make(TrackViewer, {"port": 0})
    driver = world.observer.create_publisher(PointCloud2, "detections/placed", 10)
    with Watcher(viewer.url) as watcher:
        world.until(lambda: watcher.frames, "the tracks that are held")
        world.until(
            lambda: any(update.get("info", {}).get("published") for update in watcher.updates),
            "that the publisher is known",
        )
        world.until(driver.get_subscription_count, "the viewer")
        no_time = tracks(101.0)
        no_time.header.stamp.nanosec = 10**9
        for _ in range(3):
            driver.publish(no_time)
        publisher.publish(tracks(102.0, confirmed_track(3, 1.0, 2.0)))
        world.until(lambda: watcher.frames[-1]["stamp"] == 102.0, "the scan after them")
    assert watcher.frames[0]["tracks"][0][:3] == [3, 100, 200]
    assert watcher.facts["3"]["confirmed"] is None
    unreadable = tracks(100.0, confirmed_track(3, 1.0, 2.0))
    unreadable.fields = unreadable.fields[:3]
    publisher.publish(unreadable)
    world.until_logged("a message on tracks/current cannot be shown: field 'track_id' is missing")


@pytest.mark.parametrize(
    ("qos", "viewer_first"),
    [(RELIABLE, True), (BEST_EFFORT, False)],
    ids=["volatile, viewer first", "best effort, source first"],
)
def test_sources_that_offer_less_are_shown_too(world, qos, viewer_first):
    viewer = world.make(TrackViewer, {"port": 0}) if viewer_first else None
    publisher = world.observer.create_publisher(PointCloud2, "tracks/current", qos)
    health = world.observer.create_publisher(DiagnosticArray, "/diagnostics", 10)
    viewer = viewer or world.make(TrackViewer, {"port": 0})
    with Watcher(viewer.url) as watcher:
        world.until(publisher.get_subscription_count, "the viewer to subscribe")
        world.until_connected()

        stamps = itertools.count(101.0)

        def publish():
            publisher.publish(tracks(next(stamps), confirmed_track(3, 1.0, 2.0)))
            health.publish(diagnostics(0, "n", [Status("own ship", Level.ERROR, "bad", {})]))

        world.until(lambda: watcher.frames and watcher.health, "a frame and the health", publish)
    assert watcher.health["level"] == 2


BAD = [
    ({"token": "short"}, "token must have at least 16 characters"),
    ({"origin": "59.65"}, "origin must be latitude,longitude"),
    ({"host": "no-such-host.invalid"}, "cannot be served on no-such-host.invalid"),
    ({"prot": 1}, "prot is not a parameter; did you mean port?"),
    ({"qos_overrides./nowhere.publisher.depth": 5}, "nowhere"),  # the server has started
]


def test_a_node_with_bad_parameters_is_refused_and_serves_nothing(world):
    before = threading.enumerate()
    for parameters, sentence in BAD:
        with pytest.raises(ParameterError, match=re.escape(sentence)):
            world.make(TrackViewer, {"port": 0, **parameters})
        new = [thread.name for thread in threading.enumerate() if thread not in before]
        assert "page server" not in new


def test_a_scan_is_shown_with_the_newest_pose_and_only_that_is_read(world, monkeypatch):
    read = []

    def deserialize(data, message_type):
        read.append(data)
        return deserialize_message(data, message_type)

    monkeypatch.setattr(track_viewer, "deserialize_message", deserialize)
    viewer, page = live(world)
    with page as watcher:
        for x in (1.0, 2.0, 3.0):
            pose = PoseSample(100.0, x, 2.0, 0.5, None, frame_id="odom")
            viewer._take("own_ship/odometry", serialize_message(odometry_message(pose)))
        viewer._take("tracks/current", tracks(100.0, confirmed_track(7, 10.0, 20.0)))
        world.until(lambda: watcher.frames, "the scan")
        viewer._take("tracks/current", tracks(112.0))
        world.until(lambda: len(watcher.frames) == 2, "the next scan")
    assert watcher.frames[0]["own_ship"][:2] == [300, 200]  # cm
    assert [row[0] for row in watcher.frames[0]["tracks"]] == [7]
    assert len(read) == 1


def topic_shown(watcher):
    return ([update["info"]["topic"] for update in watcher.updates if "info" in update] or [""])[-1]


def test_the_page_takes_the_remapped_topics_that_the_node_states(world):
    world.make(TrackInitiator, named({"own_ship_source": "odometry"}), cli_args=REMAPPED)
    odometry = world.observer.create_publisher(Odometry, "/navigation", 10)
    sonar = world.observer.create_publisher(PointCloud2, "/boat/detections", 10)
    _, page = live(world)
    with page as watcher:
        world.until(lambda: topic_shown(watcher) == "/elsewhere/held", "the node's topic")
        world.until(lambda: odometry.get_subscription_count() == 2, "node and page")
        world.until(sonar.get_subscription_count, "the node")

        stamps = itertools.count(101.0)

        def publish():
            stamp = next(stamps)
            pose = PoseSample(stamp, 5.0, 6.0, 0.25, None, frame_id="odom")
            odometry.publish(odometry_message(pose))
            columns = {"range": [500.0], "azimuth": [0.1]}
            sonar.publish(cloud(round((stamp - 0.5) * 1e9), columns))
            for _ in range(40):  # all callbacks of this ping, before the next
                world.spin_once(0.01)

        world.until(lambda: watcher.frames and watcher.frames[-1]["own_ship"], "own ship", publish)
    assert watcher.frames[-1]["own_ship"][:3] == [500, 600, 250]
    world.until_logged("shows /boat/track_initiator, with tracks on /elsewhere/held")


def test_a_remapping_of_the_page_s_own_is_kept(world):
    world.make(TrackInitiator, named({}), cli_args=REMAPPED)
    world.observer.create_publisher(PointCloud2, "/mine", LATCHED)
    viewer, page = live(world, cli_args=remapped("tracks/current:=/mine"))
    with page as watcher:
        world.until(lambda: len(world.diagnostics) > 3, "what the node states")
        assert topic_shown(watcher) == "/mine"
    assert "/mine" in [one.topic_name for one in viewer.subscriptions]


def test_a_page_in_a_namespace_shows_the_node_in_it_under_any_topic(world):
    for boat in ("port", "starboard"):
        arguments = remapped(f"__ns:=/{boat}", f"tracks/current:=/held/{boat}")
        world.make(TrackInitiator, named({}), cli_args=arguments)
    _, page = live(world, cli_args=remapped("__ns:=/starboard"))
    with page as watcher:
        world.until(lambda: topic_shown(watcher) == "/held/starboard", "the topic of that node")


def test_several_nodes_that_fit_are_named_and_none_is_guessed(world):
    for boat in ("port", "starboard"):
        world.make(TrackInitiator, named({}), cli_args=remapped(f"__ns:=/{boat}"))
    world.until(
        lambda: len({message.status[0].name for message in world.diagnostics}) == 2, "both nodes"
    )
    world.until(lambda: len(world.diagnostics) > 6, "their diagnostics")
    viewer, page = live(world)
    viewer._hear(world.diagnostics[-1])
    viewer._hear(world.diagnostics[-2])
    with page as watcher:
        line = world.until_logged("several nodes publish tracks", level=WARN)
        assert "/port/track_initiator" in line and "/starboard/track_initiator" in line
        assert topic_shown(watcher) == "/tracks/current"


GRIDS = [
    *[(resolution, 2, 2, 4) for resolution in (math.nan, math.inf, -math.inf, -1.0, 0.0, 3e38)],
    *[(1.0, 2, 2, 3), (1.0, 4, 1, 4), (1.0, 2**32 - 1, 2**32 - 1, 4), (1.0, 300, 300, 90_000)],
]


def grid(resolution, width, height, cells):
    message = OccupancyGrid(data=array.array("b", [7] * cells))
    message.info.resolution, message.info.width, message.info.height = resolution, width, height
    return message


def test_a_grid_that_is_no_plan_is_counted_and_the_next_is_shown(world):
    viewer = world.make(TrackViewer, {"port": 0})
    for number, wrong in enumerate(GRIDS, 1):
        viewer._take_image(grid(*wrong))
        assert (viewer._state.image, viewer.dropped["image/plan"]) == ("null", number)
    viewer._take_image(grid(1.5, 2, 2, 4))
    assert '"cell":1.5' in viewer._state.image
    world.until_logged("a message on image/plan cannot be shown", "2 x 2, 4 cells, nan m")


def ask(world, watcher, **asked):
    """Ask for something as a page does."""
    world.until(watcher.send(json.dumps(asked)).done, "the message to be sent")


def alarm_of(watcher, name):
    said = [update["info"]["alarm"] for update in watcher.updates if "info" in update]
    return said[-1][name] if said else None


def test_limits_of_the_alarms_are_parameters_that_a_page_sets_for_every_page(world):
    viewer = world.make(TrackViewer, {"port": 0, "alarm.cpa_limit": 200.0})
    with Watcher(viewer.url) as one, Watcher(viewer.url) as other:
        for page in (one, other):
            world.until(lambda page=page: alarm_of(page, "cpa_limit") == 200.0, "the parameter")
        ask(world, one, alarm={"cpa_limit": 500, "lost_targets": False})
        for page in (one, other):
            world.until(lambda page=page: alarm_of(page, "cpa_limit") == 500.0, "the new limit")
        assert viewer.get_parameter("alarm.cpa_limit").value == 500.0
        assert alarm_of(other, "lost_targets") is False
        viewer.set_parameters([Parameter("alarm.tcpa_limit", value=60.0)])
        world.until(lambda: alarm_of(one, "tcpa_limit") == 60.0, "what ros2 param has set")


def test_what_a_page_may_not_ask_for_is_refused_or_nothing_and_the_node_goes_on(world):
    viewer, page = live(world)
    with page as watcher:
        world.until(lambda: watcher.updates, "the page")
        for asked in (
            {"alarm": {"cpa_limit": [1]}},
            {"alarm": {"port": 1, "../token": 3}},
            {"alarm": 7},
            {"acknowledge": {"cpa 1": "x"}},
            {"acknowledge": [1]},
            [],
            "text",
        ):
            world.until(watcher.send(json.dumps(asked)).done, "the message to be sent")
        ask(world, watcher, alarm={"cpa_limit": math.nan})
        ask(world, watcher, alarm={"guard_max_range": 10.0, "guard_min_range": 20.0})
        world.until(
            lambda: any("below" in u.get("info", {}).get("refused", "") for u in watcher.updates),
            "the sentence on the page",
        )
        ask(world, watcher, alarm={"cpa_limit": 30.0})
        world.until(lambda: alarm_of(watcher, "cpa_limit") == 30.0, "a good limit")
    world.until_logged("a browser asked for alarms that are refused: ")
    assert viewer.get_parameter("alarm.guard_max_range").value == 0.0
    assert not viewer.dropped


def alarms_of(watcher):
    """The alarms as a page has them: state by key."""
    parts = [update["alarms"] for update in watcher.updates if "alarms" in update]
    return {one["key"]: one["state"] for one in parts[-1]["alarms"]} if parts else {}


def states_on(messages):
    """The alarms on the topic: state by key."""
    values = [{one.key: one.value for one in status.values} for status in messages[-1].status]
    names = [status.name.removeprefix("/track_viewer: ") for status in messages[-1].status]
    return {name: one["state"] for name, one in zip(names, values, strict=True) if "state" in one}


def seen(viewer, stamp, *confirmed_tracks):
    """A scan with own ship at the origin, as the middleware would bring it."""
    pose = PoseSample(stamp, 0.0, 0.0, 0.0, None, frame_id="odom", rates=(1e-3, 0.0, 0.0))
    viewer._take("own_ship/odometry", serialize_message(odometry_message(pose)))
    viewer._take("tracks/current", tracks(stamp, *confirmed_tracks))


NEAR = confirmed_track(7, 1000.0, 50.0, -8.0, 0.0)


def test_an_alarm_is_on_every_page_and_the_topic_and_acknowledged_and_silenced_by_all(world):
    viewer = world.make(TrackViewer, {"port": 0, "alarm.cpa_limit": 500.0})
    heard = world.listen(DiagnosticArray, "alarms", LATCHED)
    with Watcher(viewer.url) as one, Watcher(viewer.url) as other:
        world.until(lambda: one.updates and other.updates and heard, "the pages and the topic")
        assert heard[0].status[0].message == "watched: CPA 500 m, lost targets"
        seen(viewer, 100.0, NEAR)
        for page in (one, other):
            world.until(lambda page=page: alarms_of(page) == {"cpa 7": "unacknowledged"}, "it")
        world.until(lambda: states_on(heard) == {"cpa 7": "unacknowledged"}, "the topic")
        assert heard[-1].status[1].level == bytes([Level.ERROR])
        assert heard[-1].status[1].message.startswith("Closest approach: track 7, 50.0 ± ")
        called(world, "silence")
        world.until(lambda: states_on(heard) == {"cpa 7": "silenced"}, "the silence")
        ask(world, one, acknowledge={"cpa 7": 0, "data": 1e9, "cpa 9": 1})
        ask(world, one, silence=True)
        ask(world, one, acknowledge={"cpa 7": 1})
        world.until(lambda: alarms_of(other) == {"cpa 7": "acknowledged"}, "the other page")
        seen(viewer, 101.0, NEAR, confirmed_track(8, 2000.0, 50.0, -8.0, 0.0))
        world.until(lambda: states_on(heard).get("cpa 8") == "unacknowledged", "the second")
        called(world, "acknowledge")
        world.until(lambda: set(states_on(heard).values()) == {"acknowledged"}, "the service")
        assert heard[-1].status[1].level == bytes([Level.WARN])


def test_alarms_that_gave_way_are_counted_until_an_acknowledgement(world):
    viewer, page = live(world)
    with page as watcher:
        world.until(lambda: watcher.updates, "the page")
        viewer._alarms.left_out = 3
        ask(world, watcher, silence=True)
        ask(world, watcher, alarm={"cpa_limit": 30.0})
        world.until(lambda: alarm_of(watcher, "cpa_limit") == 30.0, "the limit")
        assert viewer._alarms.left_out == 3
        ask(world, watcher, acknowledge={"cpa 7": 1})
        world.until(lambda: viewer._alarms.left_out == 0, "the acknowledgement")


def test_a_fixed_sonar_with_an_origin_has_true_bearings_in_its_alarms_as_on_the_page(world):
    pytest.importorskip("pyproj")
    viewer = world.make(TrackViewer, {"port": 0, "origin": "59.65,10.63"})
    assert viewer._frames.north


def called(world, name):
    assert world.call(Trigger, f"track_viewer/{name}", Trigger.Request()).success


@pytest.mark.parametrize("given", [{}, {"alarm.tcpa_limit": 900.0}])
def test_limits_alarms_and_counts_outlive_the_viewer_and_a_new_start_value_counts(world, given):
    viewer = world.make(TrackViewer, {"port": 0, "alarm.tcpa_limit": 600.0})
    with Watcher(viewer.url) as watcher:
        world.until(lambda: watcher.updates, "the page")
        ask(world, watcher, alarm={"cpa_limit": 500, "tcpa_limit": 700, "gates": "0,0,0,100"})
        world.until(lambda: alarm_of(watcher, "gates") == "0,0,0,100", "the limits")
        seen(viewer, 100.0, NEAR)
        world.until(lambda: alarms_of(watcher), "the alarm")
        viewer._gates.counts = [[3, 4]]
        ask(world, watcher, acknowledge={"cpa 7": 1})
        world.until(lambda: alarms_of(watcher) == {"cpa 7": "acknowledged"}, "that")
        world.until(lambda: "[3, 4]" in kept() and '"is_acknowledged": true' in kept(), "the file")
    world.end(viewer)
    viewer = world.make(TrackViewer, {"port": 0, "alarm.tcpa_limit": 600.0, **given})
    with Watcher(viewer.url) as watcher:
        world.until(lambda: alarm_of(watcher, "cpa_limit") == 500.0, "the limit of before")
        assert alarm_of(watcher, "tcpa_limit") == given.get("alarm.tcpa_limit", 700.0)
        assert alarms_of(watcher) == {"cpa 7": "acknowledged"}
        [part] = [one["alarms"] for one in watcher.updates if "alarms" in one][-1:]
        assert part["gates"] == [[[0.0, 0.0, 0.0, 100.0], [3, 4]]]


def kept() -> str:
    path = Path(os.environ["ROS_HOME"]) / "tsepm_alarms_track_viewer.json"
    return path.read_text(encoding="utf-8") if path.exists() else ""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a letter to somebody", "it is a file of others"),
        ('{"format": "alarms of tsepm_ros 1", "limits": {"cpa', "Unterminated string"),
        ('{"format": "alarms of tsepm_ros 1"}', "cannot be used: 'given'"),
        ('{"format": "alarms of tsepm_ros 1", "given": {}, "limits": {"cpa_limit": -1.0}}', "cpa"),
    ],
)
def test_limits_that_are_lost_are_an_alarm_and_a_file_of_others_stays(world, text, words):
    path = Path(os.environ["ROS_HOME"]) / "tsepm_alarms_track_viewer.json"
    path.write_text(text, encoding="utf-8")
    viewer, page = live(world)
    with page as watcher:
        world.until(lambda: alarms_of(watcher), "the alarm")
        [part] = [one["alarms"] for one in watcher.updates if "alarms" in one][:1]
        [alarm] = part["alarms"]
        assert alarm["key"] == "limits" and words in alarm["sentence"], alarm
        seen(viewer, 100.0, NEAR)
        world.until(lambda: watcher.frames, "the scan")
    assert (path.read_text(encoding="utf-8") == text) == text.startswith("a letter")


def test_a_dead_transducer_is_an_alarm_by_the_health_of_the_node(world):
    viewer, page = live(world)
    values = {"scan_interval_s": 1.0, "no_detections": "no detection in the last 20 scans (20 s)"}
    with page as watcher:
        world.until(lambda: watcher.updates, "the page")
        viewer._hear(diagnostics(0, "/n", [Status("detections", Level.WARN, "", values)]))
        world.until(lambda: alarms_of(watcher) == {"detections": "unacknowledged"}, "the alarm")
        viewer._alarms.alarms["detections"].present -= 100.0
        fine = {"scan_interval_s": 1.0, "no_detections": ""}
        viewer._hear(diagnostics(0, "/n", [Status("detections", Level.OK, "", fine)]))
        world.until(lambda: alarms_of(watcher) == {"detections": "rectified"}, "its end")


def test_of_several_sensors_health_is_also_that_of_their_detectors_and_the_alarm_names_which(world):
    viewer, page = live(world)
    stated = {f"topics.{name}": f"/{name}" for name in ("port/detections", "tracks/current")}
    silent = {"scan_interval_s": 1.0, "no_detections": "no detection in the last 20 scans"}
    statuses = [
        Status("quality of service", Level.OK, "", stated),
        Status("port/detections", Level.WARN, "", silent),
        Status("starboard/detections", Level.OK, "", {"scan_interval_s": 1.0, "no_detections": ""}),
    ]
    with page as watcher:
        world.until(lambda: watcher.updates, "the page")
        viewer._hear(diagnostics(0, "/n", statuses))
        world.until(lambda: alarms_of(watcher) == {"detections": "unacknowledged"}, "the alarm")
        assert viewer._alarms.alarms["detections"].sentence.startswith("port: no detection")
        viewer._shown = "/n"
        for node in ("/port/sonar_detector", "/other/sonar_detector"):
            viewer._hear(diagnostics(0, node, [Status("images", Level.OK, "", {})]))
        nodes = lambda: {one["node"] for one in watcher.updates[-1].get("health", [])}  # noqa: E731
        world.until(lambda: "/port/sonar_detector" in nodes(), "the detector's health")
        assert "/other/sonar_detector" not in nodes()


def test_stamps_that_are_late_are_an_alarm_and_count_in_the_frame_those_of_a_replay_are_said(world):
    viewer, page = live(world)
    with page as watcher:
        for number, late in enumerate((20.0, 20.0, 20.0, 1e6)):
            seen(viewer, time.time() - late, NEAR)
            world.until(lambda number=number: len(watcher.frames) > number, "the scan")
        world.until(lambda: "age" in alarms_of(watcher), "the alarm")
        assert [frame["age"] for frame in watcher.frames] == [
            *[pytest.approx(20_000, abs=2000)] * 3,
            0,
        ]
    world.until_logged("stamps are of another time: set use_sim_time for a replay", level=WARN)


def test_gates_count_and_their_crossings_are_served(world):
    viewer = world.make(TrackViewer, {"port": 0, "alarm.gates": "0,0,0,100"})
    with Watcher(viewer.url) as watcher:
        for number, x in enumerate((-200.0, -100.0, 100.0, 200.0)):
            seen(viewer, 100.0 + number, confirmed_track(7, x, 50.0, 100.0, 0.0))
            world.until(lambda number=number: len(watcher.frames) > number, "the scan")
        with urllib.request.urlopen(f"{viewer.url}crossings.csv") as answer:
            lines = answer.read().decode().splitlines()
    assert lines == ["stamp,track_id,gate,direction,x,y", "102.000,7,1,to_right,300.00,50.00"]


def test_a_viewer_that_joins_after_the_source_has_stopped_knows_how_old_the_tracks_are(world):
    publisher = world.observer.create_publisher(PointCloud2, "tracks/current", LATCHED)
    publisher.publish(tracks(100.0, confirmed_track(3, 1.0, 2.0)))
    end = time.monotonic() + 1.2
    world.until(lambda: time.monotonic() > end, "some time")
    _, page = live(world)
    with page as watcher:
        world.until(lambda: watcher.frames, "the tracks that are held")
        arrived = watcher.frames[0]["arrived"]
        assert 1e3 * time.monotonic() - arrived > 1200.0
        publisher.publish(tracks(101.0, confirmed_track(3, 1.0, 2.0)))
        world.until(lambda: len(watcher.frames) == 2, "the next scan")
        assert watcher.frames[1]["arrived"] - arrived > 1000.0


def test_land_and_the_health_of_the_other_nodes_are_shown_beside_the_track_initiator_s(world):
    pytest.importorskip("pyproj")
    from tsepm_ros.tools.bridge.track_bridge import TrackBridge

    chart = OccupancyGrid(data=array.array("b", [100, 0, 0, 100, 0, 0]))
    chart.header.frame_id = "odom"
    chart.info.resolution, chart.info.width, chart.info.height = 5.0, 3, 2
    chart.info.origin.position.x, chart.info.origin.orientation.w = 7.0, 1.0
    publisher = world.observer.create_publisher(OccupancyGrid, "land", LATCHED)
    publisher.publish(chart)
    world.make(TrackInitiator, named({}))
    world.make(SonarDetector)
    world.make(TrackBridge, {"nmea_address": ""})
    viewer, page = live(world)
    with page as watcher:
        world.until(
            lambda: (
                {"/track_initiator", "/sonar_detector", "/track_bridge"}
                <= {one["node"] for update in watcher.updates for one in update.get("health", [])}
            ),
            "the health of the three",
        )
        world.until(lambda: any("land" in update for update in watcher.updates), "the land")
        chart.data = chart.data[:5]
        publisher.publish(chart)
        world.until(lambda: viewer.dropped["land"], "the chart that cannot be read")
    [land] = [update["land"] for update in watcher.updates if "land" in update]
    assert (land["cell"], land["width"], land["origin"]) == (5.0, 3, [7.0, 0.0, 0.0])
    assert base64.b64decode(land["bits"]) == bytes([0b10010000])
    newest = [update["health"] for update in watcher.updates if "health" in update][-1]
    entries = {one["node"]: one["entries"] for one in newest}
    tasks = [entry["task"] for entry in entries["/track_bridge"]]
    assert tasks == ["tracks", "own ship", "fix", "node"]
    assert len(entries["/track_initiator"]) > 5


def health(level, *, node="/n", task="own ship", **topics):
    values = [KeyValue(key=f"topics.{name}", value=value) for name, value in topics.items()]
    status = DiagnosticStatus(name=f"{node}: {task}", hardware_id=node, level=bytes([level]))
    status.values = values
    return DiagnosticArray(status=[status])


def test_a_level_that_no_diagnostics_have_is_an_error_and_the_page_goes_on(world):
    viewer, page = live(world)
    with page as watcher:
        for level, shown in ((7, 2), (255, 2), (0, 0)):
            viewer._hear(health(level))
            world.until(lambda: watcher.health, "the health")
            world.until(lambda shown=shown: watcher.health["level"] == shown, "that level")


def test_topics_that_another_node_states_and_no_topic_may_have_are_not_followed(world):
    viewer = world.make(TrackViewer, {"port": 0})
    stated = {"node": "/n", "task": "quality of service"}
    for name in ("", "/no topic", "/a//b", "/7", "/t\u00e4"):
        viewer._hear(health(0, **stated, **{"tracks/current": name}))
    viewer._hear(health(0, **stated, detections="/detections"))
    viewer._check_publisher()
    assert not viewer._stated
    viewer._hear(health(0, **stated, **{"tracks/current": "/held"}))
    assert viewer._stated == {"/n": {"tracks/current": "/held"}}


def test_bytes_that_are_no_odometry_and_a_pose_off_the_earth_are_counted(world):
    viewer, page = live(world)
    with page as watcher:
        far = PoseSample(99.0, 1e300, 2.0, 0.5, None, frame_id="odom")
        near = PoseSample(99.5, 3.0, 2.0, 0.5, None, frame_id="odom")
        for number, data in enumerate(
            (
                b"",
                b"\0\1\0\0" + b"\xff" * 30,
                *map(serialize_message, map(odometry_message, (far, near))),
            )
        ):
            viewer._take("own_ship/odometry", data)
            viewer._take("tracks/current", tracks(100.0 + number, confirmed_track(7, 10.0, 20.0)))
            world.until(lambda number=number: len(watcher.frames) > number, "the scan")
    assert [bool(frame["own_ship"]) for frame in watcher.frames] == [False, False, False, True]
    assert viewer.dropped["own_ship/odometry"] == 3


def test_an_exception_in_the_server_s_thread_is_counted_and_the_next_scan_is_shown(
    world, monkeypatch
):
    world.provokes = True
    viewer, page = live(world)
    with page as watcher:
        monkeypatch.setattr(viewer._frames, "take", lambda topic, message: [][1])
        viewer._take("tracks/current", tracks(100.0, confirmed_track(7, 10.0, 20.0)))
        world.until_logged("IndexError", "Traceback")
        monkeypatch.undo()
        viewer._take("tracks/current", tracks(112.0, confirmed_track(7, 10.0, 20.0)))
        world.until(lambda: watcher.frames, "the next scan")
        world.until(
            lambda: any(
                status.name == "/track_viewer: overall" and status.level == bytes([Level.ERROR])
                for message in world.diagnostics
                for status in message.status
            ),
            "the error on /diagnostics",
        )
