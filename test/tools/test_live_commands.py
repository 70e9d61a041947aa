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
"""The commands `tsepm health` and `tsepm record` beside running nodes."""

import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from functools import partial
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Image, PointCloud2
from support.boat import named
from support.pages import Watcher
from support.patience import WAIT
from support.ros_world import BEST_EFFORT, RELIABLE, remapped
from support.sonar_driver import Driver, pings

from msg_adapters import diagnostics
from tsepm_ros.diagnostics.health_figures import Level, Status
from tsepm_ros.nodes.sonar_detector import SonarDetector
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.players.scan_player import PlayerTopicRecorder
from tsepm_ros.tools.replay.bag import Bag, BagWriter


def command(world, *arguments: str, stdout: int = subprocess.PIPE) -> subprocess.Popen[str]:
    """A command of tsepm in the domain of the test."""
    line = [sys.executable, "-m", "tsepm_ros.tools.commands.cli", *arguments]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(world.domain)}
    return subprocess.Popen(line, env=environment, text=True, stdout=stdout, stderr=subprocess.PIPE)


def ended(world, process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and text of a command, while the nodes here go on."""
    world.until(lambda: process.poll() is not None, "the end of the command")
    out, error = process.communicate(timeout=WAIT)
    return process.returncode, (out or "") + error


def test_health_says_each_entry_of_every_node_or_of_the_one_named_and_ends_with_the_worst(world):
    for name in ("port", "starboard"):
        world.make(TrackInitiator, named({}), cli_args=remapped(f"__ns:=/{name}"))
    code, said = ended(world, command(world, "health", "/port/track_initiator"))
    lines = said.splitlines()
    assert code == 1, "no driver yet is a warning"
    assert lines[0].startswith("WARN  /port/track_initiator: overall: detections: no publisher")
    assert any(line.startswith("OK    /port/track_initiator: latency") for line in lines)
    assert "/starboard" not in said
    world.make(TrackInitiator, named({"detections_reliability": "reliable"}))
    driver = world.add(Driver(world.context, BEST_EFFORT))
    code, said = ended(world, command(world, "health"))
    assert driver
    assert code == 2
    assert "ERROR /track_initiator: quality of service" in said
    for name in ("port", "starboard"):
        assert f"/{name}/track_initiator: overall" in said


def test_health_imports_what_it_needs_and_no_more():
    code = (
        "import sys, tsepm_ros.tools.live_commands; from tsepm_ros.tools.commands.cli import main; "
        "print(main(['health', '--timeout', '0']), *sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    refused, *modules = done.stdout.split()
    assert refused == "2"
    assert not {"numpy", "scipy", "tsepm_ros.session.session", "msg_adapters"} & {*modules}


def test_health_of_a_detector(world):
    world.make(SonarDetector)
    code, said = ended(world, command(world, "health", "/sonar_detector"))
    assert code == 1
    assert said.startswith("WARN  /sonar_detector: overall: images: no publisher of /image yet\n")


def test_no_node_and_a_node_that_is_silent_are_stale(world):
    code, said = ended(world, command(world, "health", "--timeout", "1.5"))
    assert code == 3
    assert "no node was heard within 1.5 s" in said
    world.make(TrackInitiator, named({"diagnostics_period": 1000.0}))
    code, said = ended(world, command(world, "health", "--timeout", "2"))
    assert code == 3
    assert said == "STALE /track_initiator: no message on /diagnostics within 2 s\n"


@pytest.mark.parametrize(
    "qos",
    [
        pytest.param(RELIABLE, marks=pytest.mark.long, id="reliable"),
        pytest.param(BEST_EFFORT, id="best_effort"),
    ],
)
def test_a_recorded_bag_can_be_run(world, qos, tmp_path, capsys):
    bag = tmp_path / "trial"
    driver = world.add(Driver(world.context, qos))
    before = pings(3)
    for ping in before:
        driver.ping(ping)
    process = command(world, "record", str(bag), "detections", "nobody")
    try:
        world.until(driver.publisher.get_subscription_count, "the recorder")
        sent = pings(15)[3:]
        for ping in sent:
            driver.ping(ping)
            for _ in range(5):
                world.spin_once(0.01)
        time.sleep(1.0)  # the last message may be on its way
    finally:
        process.send_signal(signal.SIGINT)
    code, said = ended(world, process)
    assert code == 0, said
    assert "/detections: 12 messages; 3 messages were sent before the recording" in said
    assert "/nobody: 0 messages\n" in said, "of these nothing is known"
    with Bag(bag) as opened:
        assert opened.topics == {"/detections": "sensor_msgs/msg/PointCloud2"}
        assert opened.count("/detections") == 12
    assert main(["run", str(bag), "-p", "method:=tsepm", "-p", "own_ship_source:=none"]) == 0
    assert "5 hits in 5 pings, by the rule 5/8" in capsys.readouterr().out


@pytest.mark.long
def test_the_topics_of_several_sensors_are_recorded_with_the_images_as_their_node_says(
    world, tmp_path
):
    world.make(SonarDetector, cli_args=remapped("__ns:=/port", "image:=/left/picture"))
    radar = world.observer.create_publisher(PointCloud2, "/radar/echoes", RELIABLE)
    image = world.observer.create_publisher(Image, "/left/picture", RELIABLE)
    stated = world.observer.create_publisher(DiagnosticArray, "/diagnostics", 10)
    topics = {"port/detections": "/port/detections", "radar/detections": "/radar/echoes"}
    topics |= {"own_ship/odometry": "/navigation/odometry", "tracks/current": "/tracks/current"}
    values = {f"topics.{name}": topic for name, topic in topics.items()} | {"land": "0"}
    told = diagnostics(0, "/n", [Status("quality of service", Level.OK, "", values)])
    world.observer.create_timer(0.2, lambda: stated.publish(told))
    process = command(world, "record", str(tmp_path / "trial"))
    try:
        world.until(
            lambda: radar.get_subscription_count() and image.get_subscription_count() > 1,
            "the recorder",
        )
    finally:
        process.send_signal(signal.SIGINT)
    code, said = ended(world, process)
    assert code == 0, said
    recorded = [line.partition(":")[0] for line in said.splitlines() if line.endswith(" messages")]
    assert {"/port/detections", "/radar/echoes", "/left/picture", "/detections"} <= {*recorded}
    assert "/navigation/odometry" in recorded and "/tracks/current" not in recorded


@pytest.mark.parametrize(
    "name", [("_NODE_NAME_UNKNOWN_", "_NODE_NAMESPACE_UNKNOWN_"), ("gone", "/"), ("", "")]
)
def test_a_publisher_whose_node_is_not_known_yet_does_not_end_a_recording(
    world, name, tmp_path, monkeypatch, capsys
):
    make = partial(PlayerTopicRecorder, tmp_path / "trial", [], with_sensors=True)
    recorder = world.make(make)
    asked = []
    end = SimpleNamespace(node_name=name[0], node_namespace=name[1])
    monkeypatch.setattr(
        recorder, "get_publishers_info_by_topic", lambda topic: asked.append(topic) or [end]
    )
    stated = world.observer.create_publisher(DiagnosticArray, "/diagnostics", 10)
    values = {"topics.port/detections": "/port/detections"}
    told = diagnostics(0, "/n", [Status("quality of service", Level.OK, "", values)])
    world.until(lambda: asked, "the recorder", lambda: stated.publish(told))
    monkeypatch.undo()
    world.end(recorder)
    assert capsys.readouterr().out == "/port/detections: 0 messages\n"


def test_a_folder_that_exists_is_not_recorded_to(world, tmp_path):
    code, said = ended(world, command(world, "record", str(tmp_path)))
    assert code == 2
    assert f"refused: {tmp_path} exists; give a new folder" in said


def test_without_a_library_the_remedy_is_said(tmp_path, monkeypatch):
    for library in ("rosbag2_py", "rosbags.rosbag2"):
        monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ValueError, match="pip install rosbags"):
        BagWriter(tmp_path / "bag")


@pytest.mark.long
def test_watch_serves_the_live_topics_until_interrupted(world):
    rules = remapped("tracks/current:=/boat/current")
    process = command(world, "watch", "--port", "0", *rules, stdout=subprocess.DEVNULL)
    try:
        found = None
        while not found:
            line = process.stderr.readline()
            assert line, "it has ended"
            found = re.search(r"open (http://\S+)", line)
        with urllib.request.urlopen(found[1], timeout=WAIT) as page:
            assert "Tracks on /boat/current" in page.read().decode()
        with Watcher(found[1]) as watcher:
            world.until(lambda: watcher.updates, "an update")
        assert watcher.updates[0]["info"]["topic"] == "/boat/current"
    finally:
        process.send_signal(signal.SIGINT)
    assert ended(world, process)[0] == 0
