"""The executables as processes: together over DDS, their ends, and what they refuse."""

import signal
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from support.expectation import assert_same, initiator
from support.patience import WAIT
from support.ros_process import RosProcess
from support.sonar_driver import Driver, pings, points, stamp_ns

from tsepm_ros.settings.settings import NODES, full_table
from tsepm_ros.tools.simulation import Simulator, load_scenario

SECOND = 10**9
EXECUTABLES = ("track_initiator", "sonar_detector", "sonar_simulator", "scan_player")
SIGNALS = pytest.mark.parametrize(
    "number",
    [
        pytest.param(signal.SIGINT, id="SIGINT"),
        pytest.param(signal.SIGTERM, marks=pytest.mark.long, id="SIGTERM"),
    ],
)

MOVING_SHIP = """
scans: 20
period: 12.0
sound_speed: 1500.0
own_ship: {speed: 3.0, turn_rate_deg: 0.2}
targets: [{state: [3000.0, 4.0, 1500.0, -2.0]}]
"""


@pytest.fixture
def recording(tmp_path) -> str:
    rows = [f"{12 * scan},{1000 + scan},0.5" for scan in range(20)]
    folder = tmp_path / "recording"
    folder.mkdir()
    (folder / "detections.csv").write_text("\n".join(["time_s,range_m,azimuth_rad", *rows, ""]))
    return str(folder)


@pytest.fixture
def given(recording) -> dict[str, dict[str, Any]]:
    """Parameters of each executable."""
    return {
        "track_initiator": {"diagnostics_period": 0.05},
        "sonar_detector": {},
        "sonar_simulator": {"settling_time": 0.1},
        "scan_player": {"settling_time": 0.1, "recording": recording},
    }


def assert_clean_end(process: RosProcess) -> None:
    code = process.exit_code()
    assert code == 0, f"{process.name} ended with {code}: {process.said}"
    for word in ("Traceback", "Error", "Exception", "terminate called"):
        assert word not in process.said


@pytest.mark.parametrize("name", EXECUTABLES)
def test_a_node_also_runs_as_a_module(start, name):
    package = "nodes" if name in ("track_initiator", "sonar_detector") else "tools.players"
    module = f"tsepm_ros.{package}.{name}"
    script = f"import runpy; runpy.run_module('{module}', run_name='__main__')"
    process = start(name, {"nonsense": 1}, script=script)
    assert process.exit_code() == 2
    assert "nonsense is not a parameter" in process.said


WHILE_IT_IS_MADE = """
import os, signal, sys, time
from rclpy.node import Node
from tsepm_ros.ending_signals import {name} as main

create_publisher = Node.create_publisher

def interrupted(self, *args, **options):
    os.kill(os.getpid(), signal.{signal})
    while self.context.ok():
        time.sleep(0.001)
    return create_publisher(self, *args, **options)

Node.create_publisher = interrupted
sys.exit(main())
"""


@SIGNALS
def test_a_signal_ends_every_executable_while_its_node_is_made(start, given, number):
    processes = [
        start(name, given[name], script=WHILE_IT_IS_MADE.format(name=name, signal=number.name))
        for name in EXECUTABLES
    ]
    for process in processes:
        assert_clean_end(process)


def test_a_signal_ends_every_executable_as_soon_as_it_speaks(start, given):
    processes = [start(name, given[name]) for name in EXECUTABLES]
    for process, number in zip(processes, 2 * (signal.SIGTERM, signal.SIGINT), strict=True):
        process.until_said("waiting for")
        process.interrupt(number)
    for process in processes:
        assert_clean_end(process)


@SIGNALS
def test_a_signal_ends_every_executable_while_it_waits(start, given, number):
    processes = [start(name, given[name]) for name in EXECUTABLES]
    for process in processes:
        process.until_said("waiting for")
    processes[-1].wait_for(0.3)  # nothing tells that they wait
    for process in processes:
        process.interrupt(number)
    for process in processes:
        assert_clean_end(process)


SUBSCRIBER_GONE = """
import sys, time
from rclpy.publisher import Publisher
from tsepm_ros.tools.players import playback
from tsepm_ros.tools.players.scan_player import main

def wait_for_all_acked(self, timeout):
    print("waiting for acknowledgement", flush=True)
    time.sleep(timeout.nanoseconds * 1e-9)
    return False

Publisher.get_subscription_count = lambda self: 1
Publisher.wait_for_all_acked = wait_for_all_acked
playback.MAX_ACKNOWLEDGE_TIME = 3600.0  # so that only the signal ends the wait
sys.exit(main())
"""


def test_a_signal_ends_a_source_whose_subscriber_is_gone(start, given):
    parameters = {**given["scan_player"], "rate_factor": 1e6}
    process = start("scan_player", parameters, script=SUBSCRIBER_GONE)
    process.until_said("waiting for acknowledgement")
    process.interrupt(signal.SIGTERM)
    assert_clean_end(process)


@SIGNALS
@pytest.mark.parametrize("name", ["sonar_simulator", "scan_player"])
def test_a_signal_ends_a_source_in_the_middle_of_traffic(world, start, given, number, name):
    detections = world.listen(PointCloud2, "detections")
    process = start(name, {**given[name], "rate_factor": 1000.0, "loop": True})
    world.until(lambda: len(detections) > 10, "traffic")
    process.interrupt(number)
    world.until(lambda: not process.running, "the end")
    assert_clean_end(process)


@SIGNALS
def test_a_signal_ends_the_initiator_in_the_middle_of_traffic(world, start, given, number):
    driver = world.add(Driver(world.context))
    tracks = world.listen(PointCloud2, "tracks")
    process = start("track_initiator", given["track_initiator"])
    world.until(driver.publisher.get_subscription_count, "the initiator")
    world.until(lambda: tracks.subscription.get_publisher_count(), "its tracks")
    sent = iter(pings(5000, clutter=100))
    driver.create_timer(0.005, lambda: driver.ping(next(sent)))
    world.until(lambda: len(tracks) > 10, "traffic")
    process.interrupt(number)
    world.until(lambda: not process.running, "the end")
    assert_clean_end(process)


@pytest.mark.long
@pytest.mark.parametrize("pause", [0.0, 0.02], ids=["at_once", "20_ms"])
def test_a_second_interrupt_does_no_harm(world, start, given, pause):
    """As from a terminal and its launcher both."""
    process = start("track_initiator", given["track_initiator"])
    world.until(lambda: world.diagnostics, "the initiator at work")
    process.interrupt()
    process.wait_for(pause)
    process.interrupt()
    assert_clean_end(process)


def test_simulator_and_initiator_find_the_targets_over_dds(world, start):
    tracks = world.listen(PointCloud2, "tracks")
    initiator_process = start("track_initiator", {"method": "tsepm", "diagnostics_period": 0.05})
    world.until(lambda: tracks.subscription.get_publisher_count(), "the initiator")
    simulator = start("sonar_simulator", {"rate_factor": 1000.0, "seed": 3, "settling_time": 0.3})
    scans = list(Simulator(load_scenario("four_targets"), 3))
    world.until(lambda: len(tracks) == len(scans), "tracks of every scan")
    same = initiator()
    assert_same(tracks, [same.process(simulated.scan) for simulated in scans])
    assert [stamp_ns(message) for message in tracks] == [
        round(simulated.scan.stamp * SECOND) for simulated in scans
    ]
    for target in scans[-1].truth:
        near = [
            np.hypot(
                point["x"] - target[0] + target[1] * (scans[-1].scan.stamp - seconds),
                point["y"] - target[2] + target[3] * (scans[-1].scan.stamp - seconds),
            )
            for message in tracks
            for seconds in [stamp_ns(message) / SECOND]
            for point in points(message)
        ]
        assert min(near) < 500.0, "every target is started"
    assert world.dropped() == {}
    assert_clean_end(simulator)  # by itself
    assert "finished" in simulator.said
    initiator_process.interrupt()
    assert_clean_end(initiator_process)


def test_a_moving_ship_in_fast_simulated_time_loses_no_scan_over_dds(world, start, tmp_path):
    scenario = tmp_path / "moving.yaml"
    scenario.write_text(MOVING_SHIP)
    tracks = world.listen(PointCloud2, "tracks")
    parameters = {"own_ship_source": "odometry", "use_sim_time": True, "diagnostics_period": 0.05}
    parameters["own_ship_timeout"] = WAIT  # a fraction of what passes in simulated time
    start("track_initiator", parameters)
    world.until(lambda: tracks.subscription.get_publisher_count(), "the initiator")
    parameters = {"rate_factor": 1e5, "publish_clock": True, "scenario": scenario}
    parameters["settling_time"] = 0.3
    start("sonar_simulator", parameters)
    world.until(lambda: len(tracks) == 20 or world.dropped(), "tracks of every scan")
    assert world.dropped() == {}
    assert {message.header.frame_id for message in tracks} == {"odom"}
    assert any(message.width for message in tracks)


REFUSED = {
    "integer_for_double": ("track_initiator", {"max_speed": 4}, "max_speed"),
    "no_recording": ("scan_player", {"recording": "/no/such"}, "detections.csv"),
    "no_scenario": ("sonar_simulator", {"scenario": "/no/such.yaml"}, "/no/such.yaml"),
}


def test_a_bad_parameter_ends_an_executable_with_2_and_one_sentence(start):
    processes = {case: start(name, parameters) for case, (name, parameters, _) in REFUSED.items()}
    for case, process in processes.items():
        assert process.exit_code() == 2, process.said
        [sentence] = process.said.splitlines()
        assert REFUSED[case][2] in sentence


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(["--params-file", "/no/such.yaml"], id="missing_parameter_file"),
        pytest.param(["--no-such-flag"], id="unknown_flag"),
    ],
)
def test_a_bad_command_line_ends_an_executable_with_2_and_a_sentence(start, arguments):
    process = start("track_initiator", arguments=arguments)
    assert process.exit_code() == 2, process.said
    assert "Traceback" not in process.said
    assert arguments[-1] in process.said.splitlines()[-1]


def test_help_is_usage_with_the_parameters_before_ros_starts(start):
    """A log folder that cannot be made shows that ROS would have started."""
    script = (
        "import sys, rclpy; sys.argv = ['x', '{flag}']; rclpy.init = None\n"
        "from tsepm_ros.ending_signals import {name} as main; sys.exit(main())"
    )
    for name, flag in zip(EXECUTABLES, 2 * ("-h", "--help"), strict=True):
        process = start(name, script=script.format(flag=flag, name=name))
        assert process.exit_code() == 0, process.said
        text = process.said
        assert text.startswith(f"usage: ros2 run tsepm_ros {name}")
        for part in (f"tsepm parameters {name}", "docs/parameters.md", "--ros-args"):
            assert part in text.replace("\n  ", " ")
        for row in full_table(NODES[name]):
            assert row.name.rpartition(".")[2] in text


def test_an_argument_outside_of_ros_args_is_refused(start):
    """ROS itself ignores it: a user who forgets --ros-args would get the defaults."""
    script = (
        "import sys; sys.argv = ['track_initiator', '-p', 'max_speed:=5.0']\n"
        "from tsepm_ros.nodes.track_initiator import main; sys.exit(main())"
    )
    process = start("track_initiator", script=script)
    assert process.exit_code() == 2
    [sentence] = process.said.splitlines()
    assert "'-p'" in sentence and "--ros-args" in sentence


def test_a_parameter_file_sets_parameters_of_an_executable(world, start, tmp_path):
    path = tmp_path / "parameters.yaml"
    path.write_text("track_initiator:\n  ros__parameters:\n    diagnostics_period: 0.06\n")
    start("track_initiator", arguments=["--params-file", str(path)])
    for _ in range(5):
        world.statuses()
