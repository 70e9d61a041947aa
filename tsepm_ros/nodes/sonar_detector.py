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
"""The node that makes detections of sonar images, with the number of false ones kept."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from msg_adapters import MessageError, detections_cloud, image_messages, make_header
from msg_adapters.image_messages import BEARINGS, normalised_image, plan_message, plan_of
from msg_adapters.sonar_images import PLAN_PERIOD, ImageInput, detection_fields
from msg_adapters.track_messages import detection_markers
from tsepm_ros.detector.image import COVERAGE, DetectorOptions, ImageCoverage
from tsepm_ros.diagnostics.input_health import IMAGES
from tsepm_ros.nodes.base_node import OVERRIDABLE, BaseNode, ParameterError, run_node
from tsepm_ros.nodes.pace import Pace, newest_at_pace, pace_seconds_in_queue
from tsepm_ros.nodes.subscriptions import (
    DetectionsSubscription,
    OfferedSubscription,
    SubscriptionQos,
)
from tsepm_ros.nodes.tf_own_ship import tf_buffer, tf_own_ship
from tsepm_ros.session.drop_reasons import OWN_SHIP
from tsepm_ros.session.turn import ImagePing
from tsepm_ros.settings.node_options import SonarDetectorNodeOptions
from tsepm_ros.settings.settings import settings_help
from tsepm_ros.tracker.scan import Scan

IMAGE, DETECTIONS, OWN_SHIP_TOPIC = "image", "detections", "own_ship/odometry"
DEPTH, BEARINGS_DEPTH = 10, 1000
TOO_FAST = "images were passed over, because they come faster than they are processed"
PERIOD = 1.0
"""Time between looks at the tracker's coverage, s."""


class SonarDetector(BaseNode):
    """Subscribes to images and publishes their detections."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__(
            "sonar_detector",
            lambda changed: self._input.configure(changed),
            **node_options,
        )
        self._pace = Pace()
        self.watch(IMAGES, "image", IMAGE)
        self._input = ImageInput(self.options, self.drop, self.warn_once)
        self._coverage: ImageCoverage | None = None
        self._detections, self._markers, self._normalised, self._plan = (
            self.create_publisher(kind, topic, depth, qos_overriding_options=OVERRIDABLE)
            for kind, topic, depth in (
                (PointCloud2, DETECTIONS, DEPTH),
                (MarkerArray, f"{DETECTIONS}/markers", DEPTH),
                (Image, f"{IMAGE}/normalised", DEPTH),
                (OccupancyGrid, f"{IMAGE}/plan", 1),
            )
        )
        options: SonarDetectorNodeOptions = self.options[SonarDetectorNodeOptions]
        self._asked, self._planned = Future(), 0.0
        sensor, tracker = options.tracker_sensor, options.tracker
        self._front = f"{sensor}." * bool(sensor)
        if sensor and tracker and not tracker.startswith("/"):  # it is above this namespace
            tracker = f"{self.get_namespace().rpartition('/')[0]}/{tracker}"
        self._tracker = AsyncParameterClient(self, tracker) if tracker else None
        self._end = tracker and self.create_client(Trigger, f"{tracker}/end_tracks")
        self._images = DetectionsSubscription(
            self,
            options.image_type,
            options.image_reliability,
            options.image_depth,
            self._hear,
            SubscriptionQos(self),
            topic=IMAGE,
            readable=tuple(image_messages.IMAGES),
            least_depth=dict.fromkeys(BEARINGS, BEARINGS_DEPTH),
        )
        self._subscribe_own_ship(options)
        self.steady_timer(PERIOD, self._ask)
        self.refuse_unused_overrides()

    def _subscribe_own_ship(self, options: SonarDetectorNodeOptions) -> None:
        topics = {"tf": "/tf", "odometry": OWN_SHIP_TOPIC}
        if options.own_ship_source in topics:
            self.watch(OWN_SHIP, "own-ship data", topics[options.own_ship_source])
        if options.own_ship_source == "tf":
            if not options.fixed_frame:
                raise ParameterError("fixed_frame must be given where own_ship_source is tf")
            self._input.look_up = partial(self._look_up, tf_buffer(self))
        elif options.own_ship_source == "odometry":
            self._own_ship = OfferedSubscription(
                self,
                Odometry,
                OWN_SHIP_TOPIC,
                DEPTH,
                self._take_own_ship,
                SubscriptionQos(self),
            )

    def _take_own_ship(self, message: Odometry) -> None:
        self.health.heard(OWN_SHIP, time.monotonic())
        self._input.take_own_ship(message)

    def _look_up(self, buffer: Any, ping: ImagePing) -> None:
        """Take the pose of the sensor at a message, or the newest before, from tf."""
        options: SonarDetectorNodeOptions = self.options[SonarDetectorNodeOptions]
        frame, stamp = options.fixed_frame, 1e-9 * ping.stamp_ns + options.own_ship_delay
        try:
            self._input.add_pose(tf_own_ship(buffer, frame, ping.frame_id, stamp, ping.axes))
            self.health.heard(OWN_SHIP, time.monotonic())
        except MessageError as error:
            said = f"own-ship data dropped: {error}; the background is that of the image's cells"
            self.drop(error.reason, said)

    def _hear(self, message: Any, information: Any) -> None:
        """Take a message from the middleware: under overload the newest image, or turn."""
        pace = self._pace
        if not self._input.in_parts:
            message, information, skipped = newest_at_pace(
                message, information, pace.interval, self._images.take_waiting, pace.is_behind
            )
            stamps = [image.header.stamp for image in (*skipped, message)]
            alone = self.count_publishers(self.resolve_topic_name(IMAGE)) == 1
            if number := pace.came(
                [stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps],
                # Each publisher numbers its own.
                information["publication_sequence_number"] if alone else None,
            ):
                self.drop("overload", TOO_FAST, number)
        self.take_image(message, pace_seconds_in_queue(information))

    def take_image(self, message: Any, waited: float = 0.0) -> None:
        """Take a message, of any supported type, that waited for a time, s."""
        now = time.monotonic()
        self._pace.arrived = now - waited
        self.health.heard(IMAGES, now)
        for ping, scan in self._input.take(message, self._is_late):
            self.health.arrived(1e-9 * ping.stamp_ns, now, IMAGES)
            self._follow(ping)
            if self._input.elsewhere and self._end and self._end.service_is_ready():
                self._end.call_async(Trigger.Request())
            self._publish(scan, ping)
            self._pace.done()

    def _is_late(self, turn: ImagePing) -> bool:
        """Whether a newer turn is waiting, and turns come faster than they are processed."""
        pace = self._pace
        pace.came([1e-9 * turn.stamp_ns])
        late = pace.is_behind and time.monotonic() - pace.arrived > pace.interval
        if late:
            self.drop("overload", TOO_FAST)
        return late

    def _publish(self, scan: Scan, ping: ImagePing) -> None:
        header = make_header(ping.stamp_ns, ping.frame_id)
        self._detections.publish(detections_cloud(header, **detection_fields(ping, scan)))
        if self._markers.get_subscription_count():
            size = 0.01 * float(ping.range[-1])
            self._markers.publish(detection_markers(header, scan, size, ping.axes))
        stages, now = self._input.detector.stages, time.monotonic()
        if self.options[SonarDetectorNodeOptions].publish_normalised and stages is not None:
            self._normalised.publish(normalised_image(header, stages.smoothed))
        is_due = self._plan.get_subscription_count() and now - self._planned >= PLAN_PERIOD
        if is_due and stages is not None:
            self._planned = now
            self._plan.publish(plan_message(header, plan_of(ping, stages), ping.axes))

    def _follow(self, ping: ImagePing) -> None:
        """Note the coverage of the images where it has changed."""
        coverage = self._input.coverage
        if coverage is None or coverage is self._coverage:
            return
        self._coverage = coverage
        near, far, low, high = (round(value, 6) for value in coverage.values.values())
        self.get_logger().info(
            f"images reach from {near:.3g} to {far:.4g} m and from {low:.3g} to {high:.3g} rad"
            + f"; {ping.corners}; compare this with the driver's own display" * bool(ping.corners)
        )
        self._ask()

    def _ask(self) -> None:
        """Ask the tracker for its coverage: it may have started, or started again, since."""
        tracker = self._tracker
        if tracker is not None and self._coverage is not None and tracker.services_are_ready():
            self._asked.cancel()  # without an answer until now: that tracker is no more
            self._asked = tracker.get_parameters(
                [f"{self._front}sensor.{name}" for name in COVERAGE], self.guarded(self._tell)
            )

    def _tell(self, future: Any) -> None:
        """Tell the tracker the coverage of the images where its own is another."""
        if self._tracker is None or self._coverage is None or future.cancelled():
            return
        known = [parameter.double_value for parameter in future.result().values]
        if len(known) != len(COVERAGE) or not self._coverage.agrees(known):
            self._tracker.set_parameters_atomically(
                [
                    Parameter(f"{self._front}sensor.{name}", value=value)
                    for name, value in self._coverage.values.items()
                ],
                self.guarded(self._told),
            )

    def _told(self, future: Any) -> None:
        """Say why the tracker refused a coverage."""
        if not (answer := future.result().result).successful:
            tracker = self.options[SonarDetectorNodeOptions].tracker
            self.warn("tracker", f"{tracker}: {answer.reason}")

    def found(self) -> Mapping[str, Mapping[str, Any]]:
        """What the node finds of its inputs."""
        turns, pace, images = self._input.turns, self._pace, self._input.detector
        slow = (
            f"cannot keep up: an image takes {pace.time:.3g} s, one comes every "
            f"{pace.interval:.3g} s, the last was finished {pace.age:.3g} s after its arrival; "
            f"{self.dropped['overload']} were passed over. Reduce the sonar's rate, or the "
            "cells of its images"
        )
        other_range = (
            f"what stands lies at {images.factor:.2g} times its ranges before: if "
            "the sonar's range was changed, give the new ranges (image.near_range and "
            "image.far_range), or set it back"
        )
        return {
            IMAGES: {
                "connections": self.connections(IMAGE, **self._images.types),
                "findings": {
                    "slow": slow * pace.is_late(time.monotonic()),
                    "turns": turns.state and turns.state + self.connections(IMAGE).of_several,
                    "content": self._input.content,
                    "range": other_range * (images.factor != 1.0),
                    "anew": images.begins_again,
                },
                "values": images.measured
                | {
                    "stated": self.options[DetectorOptions].false_detections_per_ping,
                    "bearings_unused": turns.unused,
                    "coverage_changes": self._input.coverage_changes,
                    "time_per_image_s": pace.time,
                    "image_interval_s": pace.interval,
                    "image_age_s": pace.age,
                    "images_lost": pace.lost,
                },
                "healthy": f"an image has {images.kinds()}",
            },
            OWN_SHIP: {"user": "image", "behind": self._input.behind},
        }


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(SonarDetector, args, settings_help("sonar_detector", __doc__))


if __name__ == "__main__":
    raise SystemExit(main())
