"""An exception that nothing else catches ends no node: it counts, is said, and the next follows."""

from __future__ import annotations

from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from support.boat import Boat
from support.ros_world import BEST_EFFORT, LATCHED, as_messages
from support.sonar_driver import pings

from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.session.drop_reasons import REPORT_IT
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator

FAULTY = """
import sys
from rclpy.task import Future
from tsepm_ros.nodes.base_node import run
from {module} import {kind}

class Faulty({kind}):
    def __init__(self, **options):
        super().__init__(**options)
        self.left = 3
        self.steady_timer(0.02, self.planted_timer)

    def planted_timer(self):
        if self.left:
            self.left -= 1
            raise [KeyError, MemoryError, AssertionError][self.left]("planted in a timer")
        if self.left == 0:
            self.left = None
            future = self.executor.create_task(lambda: 1)
            future.add_done_callback(self.planted_callback)

    def planted_callback(self, future):
        raise TypeError("planted in a done callback")

    def {method}(self, *message):
        if getattr(message[0], "header", None) and message[0].header.frame_id == "planted":
            raise RuntimeError("planted in a subscription")
        super().{method}(*message)
        print("took a message", flush=True)

raise SystemExit(run(Faulty, sys.argv[1:]))
"""
NODES = {
    "track_initiator": ("tsepm_ros.nodes.track_initiator", "take_detections", "detections"),
    "track_bridge": ("tsepm_ros.tools.bridge.track_bridge", "_take", "tracks/current"),
}


def errors(world: Any, node: str) -> DiagnosticStatus:
    """The newest entry of a node's internal errors."""
    found = [
        status
        for message in world.diagnostics
        for status in message.status
        if status.name == f"/{node}: overall" and status.level == DiagnosticStatus.ERROR
    ]
    return found[-1] if found else DiagnosticStatus()


def counted(world: Any) -> set[str]:
    """Counts of internal errors on /diagnostics."""
    return {
        value.value
        for message in world.diagnostics
        for status in message.status
        for value in status.values
        if value.key.removeprefix("dropped.") == "internal_error"
    }


@pytest.mark.parametrize("name", NODES)
def test_exceptions_of_any_callback_are_counted_and_said_once_a_place_and_the_next_is_taken(
    world, start, name
):
    module, method, topic = NODES[name]
    pytest.importorskip("pyproj" if name == "track_bridge" else "numpy")
    kind = name.title().replace("_", "")
    script = FAULTY.format(module=module, kind=kind, method=method)
    given = {"nmea_address": "127.0.0.1:9"} if name == "track_bridge" else {}
    publisher = world.observer.create_publisher(PointCloud2, topic, LATCHED)
    node = start(name, given, script=script)
    node.provokes = True
    world.until(publisher.get_subscription_count, "the node")
    bad = PointCloud2()
    bad.header.frame_id = "planted"
    for _ in range(3):
        publisher.publish(bad)
    node.until_said("planted in a subscription")
    publisher.publish(PointCloud2())
    node.until_said("took a message")
    world.until(lambda: "7" in counted(world), "the counts of all on /diagnostics")
    assert errors(world, name).level == DiagnosticStatus.ERROR
    if name == "track_bridge":
        assert errors(world, name).message == REPORT_IT
    assert node.said.count("Traceback (most recent call last)") == 3, "one of each place"
    node.interrupt()
    assert node.exit_code() == 0


@pytest.mark.internal_error
def test_a_service_whose_callback_fails_is_answered(world, monkeypatch):
    world.provokes = True
    boat = Boat(world)
    monkeypatch.setattr(boat.node, "_on_change", lambda options: [][1])
    values = as_messages({"max_speed": 7.0})
    request = SetParameters.Request(parameters=values)
    answer = world.call(SetParameters, "/track_initiator/set_parameters", request)
    assert len(answer.results) == 0
    assert world.dropped() == {"internal_error": 1}
    assert world.status("track initiation").level == DiagnosticStatus.ERROR
    world.until_logged("IndexError", "Traceback")
    monkeypatch.setattr(boat.node._session, "reset", lambda: {}["planted"])
    assert not world.call(Trigger, "/track_initiator/reset", Trigger.Request()).success
    monkeypatch.undo()
    assert len(boat.send(pings(3))) == 3


def test_a_change_that_a_check_fails_at_is_refused_with_the_exception(world, monkeypatch):
    node = world.make(TrackInitiator)
    monkeypatch.setattr(node, "_validate", lambda options: None + 1)
    (refused,) = world.set_parameters(max_speed=7.0)
    assert "max_speed cannot be used: TypeError" in refused


ABSURD_TIMES = [(-1, 0), (-(2**31), 0), (5, 10**9), (2**31 - 1, 2**32 - 1)]


def test_times_on_clock_that_no_clock_gives_are_counted_and_the_next_is_taken(world):
    clock = world.observer.create_publisher(Clock, "/clock", BEST_EFFORT)
    node = world.make(SonarSimulator, {"use_sim_time": True})
    world.until_connected()
    for sec, nanosec in ABSURD_TIMES:
        clock.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))
        world.until_logged("a time on /clock is not used")
    clock.publish(Clock(clock=Time(sec=77)))
    world.until(lambda: node.get_clock().now().nanoseconds == 77 * 10**9, "the time")
    assert node.dropped["clock_invalid"] >= 1


def test_an_event_of_a_playback_that_fails_costs_that_event(world, monkeypatch):
    world.provokes = True
    node = world.make(SonarSimulator, {"rate_factor": 1000.0, "wait_for_subscribers": 0})
    monkeypatch.setattr(node._played.detections, "publish", lambda message: [][1])
    failed = 0
    while not node.finished.done():
        try:
            world.executor.spin_once(timeout_sec=1.0)
        except IndexError as error:
            failed += 1
            node.fail(error)
    assert failed >= 2, "each scan was tried once"
    assert node._published > failed, "and the poses between them were published"
