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
"""The node that makes detections of images, alone and before the track initiator."""

from __future__ import annotations

import time

import numpy as np
import pytest
from nav_msgs.msg import OccupancyGrid, Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image, PointCloud2
from support import foreign_messages as foreign
from support.ros_world import BEST_EFFORT, ERROR, RELIABLE, WARN, remapped
from support.transforms import Transforms
from visualization_msgs.msg import MarkerArray

from msg_adapters import make_header, odometry_message, read_detections
from tsepm_ros.detector.detector import Detector
from tsepm_ros.nodes.base_node import ParameterError
from tsepm_ros.nodes.pace import Pace
from tsepm_ros.nodes.sonar_detector import SonarDetector
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.own_ship.pose_history import PoseSample

BEAMS, CELLS = 64, 200
COVERAGE = {
    "sensor.min_range": 0.5,
    "sensor.max_range": 40.5,
    "sensor.azimuth_min": -0.8,
    "sensor.azimuth_max": 0.8,
}
ROWS = {"image.near_range": 0.6, "image.far_range": 40.4}
STAMP = 1_700_000_000.0


class Sonar:
    """Publishes a forward-looking sonar's images, as displayed: far above, port at the left."""

    def __init__(self, world, seed=3, interval=0.2, topic="image"):
        self.interval = interval
        self.publisher = world.observer.create_publisher(Image, topic, RELIABLE)
        self.rng = np.random.default_rng(seed)
        self.number = 0

    def ping(self, *targets, encoding="mono8"):
        """Rayleigh speckle and targets (range, m, and azimuth, rad, to port)."""
        field = self.rng.rayleigh(1.0, (BEAMS, CELLS))
        for range_, azimuth in targets:
            row = (azimuth + 0.8) / 1.6 * BEAMS - 0.5
            column = (range_ - 0.5) / 40.0 * CELLS - 0.5
            y, x = np.ogrid[:BEAMS, :CELLS]
            field += 12.0 * np.exp(-0.5 * ((y - row) ** 2 + ((x - column) / 2.0) ** 2))
        picture = np.minimum(field * 15.0, 255.0).astype(np.uint8)
        displayed = picture[::-1].T[::-1]
        message = Image(
            header=make_header(round((STAMP + self.interval * self.number) * 1e9), "sonar"),
            height=CELLS,
            width=BEAMS if encoding == "mono8" else BEAMS // 3,
            step=BEAMS,
            encoding=encoding,
            data=np.ascontiguousarray(displayed).tobytes(),
        )
        self.number += 1
        self.publisher.publish(message)


def pings(world, sonar, heard, number, targets=lambda k: ()):
    """So many pings more, each as soon as the answer to the last is there."""
    before = len(heard)
    for k in range(number):
        sonar.ping(*targets(k))
        world.until(lambda k=k: len(heard) > before + k, "the detections of a ping")
    return heard


def detecting(world, interval=0.2, **parameters):
    """A detector that has found its sonar, and its detections."""
    sonar, heard = Sonar(world, interval=interval), world.listen(PointCloud2, "detections")
    world.make(SonarDetector, COVERAGE | ROWS | parameters)
    world.until_logged("subscribed to /image as sensor_msgs/msg/Image")
    world.until_connected()
    return sonar, heard


def test_targets_to_port_and_to_starboard_are_detected_and_shown_where_they_are(world):
    markers = world.listen(MarkerArray, "detections/markers")
    images = world.listen(Image, "image/normalised")
    given = {"publish_normalised": True, "false_detections_per_ping": 20.0}
    sonar, heard = detecting(world, **given)
    plans = world.listen(OccupancyGrid, "image/plan")
    world.until_connected()
    begin = time.monotonic()
    places = [(15.0, 0.4), (25.0, -0.3)]
    clouds = pings(world, sonar, heard, 30, lambda k: places)
    world.until_logged("top left is 40.4 m at 45.12 degrees to port, top right is 40.4 m")
    found = [read_detections(cloud).scan for cloud in clouds[20:]]
    for range_, azimuth in places:
        hits = 0
        for scan in found:
            off = np.abs(scan.range - range_) / scan.range_std
            aside = np.abs(scan.azimuth - azimuth) / scan.azimuth_std
            hits += bool(((off < 4.0) & (aside < 4.0)).any())
        assert hits >= 9, f"of 10 pings, at {range_} m"
    others = np.mean([len(scan) for scan in found]) - 2
    assert 5 <= others <= 60, "about 20 false detections a ping"
    assert set(found[0].features) >= {"intensity", "range_width", "azimuth_width"}
    world.until(lambda: markers and images and plans, "what shows the image")
    assert (images[-1].height, images[-1].width, images[-1].encoding) == (BEAMS, CELLS, "32FC1")
    assert markers[-1].markers[-1].points and markers[-1].markers[-1].color.a == 1.0
    assert len(plans) <= 2.0 * (time.monotonic() - begin) + 1.0, "at most twice a second"
    assert plans[-1].header.frame_id == "sonar"
    assert max(max(plan.data) for plan in plans) > 50, "above the threshold"


def test_both_nodes_start_a_track_on_a_target_that_moves_in_spite_of_a_picture_in_colours(world):
    tracks = world.listen(PointCloud2, "tracks")
    given = {"method": "score", "max_speed": 3.0, "score.false_tracks_per_hour": 10.0}
    world.make(TrackInitiator, COVERAGE | given)
    sonar, heard = detecting(world)
    world.until_logged("subscribed to /detections")
    world.until_connected()
    sonar.ping(encoding="bgr8")
    world.until_logged("no colours, which are no intensities")
    pings(world, sonar, heard, 50, lambda k: [(12.0 + 0.2 * k, 0.3)])  # 1 m/s away
    world.until(lambda: any(cloud.width for cloud in tracks), "a track")
    world.until(
        lambda: any(
            (value.key, value.value) == ("dropped.bad_encoding", "1")
            for message in world.diagnostics
            for status in message.status
            for value in status.values
        ),
        "the count on /diagnostics",
    )


def test_an_image_without_a_geometry_is_dropped_and_no_tracker_is_told_a_default(world):
    tracker = world.make(TrackInitiator, COVERAGE)
    sonar, heard = Sonar(world), world.listen(PointCloud2, "detections")
    world.make(SonarDetector)
    world.until_logged("subscribed to /image as sensor_msgs/msg/Image")
    world.until_connected()
    sonar.ping()
    world.until_logged("states no geometry: give image.near_range", level=WARN)
    assert not heard
    assert tracker.get_parameter("sensor.max_range").value == 40.5


def test_a_parameter_of_the_sensor_s_errors_is_named_as_not_used_and_another_is_refused(world):
    world.make(SonarDetector, COVERAGE | {"sensor.range_std": 0.1, "sensor.clutter_density": 1e-4})
    line = world.until_logged("not used by this node", level=WARN)
    assert "sensor.range_std, sensor.clutter_density; it takes sensor.min_range" in line
    assert "sensor.azimuth_max alone, no model of the sensor's errors" in line
    with pytest.raises(ParameterError, match=r"sensor.range_stdd is not a parameter"):
        world.make(SonarDetector, {"sensor.range_stdd": 0.1})


def test_a_tracker_is_told_the_coverage_of_the_images_whenever_it_starts_and_until_it_takes_it(
    world,
):
    tracker = world.make(TrackInitiator, {"sensor.max_range": 6000.0, "sensor.min_range": 100.0})

    def refuse(_):
        return SetParametersResult(successful=False, reason="not now")

    tracker.add_on_set_parameters_callback(refuse)
    sonar, heard = detecting(world)
    pings(world, sonar, heard, 2)
    world.until_logged("track_initiator: not now", level=WARN)
    tracker.remove_on_set_parameters_callback(refuse)
    for _ in range(2):  # no image comes meanwhile
        world.until(
            lambda one=tracker: one.get_parameter("sensor.max_range").value == pytest.approx(40.5),
            "the range of the images",
        )
        assert tracker.get_parameter("sensor.min_range").value == pytest.approx(0.5)
        assert tracker.get_parameter("sensor.azimuth_max").value == pytest.approx(0.8)
        world.end(tracker)
        tracker = world.make(TrackInitiator, {"sensor.max_range": 6000.0})
    world.end(tracker)
    tracker = world.make(TrackInitiator, COVERAGE | {"sensor.max_range": 40.1})
    seen = len(world.diagnostics)
    world.until(lambda: len(world.diagnostics) > seen + 4, "some looks at the tracker")
    assert tracker.get_parameter("sensor.max_range").value == 40.1, "it fits the images"


def test_a_tracker_of_several_sonars_above_is_told_the_coverage_of_the_one_by_its_name(world):
    given = {"sensors": ["port", "starboard"], "sensor.max_range": 6000.0}
    tracker = world.make(TrackInitiator, given, cli_args=remapped("__ns:=/boat"))
    sonar, heard = Sonar(world), world.listen(PointCloud2, "/boat/port/detections")
    rules = remapped("__ns:=/boat/port", "image:=/image")
    world.make(SonarDetector, COVERAGE | ROWS | {"tracker_sensor": "port"}, cli_args=rules)
    world.until_logged("subscribed to /image as sensor_msgs/msg/Image")
    world.until_connected()
    pings(world, sonar, heard, 2)
    world.until(
        lambda: tracker.get_parameter("port.sensor.max_range").value == pytest.approx(40.5),
        "the range of the images",
    )
    for name in ("sensor", "starboard.sensor"):
        assert tracker.get_parameter(f"{name}.max_range").value == 6000.0


def slowed(monkeypatch, seconds):
    """A detector that takes at least so long for an image."""
    process = Detector.process

    def slow(self, image):
        time.sleep(seconds)
        return process(self, image)

    monkeypatch.setattr(Detector, "process", slow)


def images(world):
    """The newest entry of the images, and its figures."""
    status = world.statuses_of("/sonar_detector")["images"]
    return status, {value.key: value.value for value in status.values}


def test_of_images_faster_than_they_are_processed_the_newest_is_taken_and_it_is_said(
    world, monkeypatch
):
    slowed(monkeypatch, 0.25)
    sonar, heard = detecting(world, interval=0.1)
    for _ in range(9):
        sonar.ping()
    newest = round((STAMP + 0.8) * 1e9)
    world.until(lambda: heard and stamp_of(heard[-1]) == newest, "the newest image")
    assert len(heard) <= 4
    status, figures = images(world)
    assert status.level == bytes([1])
    assert status.message.startswith("cannot keep up: an image takes 0.")
    assert len(heard) + int(figures["dropped.overload"]) == 9
    assert float(figures["image_interval_s"]) == pytest.approx(0.1, rel=0.01)
    assert float(figures["time_per_image_s"]) >= 0.25
    assert float(figures["image_age_s"]) >= 0.25
    world.until_logged("images were passed over", level=WARN)


def test_images_of_a_remapped_topic_are_told_by_their_publishers_numbers(world, monkeypatch):
    came, numbers = Pace.came, []
    monkeypatch.setattr(
        Pace, "came", lambda pace, stamps, number=None: numbers.append(number) or came(pace, stamps)
    )
    sonar = Sonar(world, topic="sonar/image")
    world.make(SonarDetector, COVERAGE | ROWS, cli_args=remapped("image:=sonar/image"))
    world.until_logged("subscribed to /sonar/image")
    world.until_connected()
    for count in (1, 2, 3):
        sonar.ping()
        world.until(lambda count=count: len(numbers) == count, "an image")
    assert [number - numbers[0] for number in numbers] == [0, 1, 2]


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_a_burst_of_a_slow_sonar_is_processed_whole(world, monkeypatch):
    slowed(monkeypatch, 0.25)
    sonar, heard = detecting(world, interval=12.0)
    for _ in range(9):
        sonar.ping()
    world.until(lambda: len(heard) == 9, "every image")
    status, figures = images(world)
    assert (status.level, "dropped.overload" in figures) == (bytes([0]), False)


def bearing(number, interval):
    stamp = round((STAMP + interval * number) * 1e9)
    return foreign.SonarEcho(
        header=make_header(stamp, "sonar"),
        angle=2.0 * np.pi * (number % 24) / 24,
        range=40,
        speed_of_sound=1500,
        intensities=np.random.default_rng(number).integers(1, 200, 60, np.uint8).tobytes(),
    )


@pytest.mark.parametrize(
    ("interval", "waited", "processed"), [(0.005, 5.0, 1), (0.005, 0.0, 7), (0.1, 5.0, 7)]
)
def test_of_turns_faster_than_they_are_processed_those_with_a_newer_one_are_passed_over(
    world, monkeypatch, interval, waited, processed
):
    slowed(monkeypatch, 0.15)
    heard = world.listen(PointCloud2, "detections")
    node = world.make(SonarDetector)
    world.until_connected()
    for number in range(24 * 7 + 2):
        node.take_image(bearing(number, interval), waited)
    assert node._input.detector.measured["images"] == processed
    assert node.dropped["overload"] == 7 - processed
    world.until(lambda: len(heard) == processed, "their detections")


def test_reliable_asked_of_a_driver_that_offers_less_names_the_parameter_of_images(world):
    world.make(SonarDetector, COVERAGE | {"image_reliability": "reliable"})
    world.observer.create_publisher(Image, "image", BEST_EFFORT)
    world.until_logged("does not offer reliable", "set image_reliability to auto", level=ERROR)


def test_the_drivers_of_bearings_that_make_no_turn_are_named(world):
    node = world.make(SonarDetector)
    drivers = [world.observer.create_publisher(Image, "image", RELIABLE) for _ in range(2)]
    for number in [*range(60), 59]:
        node.take_image(bearing(number * 13, 0.01))
    world.until_logged("image left out", "(1 so far: image_repeated)")
    world.until(lambda: "is published by" in images(world)[0].message, "the names of the drivers")
    assert images(world)[0].message.startswith("bearings, but no turn, ")
    assert len(drivers) == 2


def test_poses_of_own_ship_reach_the_detector(world):
    parameters = {"own_ship_source": "odometry", "mounting.yaw": 0.5}
    sonar, heard = Sonar(world), world.listen(PointCloud2, "detections")
    node = world.make(SonarDetector, COVERAGE | ROWS | parameters)
    boat = world.observer.create_publisher(Odometry, "own_ship/odometry", 10)
    world.until_logged("subscribed to /image as sensor_msgs/msg/Image")
    world.until_connected()
    for k in range(3):
        boat.publish(odometry_message(PoseSample(STAMP + 0.2 * k, 2.0 * k, 0.0, 0.0)))
    world.until(lambda: len(node._input.own_ship.poses) == 3, "the poses")
    pings(world, sonar, heard, 3)
    assert node._input.detector._grid.moves, "a background on the ground"


def test_poses_of_tf_without_a_heading_are_counted_and_the_images_used(world, monkeypatch):
    Transforms(lambda seconds: ((seconds, 0.0), [0.0] * 4)).install(monkeypatch)
    sonar, heard = Sonar(world), world.listen(PointCloud2, "detections")
    parameters = {"own_ship_source": "tf", "fixed_frame": "map"}
    node = world.make(SonarDetector, COVERAGE | ROWS | parameters)
    world.until_logged("subscribed to /image as sensor_msgs/msg/Image")
    world.until_connected()
    pings(world, sonar, heard, 3)
    assert node.dropped == {"own_ship_invalid": 3}


def test_tracks_end_where_the_ranges_of_pictures_are_given_anew_not_where_it_is_suspected(
    world, monkeypatch
):
    node, ended = world.make(TrackInitiator, COVERAGE), list[bool]()
    monkeypatch.setattr(node._session, "end_tracks", lambda: ended.append(True))
    sonar, heard = detecting(world, interval=2.0)  # slower than any machine
    rng = np.random.default_rng(7)
    places = np.stack([rng.uniform(4.0, 18.0, 12), rng.uniform(-0.7, 0.7, 12)], axis=1)
    world.until_logged("subscribed to /detections")
    pings(world, sonar, heard, 14, lambda k: places * [1.0 if k < 10 else 2.0, 1.0])
    nodes = world.executor.get_nodes()
    (detector,) = [node for node in nodes if isinstance(node, SonarDetector)]

    def says(part):
        statuses = [one for message in world.diagnostics[-5:] for one in message.status]
        return any(part in one.message for one in statuses if "sonar_detector" in one.name)

    world.until(lambda: says("times its ranges before: if the sonar's range"), "the state")
    assert not ended
    detector.set_parameters_atomically([Parameter("image.far_range", value=20.2)])
    pings(world, sonar, heard, 15, lambda k: places)
    world.until(lambda: ended, "the end of tracks placed by the old ranges")
    world.until(lambda: says("that do not stand"), "the state")


def test_tf_without_a_frame_is_refused_at_the_start(world):
    with pytest.raises(ParameterError, match="fixed_frame must be given"):
        world.make(SonarDetector, {"own_ship_source": "tf"})
