"""The example tracker beside the simulator and the initiator: it follows and feeds back."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from kalman_tracker import KalmanTracker
from sensor_msgs.msg import PointCloud2
from support.expectation import COVARIANCE, STATE
from support.ros_world import LATCHED, RELIABLE, WARN, World
from support.sonar_driver import START_NS, points, stamp_ns

from msg_adapters import PlacedDetections, make_header, placed_detections_cloud, track_cloud
from tsepm_ros import ConfirmedTrack
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator

EXAMPLES = Path(__file__).parents[2] / "examples"
NUMBERS = (*STATE, *COVARIANCE)
SECOND = 10**9
SCANS, PERIOD = 24, 12.0
TARGETS = ((3000.0, 4.0, 1500.0, -2.0), (-2500.0, 0.0, 2500.0, 4.0), (500.0, -3.0, -4000.0, 3.0))
SCENARIO = f"""
scans: {SCANS}
period: {PERIOD}
sound_speed: 1500.0
sensor: {{detection_probability: 0.95, clutter_density: 1.0e-7}}
own_ship: {{x: 100.0, y: -50.0, yaw_deg: 40.0, speed: 3.0, turn_rate_deg: 0.2}}
targets: [{", ".join(f"{{state: {list(target)}}}" for target in TARGETS)}]
"""
NEAR = 250.0
"""Of a target: 3 sigma of the bearing error at the farthest, m. They are 4 km apart."""


class Play:
    """A simulated sea, the initiator, and the tracker; everything that they say."""

    def __init__(self, world: World, scenario: Path, **initiator: float) -> None:
        self.world = world
        scenario.write_text(SCENARIO)
        self.tracks = world.listen(PointCloud2, "tracks")
        self.current = world.listen(PointCloud2, "tracks/current", LATCHED)
        self.tracked = world.listen(PointCloud2, "tracked")
        given = {
            "method": "score",
            "own_ship_source": "odometry",
            "sensor.clutter_density": 1e-7,
            "sensor.detection_probability": 0.95,
            "own_ship_timeout": 20.0,  # of the wall's clock, which runs ahead on a busy machine
            "diagnostics_period": 0.05,
        }
        world.make(TrackInitiator, {**given, **initiator})
        self.start_tracker()
        world.until_connected()
        simulated = {
            "scenario": str(scenario),
            "seed": 3,
            "rate_factor": 50.0,  # a quarter of a second for the answer to each ping
            "own_ship_rate": 0.25,
            "settling_time": 0.1,
        }
        world.make(SonarSimulator, simulated)

    def start_tracker(self) -> None:
        self.tracker = self.world.make(KalmanTracker)

    def until(self, scan: int) -> Play:
        """Play until the initiator has processed a number of scans, and the tracker, if any."""
        self.world.until(lambda: len(self.current) >= scan, f"scan {scan}")
        return self

    def answered(self) -> Play:
        """Wait until the tracker has answered the newest scan."""
        newest = stamp_ns(self.current[-1])
        self.world.until(
            lambda: self.tracked and stamp_ns(self.tracked[-1]) >= newest, "the tracker's answer"
        )
        return self


def near(message: PointCloud2) -> list[list[int]]:
    """Ids of the tracks of a message near each target."""
    time = stamp_ns(message) * 1e-9
    states = np.array([[one[name] for name in STATE] for one in points(message)]).reshape(-1, 4)
    ids = np.array([one["track_id"] for one in points(message)], int)
    found = []
    for x, vx, y, vy in TARGETS:
        distance = np.hypot(states[:, 0] - x - vx * time, states[:, 2] - y - vy * time)
        found.append(ids[distance <= NEAR].tolist())
    return found


def ids(message: PointCloud2) -> set[int]:
    return {int(one["track_id"]) for one in points(message)}


@pytest.fixture
def scenario(tmp_path) -> Path:
    return tmp_path / "scene.yaml"


def test_targets_are_started_once_and_followed_to_the_end(world, scenario):
    play = Play(world, scenario).until(SCANS).answered()
    assert [stamp_ns(one) for one in play.tracked] == [stamp_ns(one) for one in play.tracks]
    started = [[one for message in play.tracks for one in near(message)[k]] for k in range(3)]
    assert [len(one) for one in started] == [1, 1, 1], "each target is started once"
    assert near(play.tracked[-1]) == started, "and followed under the id of its start"
    assert world.figures()["tracker"] == "alive"
    assert world.dropped() == {}
    for start, said in zip(play.tracks, play.tracked, strict=True):
        told = {one["track_id"]: one for one in points(said)}
        for one in points(start):  # goes back unchanged at its own ping, with its covariance
            assert [told[one["track_id"]][name] for name in NUMBERS] == [one[n] for n in NUMBERS]
    for said, held, new in zip(play.tracked[:-1], play.current[1:], play.tracks[1:], strict=True):
        assert ids(held) == ids(said) | ids(new), "the initiator holds what was said before"


def test_tracks_of_a_tracker_that_dies_are_held_until_it_is_started_again(world, scenario):
    play = Play(world, scenario, tracked_timeout=30.0).until(SCANS - 12).answered()
    followed = near(play.tracked[-1])
    assert [len(one) for one in followed] == [1, 1, 1]
    world.end(play.tracker)
    before = len(play.tracked)
    play.until(SCANS - 6)
    assert world.figures()["tracker"] == "silent"
    assert near(play.current[-1]) == followed
    play.start_tracker()
    play.until(SCANS).answered()
    assert len(play.tracked) > before
    assert all(near(one) == followed for one in play.tracked[before:])
    assert sum(len(one) for message in play.tracks for one in near(message)) == len(TARGETS)


class Alone:
    """The tracker without an initiator: what that would say is said by hand."""

    TRACK = ConfirmedTrack(
        7, 0.0, np.array([3000.0, 4.0, 1500.0, -2.0]), np.diag([1e4, 1.0, 1e4, 1.0]), (), 0.0
    )

    def __init__(self, world: World) -> None:
        self.world = world
        qos = {"tracks": RELIABLE, "tracks/current": LATCHED, "detections/placed": RELIABLE}
        self.publisher = {
            topic: world.observer.create_publisher(PointCloud2, topic, one)
            for topic, one in qos.items()
        }
        self.tracked = world.listen(PointCloud2, "tracked")
        self.tracker = world.make(KalmanTracker)
        world.until_connected()

    def say(self, topic: str, after: float, *tracks: ConfirmedTrack) -> None:
        header = make_header(START_NS + round(after * SECOND), "sonar")
        self.publisher[topic].publish(track_cloud(header, tracks))

    def detect(self, after: float) -> None:
        """A ping that sees the track at its place of then, and something else."""
        x, vx, y, vy = self.TRACK.state
        placed = PlacedDetections(
            position=np.array([[x + vx * after, y + vy * after], [-200.0, -450.0]]),
            covariance=np.stack([900.0 * np.eye(2)] * 2),
            time_offset=np.zeros(2),
        )
        header = make_header(START_NS + round(after * SECOND), "sonar")
        self.publisher["detections/placed"].publish(placed_detections_cloud(header, placed))

    def until_waiting(self, pings: int, placed: int) -> None:
        tracker = self.tracker
        self.world.until(
            lambda: (len(tracker._waiting), len(tracker._placed)) == (pings, placed),
            f"{pings} pings and the detections of {placed} to be there",
        )

    def answers(self, *after: float) -> list[set[int]]:
        """Wait for answers to pings at these times, and no others; returns the ids of each."""
        self.world.until(lambda: len(self.tracked) >= len(after), "answers")
        times = [(stamp_ns(message) - START_NS) / SECOND for message in self.tracked]
        assert times == list(after)
        return [ids(message) for message in self.tracked]


def test_it_says_nothing_of_what_it_does_not_know_and_starts_over_with_time(world):
    alone = Alone(world)
    for after in (0.0, 12.0):
        alone.say("tracks", after)
        alone.detect(after)
    alone.until_waiting(2, 2)
    assert not alone.tracked, "what is held is not known"
    alone.say("tracks/current", 0.0, alone.TRACK)
    assert alone.answers(12.0) == [{7}]
    alone.say("tracks", 24.0)  # a ping that lacks its detections
    alone.say("tracks", 36.0)
    alone.detect(36.0)
    assert alone.answers(12.0, 36.0) == [{7}, {7}]
    world.until_logged("passed over", level=WARN)
    assert alone.tracker._tracker.targets[7].misses == 0
    [said] = points(alone.tracked[-1])
    np.testing.assert_allclose([said[name] for name in STATE], [3144.0, 4.0, 1428.0, -2.0])
    alone.say("tracks", -1000.0)
    alone.detect(-1000.0)
    assert alone.answers(12.0, 36.0, -1000.0)[-1] == set()
    world.until_logged("time went back", level=WARN)


def test_an_interrupt_ends_it_cleanly(start):
    process = start("kalman_tracker", script=EXAMPLES / "kalman_tracker.py")
    process.until_said("waiting for tracks/current")
    process.interrupt()
    assert process.exit_code() == 0
    assert "Traceback" not in process.said


@pytest.mark.parametrize("name", ["kalman_tracker", "nearest_neighbour"])
def test_the_example_imports_of_the_package_only_what_is_public(name):
    tree = ast.parse((EXAMPLES / f"{name}.py").read_text(encoding="utf-8"))
    named = [one.module or "" for one in ast.walk(tree) if isinstance(one, ast.ImportFrom)]
    ours = {one for one in named if one.partition(".")[0] in ("tsepm_ros", "msg_adapters")}
    assert ours and ours <= {"tsepm_ros", "msg_adapters"}
