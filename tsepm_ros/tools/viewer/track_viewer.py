"""The node that shows the live topics on a page in a browser."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from tsepm_ros.nodes.diagnostics_publisher import ThrottledWarnings
from tsepm_ros.nodes.node_parameters import NodeParameters, ParameterisedNode, refusing
from tsepm_ros.nodes.quality_of_service import QosWatch
from tsepm_ros.nodes.running import run
from tsepm_ros.nodes.subscriptions import OfferedSubscription
from tsepm_ros.settings.node_options import ViewerNodeOptions
from tsepm_ros.settings.settings import TRACK_VIEWER, help_text
from tsepm_ros.tools.viewer.live_frames import CLOUDS, DIAGNOSTICS, FIXED, OWN_SHIP, TRACKS
from tsepm_ros.tools.viewer.serving import LiveFeed

CLOUD_DEPTH = 10
PAUSE = 0.008
"""Time for the messages of a scan to arrive, s."""
CHECK_PERIOD = 1.0
"""Time between checks whether anything publishes held tracks, s."""
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
SOME = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort is compatible with every publisher."""


class TrackViewer(ParameterisedNode):
    """Subscribes to what the track initiator publishes, and serves a page of it."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("track_viewer", **node_options)
        options: ViewerNodeOptions = NodeParameters(self, TRACK_VIEWER).options[ViewerNodeOptions]
        self._gathered = 0.0  # when the last pause ended
        warnings = ThrottledWarnings(self)
        topic = self.resolve_topic_name(TRACKS)
        with refusing():
            self._feed = LiveFeed(
                options,
                f"Tracks on {topic}",
                topic,
                lambda sentence: warnings.warn(sentence.partition(":")[0], sentence, 0),
                partial(deserialize_message, message_type=Odometry),
            )
        try:
            self._subscribe()
        except BaseException:
            self._feed.stop()  # nobody gets the node, which could be destroyed
            raise
        self.get_logger().info(f"open {self._feed.server.url}")

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._feed.server.url

    def _subscribe(self) -> None:
        qos = QosWatch(self)
        self._clouds = [
            OfferedSubscription(
                self,
                PointCloud2,
                name,
                CLOUD_DEPTH,
                self._taking(name),
                qos,
                durability=DurabilityPolicy.TRANSIENT_LOCAL
                if name in (TRACKS, FIXED)
                else DurabilityPolicy.VOLATILE,
            )
            for name in CLOUDS
        ]
        # Odometry may come much more often than scans: only the newest before a scan is read.
        self.create_subscription(Odometry, OWN_SHIP, self._taking(OWN_SHIP), NEWEST, raw=True)
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, self._taking(DIAGNOSTICS), SOME)
        # A node without a timer might never notice that the context was shut down by a signal.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(CHECK_PERIOD, self._check_publisher, clock=steady)
        self.refuse_unused_overrides()

    def destroy_node(self) -> None:
        """Destroy the node and end the server."""
        self._feed.stop()
        super().destroy_node()

    def _check_publisher(self) -> None:
        self._feed.published(self.count_publishers(TRACKS) > 0)

    def _taking(self, topic: str) -> Callable[[Any], None]:
        """Return the callback of a topic."""

        def take(message: Any) -> None:
            self._feed.take(topic, message)
            self._gather()

        return take

    def _gather(self) -> None:
        """Wait for the other messages of a scan, so that the executor wakes up once for all."""
        if time.monotonic() - self._gathered > 2.0 * PAUSE:
            time.sleep(PAUSE)
            self._gathered = time.monotonic()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(TrackViewer, args, help_text("track_viewer", __doc__))


if __name__ == "__main__":
    raise SystemExit(main())
