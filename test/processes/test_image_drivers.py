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
"""Images as drivers on a turning vessel send them, whole, in spokes or beam by beam: both nodes.

A target to port and one to starboard are confirmed where they are, and an offline run of the same
messages gives the same tracks to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from types import MappingProxyType
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
from msg_adapters.image_messages import DTYPES
from msg_adapters.message_input import MessageInput
from msg_adapters.sonar_images import ImageInput
from msg_adapters.track_messages import track_cloud
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
from tsepm_ros.tools.replay.offline import BagInput, offline_bag_results

START, SPEED, TURN_RATE = 1_700_000_000.0, 0.5, 0.04
NEAR, FAR, CELLS = 0.5, 30.5, 150
RANGE = NEAR + (np.arange(CELLS) + 0.5) * (FAR - NEAR) / CELLS
TARGETS = (np.array([12.3, 0.6, 6.7, 0.3]), np.array([19.4, 0.8, -5.0, 0.0]))
"""x, vx, y, vy at the start: to port and to starboard of a vessel that heads along x."""
PERIOD, POSES = 0.2, 0.1
"""Of images and of poses, s."""


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


def pings(number: int = 45) -> Iterator[tuple[float, np.ndarray]]:
    """Times and amplitudes of a sector, from starboard to port."""
    sonar = Sonar(1.6 / 48)
    for k in range(number):
        yield k * PERIOD, sonar.amplitude(SECTOR, np.full(48, k * PERIOD))


def projected() -> Iterator[tuple[float, Any]]:
    """Oculus: 8 bits, all beams of each range in turn, beams from port on."""
    beams = [Vector3(x=0.0, y=-math.sin(a), z=math.cos(a)) for a in SECTOR[::-1]]
    for t, field in pings():
        yield (
            t,
            ProjectedSonarImage(
                header=header(t),
                ping_info=PingInfo(sound_speed=1500.0),
                beam_directions=beams,
                ranges=RANGE.tolist(),
                image=table(shown(field)[::-1].T),
            ),
        )


def spokes() -> Iterator[tuple[float, Any]]:
    """A radar that turns in 2.4 s: 12 spokes a message, each at its own time."""
    sonar, step = Sonar(2.0 * math.pi / 96), 0.025
    for k in range(12 * 8):
        rows, t = (12 * k + np.arange(12)) % 96, 12 * k * step
        field = sonar.amplitude(AROUND[rows], t + step * np.arange(12))
        yield (
            t,
            RadarSector(
                header=header(t),
                angle_start=float(AROUND[rows[0]]),
                angle_increment=2.0 * math.pi / 96,
                time_increment=Duration(nanosec=round(step * 1e9)),
                range_min=float(RANGE[0]),
                range_max=float(RANGE[-1]),
                intensities=[RadarEcho(echoes=one.tolist()) for one in field],
            ),
        )


def columns() -> Iterator[tuple[float, Any]]:
    """A head that turns to and fro over the sector, one beam a message."""
    sonar = Sonar(1.6 / 48)
    for k in range(12 * 47):
        place = k % 94
        azimuth = SECTOR[place if place < 48 else 94 - place]
        t = 0.02 * k
        field = sonar.amplitude(np.array([azimuth]), np.array([t]))
        yield (
            t,
            ProjectedSonarImage(
                header=header(t),
                ping_info=PingInfo(sound_speed=1500.0),
                beam_directions=[Vector3(x=0.0, y=-math.sin(azimuth), z=math.cos(azimuth))],
                ranges=RANGE.tolist(),
                image=table(shown(field).T),
            ),
        )


class Driver(NamedTuple):
    """What a driver sends, and what is told of it beyond the coverage."""

    messages: Any
    whole: bool = False
    parameters: Mapping[str, Any] = MappingProxyType({})


DRIVERS = {
    "ProjectedSonarImage": Driver(projected),
    "RadarSector": Driver(spokes, whole=True, parameters={"sound_speed": 0.0}),
    "one column": Driver(columns),
}


def given(driver: Driver) -> tuple[dict[str, Any], dict[str, Any]]:
    """Parameters of both nodes."""
    coverage = {"sensor.min_range": NEAR, "sensor.max_range": FAR}
    if not driver.whole:
        coverage |= {"sensor.azimuth_min": -0.8, "sensor.azimuth_max": 0.8}
    detector = {"false_detections_per_ping": 5.0, "sound_speed": 1500.0, "range_extent": 0.8}
    tracker = {"method": "score", "max_speed": 3.0, "own_ship_source": "odometry"}
    return coverage | detector | dict(driver.parameters), coverage | tracker


def odometry(t: float) -> Odometry:
    x, y, yaw = pose(t)
    message = Odometry(header=make_header(round((START + t) * 1e9), "odom"), child_frame_id="boat")
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.z = math.sin(0.5 * yaw)
    message.pose.pose.orientation.w = math.cos(0.5 * yaw)
    message.pose.covariance = np.diag([1e-4, 1e-4, 0.0, 0.0, 0.0, 1e-6]).ravel()
    message.twist.twist.linear.x, message.twist.twist.angular.z = SPEED, TURN_RATE
    return message


class Recorded(NamedTuple):
    """A message of a bag, read."""

    topic: str
    log_ns: int
    content: Any


class StandInBag:
    """Messages in the order of reception: poses from before the first image to after the last."""

    def __init__(self, driver: Driver) -> None:
        images = list(driver.messages())
        times = np.arange(-0.5, images[-1][0] + 1.0, POSES)
        entries = [(t + 0.03, "image", message) for t, message in images]
        entries += [(t, "odometry", odometry(t)) for t in times.tolist()]
        self.entries = [
            Recorded(topic, round((START + t) * 1e9), content)
            for t, topic, content in sorted(entries, key=lambda one: one[0])
        ]

    def messages(self, topics: Any) -> list[Recorded]:
        return self.entries

    def read(self, message: Recorded) -> Any:
        return message.content


def offline(bag: StandInBag, driver: Driver, *, is_clean: bool = True) -> list[Any]:
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
    one = BagInput("image", session, initiator, images)
    results = list(offline_bag_results(bag, topics, [one]))
    assert not is_clean or (faults, session.dropped) == ([], {})
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


def off(point: Any, t: float, target: np.ndarray) -> float:
    """Distance of a track from a target, in standard deviations."""
    error = np.array([point["state_x"], point["state_y"]]) - truth(target, t)
    names = ("cov_00", "cov_02", "cov_20", "cov_22")
    covariance = np.array([point[name] for name in names]).reshape(2, 2)
    return float(np.sqrt(error @ np.linalg.solve(covariance, error)))


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
        points = [(one, point) for one in clouds for point in read_track_cloud(one)]
        for target in TARGETS:
            distances = [
                off(
                    point,
                    cloud.header.stamp.sec + 1e-9 * cloud.header.stamp.nanosec - START,
                    target,
                )
                for cloud, point in points
            ]
            assert min(distances) <= 3.0
    assert len(read_track_cloud(current[-1])) <= 4


@pytest.mark.parametrize("name", ["RadarSector", "one column"])
def test_targets_keep_their_tracks_where_one_message_in_ten_is_odd(name):
    driver = DRIVERS[name]
    bag, rng = StandInBag(driver), np.random.default_rng(3)
    for entry in bag.entries:
        if entry.topic == "image" and rng.random() < 0.1:
            late = rng.choice([-3e3, -1.0, 0.7, 1e5])
            at = entry.content.header.stamp.sec + 1e-9 * entry.content.header.stamp.nanosec + late
            entry.content.header = header(at - START)
    results = offline(bag, driver, is_clean=False)
    for target in TARGETS:
        near = [
            track.track_id
            for result in results
            for track in result.current
            if np.hypot(*(track.state[[0, 2]] - truth(target, result.stamp - START))) < 2.0
        ]
        assert len(near) >= 3
        assert len({*near}) == 1
