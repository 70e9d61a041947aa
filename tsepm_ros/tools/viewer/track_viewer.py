"""The node that shows the live topics on a page in a browser."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.expand_topic_name import expand_topic_name
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from tsepm_ros.nodes.base_node import ParameterisedNode, refusing, run
from tsepm_ros.nodes.subscriptions import OfferedSubscription, QosWatch
from tsepm_ros.settings.node_options import ViewerNodeOptions
from tsepm_ros.settings.settings import help_text
from tsepm_ros.tools.viewer.live_frames import (
    CLOUDS,
    DIAGNOSTICS,
    FIXED,
    IMAGE,
    OWN_SHIP,
    TRACKS,
    LiveFeed,
)
from tsepm_ros.tools.viewer.page_frames import topics_of_message

CLOUD_DEPTH = 10
PAUSE = 0.008
"""Time for the messages of a scan to arrive, s."""
CHECK_PERIOD = 1.0
"""Time between checks whether anything publishes held tracks, s."""
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
SOME = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort is compatible with every publisher."""


class TrackViewer(ParameterisedNode):
    """Subscribes to what the track initiator publishes, and serves a page of it.

    Topics without a remapping of its own are those that the track initiator states on
    ``/diagnostics``: of the node that publishes the viewer's tracks; if none does, of the only node
    in the viewer's namespace, or in any namespace for a viewer without one.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("track_viewer", **node_options)
        options: ViewerNodeOptions = self.options[ViewerNodeOptions]
        self._gathered = 0.0  # when the last pause ended
        self._given = {name: self.resolve_topic_name(name) for name in (*CLOUDS, OWN_SHIP)}
        own = self.get_name(), self.get_namespace()
        self._remapped = {
            name for name, topic in self._given.items() if topic != expand_topic_name(name, *own)
        }
        self._topics = self._given
        self._stated: dict[str, dict[str, str]] = {}  # topics by node
        self._shown, self._image = "", None  # type: tuple[str, Any]
        topic = self._given[TRACKS]
        with refusing():
            self._feed = LiveFeed(
                options,
                f"Tracks on {topic}",
                topic,
                lambda sentence: self.warn(sentence.partition(":")[0], sentence),
                partial(deserialize_message, message_type=Odometry),
            )
        try:
            self._subscribe()
        except BaseException:
            self._feed.server.stop()  # nobody gets the node, which could be destroyed
            raise
        self.get_logger().info(f"open {self._feed.server.url}")

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._feed.server.url

    def _subscribe(self) -> None:
        self._qos = QosWatch(self)
        self._subscribe_topics()
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, self._hear, SOME)
        # A node without a timer might never notice that the context was shut down by a signal.
        self.steady_timer(CHECK_PERIOD, self._check_publisher)
        self.refuse_unused_overrides()

    def _subscribe_topics(self) -> None:
        self._clouds = [
            OfferedSubscription(
                self,
                PointCloud2,
                self._topics[name],
                CLOUD_DEPTH,
                partial(self._take, name),
                self._qos,
                durability=DurabilityPolicy.TRANSIENT_LOCAL
                if name in (TRACKS, FIXED)
                else DurabilityPolicy.VOLATILE,
            )
            for name in CLOUDS
        ]
        # Odometry may come much more often than scans: only the newest before a scan is read.
        self._own_ship = self.create_subscription(
            Odometry, self._topics[OWN_SHIP], partial(self._take, OWN_SHIP), NEWEST, raw=True
        )

    def destroy_node(self) -> None:
        """Destroy the node and end the server."""
        self._feed.server.stop()
        super().destroy_node()

    def _check_publisher(self) -> None:
        nodes = self._candidates()
        if len(nodes) == 1:
            [self._shown] = nodes
        elif nodes and self._shown not in nodes:
            self.warn(
                "nodes",
                f"several nodes publish tracks: {', '.join(nodes)}; --ros-args -r __ns:=NAMESPACE "
                "or -r tracks/current:=TOPIC chooses",
            )
        if self._feed.shows_image and self._image is None:
            self._image = self.create_subscription(
                OccupancyGrid, IMAGE, self._feed.take_image, NEWEST
            )
        elif self._image is not None and not self._feed.shows_image:
            self.destroy_subscription(self._image)
            self._image = None
        self._follow(self._stated.get(self._shown, {}))
        self._feed.published(self.count_publishers(self._topics[TRACKS]) > 0)

    def _candidates(self) -> list[str]:
        """Nodes whose topics may be those to be shown."""
        topic = self._given[TRACKS]
        by_node = {
            node: topics[TRACKS]
            for node, topics in self._stated.items()
            if self.count_publishers(topics[TRACKS])
        }
        nodes = [node for node, stated in by_node.items() if stated == topic]
        if nodes or TRACKS in self._remapped or self.count_publishers(topic):
            return nodes
        namespace = self.get_namespace().rstrip("/")
        near = [node for node in by_node if node.rpartition("/")[0] == namespace]
        return near or ([] if namespace else list(by_node))

    def _follow(self, stated: Mapping[str, str]) -> None:
        """Subscribe to the topics that the shown node states, where they are others."""
        topics = {
            name: given if name in self._remapped else stated.get(name, given)
            for name, given in self._given.items()
        }
        if topics == self._topics:
            return
        self._topics = topics
        for subscription in self._clouds:
            subscription.end()
        self.destroy_subscription(self._own_ship)
        self._subscribe_topics()
        self._feed.watching(topics[TRACKS])
        self.get_logger().info(f"shows {self._shown}, with tracks on {topics[TRACKS]}")

    def _hear(self, message: DiagnosticArray) -> None:
        """Take a message of diagnostics, unless it is of another node than the one shown."""
        stated = topics_of_message(message)
        self._stated.update(stated)
        if not stated or self._shown in ("", *stated):
            self._take(DIAGNOSTICS, message)

    def _take(self, topic: str, message: Any) -> None:
        """Take a message, and wait for the other messages of a scan.

        The executor then wakes up once for all.
        """
        self._feed.take(topic, message)
        if time.monotonic() - self._gathered > 2.0 * PAUSE:
            time.sleep(PAUSE)
            self._gathered = time.monotonic()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(TrackViewer, args, help_text("track_viewer", __doc__))


if __name__ == "__main__":
    raise SystemExit(main())
