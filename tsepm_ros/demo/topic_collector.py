"""A node that stores the messages of a detection source and of the track initiator."""

from __future__ import annotations

from typing import Any

from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from msg_adapters import read_track_cloud, time_to_ns

DEPTH = 1000


class TopicCollector(Node):
    """Keeps the messages of one run.

    Attributes
    ----------
    detections, own_ship : list
        Messages in order of arrival.
    tracks : list of (int, record)
        Stamp (ns) and record of each confirmed track.
    processed : int
        Scans that the initiator has processed.
    heard : int
        Number of all messages.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("run_recorder", **node_options)
        self.detections: list[PointCloud2] = []
        self.own_ship: list[Odometry] = []
        self.tracks: list[tuple[int, object]] = []
        self.processed = 0
        self.heard = 0
        self.create_subscription(PointCloud2, "tracks", self._on_tracks, DEPTH)
        self.create_subscription(Odometry, "own_ship/odometry", self._on_own_ship, DEPTH)
        self.create_subscription(PointCloud2, "detections", self._on_detections, DEPTH)

    def _on_detections(self, message: PointCloud2) -> None:
        self.detections.append(message)
        self.heard += 1

    def _on_own_ship(self, message: Odometry) -> None:
        self.own_ship.append(message)
        self.heard += 1

    def _on_tracks(self, message: PointCloud2) -> None:
        stamp = time_to_ns(message.header.stamp)
        records = read_track_cloud(message)
        self.tracks.extend((stamp, record) for record in records[records["revision"] == 0])
        self.processed += 1
        self.heard += 1
