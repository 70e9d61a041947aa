"""Sonar images of a turning vessel, whole, in sectors and beam by beam, through both nodes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Vector3
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2
from support.foreign_messages import (
    PingInfo,
    ProjectedSonarImage,
    RadarEcho,
    RadarSector,
    SonarImageData,
)
from support.ros_world import RELIABLE

from msg_adapters import make_header, read_track_cloud
from msg_adapters.message_input import MessageInput
from msg_adapters.sonar_images import DTYPES, ImageInput
from msg_adapters.track_cloud import track_cloud
from tsepm_ros.nodes.sonar_detector import SonarDetector
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.settings import (
    SONAR_DETECTOR,
    TRACK_INITIATOR,
    make_groups,
    settings_from,
)
from tsepm_ros.tools.replay.offline import bag_results

START, SPEED, TURN_RATE = 1_700_000_000.0, 0.5, 0.04
NEAR, FAR, CELLS = 0.5, 30.5, 150
RANGE = NEAR + (np.arange(CELLS) + 0.5) * (FAR - NEAR) / CELLS
TARGETS = (np.array([12.3, 0.6, 6.7, 0.3]), np.array([19.4, 0.8, -5.0, 0.0]))
"""x, vx, y, vy at the start: to port and to starboard of a vessel that heads along x."""
POSES = 0.1
"""Period of poses, s."""


def pose(t: float) -> tuple[float, float, float]:
    """x, y and heading of the vessel, which turns to port."""
    yaw = TURN_RATE * t
    radius = SPEED / TURN_RATE
    return radius * math.sin(yaw), radius * (1.0 - math.cos(yaw)), yaw


def truth(target: np.ndarray, t: float) -> np.ndarray:
    return target[0::2] + t * target[1::2]


class Sonar:
    """Rayleigh speckle and the targets' echoes, of some beams at their times."""

    def __init__(self, step: float) -> None:
        self._rng, self._step = np.random.default_rng(11), step

    def amplitude(self, azimuth: np.ndarray, times: np.ndarray) -> np.ndarray:
        field = self._rng.rayleigh(1.0, (len(azimuth), CELLS))
        for row, (beam, t) in enumerate(zip(azimuth, times, strict=True)):
            x, y, yaw = pose(t)
            for target in TARGETS:
                ahead, port = truth(target, t) - [x, y]
                aside = np.angle(np.exp(1j * (beam - math.atan2(port, ahead) + yaw)))
                along = (RANGE - math.hypot(ahead, port)) / 0.3
                field[row] += 13.0 * np.exp(-0.5 * ((aside / self._step) ** 2 + along**2))
        return field


def shown(field: np.ndarray) -> np.ndarray:
    """As 8 bits."""
    return np.minimum(field * 15.0, 255.0).astype(np.uint8)


def table(values: np.ndarray) -> SonarImageData:
    values = np.ascontiguousarray(values)
    kind = DTYPES.index(values.dtype.str[1:])
    return SonarImageData(dtype=kind, beam_count=0, data=values.tobytes())


def header(t: float) -> Any:
    return make_header(round((START + t) * 1e9), "sonar")


SECTOR = -0.8 + (np.arange(48) + 0.5) * 1.6 / 48
AROUND = -math.pi + np.arange(96) * 2.0 * math.pi / 96
WATER = PingInfo(sound_speed=1500.0)


def projected(t: float, azimuth: np.ndarray, field: np.ndarray) -> ProjectedSonarImage:
    """Oculus: 8 bits, all beams of each range in turn, beams from port on."""
    return ProjectedSonarImage(
        header=header(t),
        ping_info=WATER,
        beam_directions=[Vector3(x=0.0, y=-math.sin(a), z=math.cos(a)) for a in azimuth[::-1]],
        ranges=RANGE.tolist(),
        image=table(shown(field)[::-1].T),
    )


def spokes(t: float, azimuth: np.ndarray, field: np.ndarray) -> RadarSector:
    """Of a radar."""
    return RadarSector(
        header=header(t),
        angle_start=float(azimuth[0]),
        angle_increment=2.0 * math.pi / 96,
        time_increment=Duration(nanosec=25_000_000),
        range_min=float(RANGE[0]),
        range_max=float(RANGE[-1]),
        intensities=[RadarEcho(echoes=one.tolist()) for one in field],
    )


class Driver(NamedTuple):
    """What a driver sends, by its time, azimuths and amplitudes, and what is told of it.

    By default a sector of 48 beams at once, 45 times.
    """

    message: Callable[[float, np.ndarray, np.ndarray], Any]
    number: int = 45
    period: float = 0.2
    beams: Callable[[int], np.ndarray] = lambda k: SECTOR
    beam_time: float = 0.0
    whole: bool = False

    def messages(self) -> Iterator[tuple[float, Any]]:
        """Times and messages."""
        sonar = Sonar(2.0 * math.pi / 96 if self.whole else 1.6 / 48)
        for k in range(self.number):
            t, azimuth = k * self.period, self.beams(k)
            field = sonar.amplitude(azimuth, t + self.beam_time * np.arange(len(azimuth)))
            yield t, self.message(t, azimuth, field)


def to_and_fro(k: int) -> np.ndarray:
    """The beam of a head that turns to and fro over the sector."""
    return SECTOR[[min(k % 94, 94 - k % 94)]]


DRIVERS = {
    "ProjectedSonarImage": Driver(projected),
    "RadarSector": Driver(
        spokes, 96, 0.3, lambda k: AROUND[(12 * k + np.arange(12)) % 96], 0.025, whole=True
    ),
    "one column": Driver(projected, 12 * 47, 0.02, to_and_fro),
}
"""A turn of the radar takes 2.4 s."""


def given(driver: Driver) -> tuple[dict[str, Any], dict[str, Any]]:
    """Parameters of both nodes."""
    coverage = {"sensor.min_range": NEAR, "sensor.max_range": FAR}
    if not driver.whole:
        coverage |= {"sensor.azimuth_min": -0.8, "sensor.azimuth_max": 0.8}
    detector = {"false_detections_per_ping": 5.0, "sound_speed": 1500.0, "range_extent": 0.8}
    tracker = {"method": "score", "max_speed": 3.0, "own_ship_source": "odometry"}
    return coverage | detector, coverage | tracker


def odometry(t: float) -> Odometry:
    x, y, yaw = pose(t)
    message = Odometry(header=make_header(round((START + t) * 1e9), "odom"), child_frame_id="boat")
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.z = math.sin(0.5 * yaw)
    message.pose.pose.orientation.w = math.cos(0.5 * yaw)
    message.pose.covariance = np.diag([1e-4, 1e-4, 0.0, 0.0, 0.0, 1e-6]).ravel()
    message.twist.twist.linear.x, message.twist.twist.angular.z = SPEED, TURN_RATE
    return message


class StandInBag:
    """Messages in the order of reception: poses from before the first image to after the last."""

    def __init__(self, driver: Driver) -> None:
        images = list(driver.messages())
        times = np.arange(-0.5, images[-1][0] + 1.0, POSES)
        entries = [(t + 0.03, "image", message) for t, message in images]
        entries += [(t, "odometry", odometry(t)) for t in times.tolist()]
        self.entries = [
            SimpleNamespace(topic=topic, log_ns=round((START + t) * 1e9), content=content)
            for t, topic, content in sorted(entries, key=lambda one: one[0])
        ]

    def messages(self, topics: Any) -> list[SimpleNamespace]:
        return self.entries

    def read(self, message: SimpleNamespace) -> Any:
        return message.content


def offline(bag: StandInBag, driver: Driver) -> list[Any]:
    """Results of an offline run of a bag."""
    detector, tracker = given(driver)
    groups = make_groups(TRACK_INITIATOR, tracker)
    faults: list[str] = []
    session = Session(settings_from(groups))
    images = ImageInput(
        make_groups(SONAR_DETECTOR, detector), lambda *why: faults.append(str(why)), faults.append
    )
    topics = {"detections": "image", "own_ship/odometry": "odometry"}
    initiator = MessageInput(session, groups[InitiatorNodeOptions])
    results = list(bag_results(bag, topics, session, initiator, images))
    assert (faults, session.dropped) == ([], {})
    return [result.in_frame() for result in results]


def live(world: Any, bag: StandInBag, driver: Driver, number: int) -> list[list[PointCloud2]]:
    """Messages on `tracks` and `tracks/current` of the nodes beside the driver."""
    detector, tracker = given(driver)
    heard = [world.listen(PointCloud2, topic) for topic in ("tracks", "tracks/current")]
    poses = world.observer.create_publisher(Odometry, "own_ship/odometry", RELIABLE)
    node = world.make(SonarDetector, detector)
    world.make(TrackInitiator, tracker)
    world.until_logged("subscribed to /detections")
    world.until_connected()
    for entry in bag.entries:
        if entry.topic == "odometry":
            poses.publish(entry.content)
            world.spin_once(0.0)
        else:  # the packages of most types are not there to publish with
            node.take_image(entry.content)
        made = node._input.detector.measured["images"]
        world.until(lambda made=made: len(heard[0]) >= made - 2, "the tracks of the scans before")
    world.until(lambda: {*map(len, heard)} == {number}, "an answer to every scan")
    assert world.dropped() == {}
    return heard


def off(cloud: PointCloud2, target: np.ndarray) -> list[float]:
    """Distances of a message's tracks from a target, in standard deviations."""
    t = cloud.header.stamp.sec + 1e-9 * cloud.header.stamp.nanosec - START
    found = []
    for point in read_track_cloud(cloud):
        error = np.array([point["state_x"], point["state_y"]]) - truth(target, t)
        covariance = [[point[f"cov_{row}{column}"] for column in (0, 2)] for row in (0, 2)]
        found.append(float(np.sqrt(error @ np.linalg.solve(covariance, error))))
    return found


@pytest.mark.long
@pytest.mark.parametrize("name", DRIVERS)
def test_targets_on_both_sides_are_tracked_live_and_offline_to_the_bit(world, name):
    driver = DRIVERS[name]
    bag = StandInBag(driver)
    results = offline(bag, driver)
    new, current = live(world, bag, driver, len(results))
    for result, started, held in zip(results, new, current, strict=True):
        at = make_header(result.stamp_ns, result.frame_id)
        assert bytes(started.data) == bytes(track_cloud(at, result.starts).data)
        assert bytes(held.data) == bytes(track_cloud(at, result.current).data)
    for clouds in (new, current[-1:]):
        for target in TARGETS:
            assert min(distance for cloud in clouds for distance in off(cloud, target)) <= 3.0
    assert len(read_track_cloud(current[-1])) <= 4
