"""Topics of the track initiator; messages that are slow to build need a subscriber."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from msg_adapters import (
    PlacedDetections,
    clear_markers,
    fixed_echo_markers,
    make_header,
    placed_detections_cloud,
    potential_track_markers,
    track_cloud,
    track_markers,
    track_odometry,
)
from msg_adapters.track_markers import MarkerSizes, marker_sizes
from tsepm_ros.diagnostics.health_figures import Latency
from tsepm_ros.kinematics.track import NO_TRACKS, ConfirmedTrack, TrackArrays
from tsepm_ros.nodes import qos_overrides
from tsepm_ros.nodes.qos_watch import QosWatch
from tsepm_ros.own_ship.frame_axes import exchanged, stated_axes
from tsepm_ros.sensing.conversion import convert
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.session.result import ScanResult
from tsepm_ros.session.session import Session


def _latched(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class TrackOutputs:
    """Publishes the result of each scan.

    Parameters
    ----------
    node : rclpy.node.Node
    session : Session
        Source of the potential tracks.
    watch : QosWatch
    with_potential_tracks : bool
        Whether potential tracks are published too.
    """

    def __init__(
        self, node: Node, session: Session, watch: QosWatch, with_potential_tracks: bool
    ) -> None:
        self._session = session
        self._with_potential_tracks = with_potential_tracks

        def publisher(
            message_type: type[Any],
            topic: str,
            qos: QoSProfile | int,
            matched: Callable[[Any], None] | None = None,
        ) -> Publisher:
            events = watch.publisher_events(topic, matched)
            return node.create_publisher(
                message_type,
                topic,
                qos,
                event_callbacks=events,
                qos_overriding_options=qos_overrides.PUBLISHER,
            )

        self._shown: tuple[Header, TrackArrays] = make_header(0, ""), NO_TRACKS
        self._echoes: Sequence[ConfirmedTrack] = ()
        self._drawn: set[Publisher] = set()
        self._redraw = True
        self._tracks = publisher(PointCloud2, "tracks", 100)
        self._current = publisher(PointCloud2, "tracks/current", _latched(1))
        self._odometry = publisher(Odometry, "tracks/odometry", 100)
        self._markers = publisher(
            MarkerArray, "tracks/markers", _latched(10), self._on_viewer_change
        )
        self._fixed_echoes = publisher(PointCloud2, "fixed_echoes", _latched(1))
        self._fixed_echo_markers = publisher(
            MarkerArray, "fixed_echoes/markers", _latched(1), self._on_viewer_of_echoes
        )
        self._potential = publisher(PointCloud2, "potential_tracks", 10)
        self._potential_markers = publisher(
            MarkerArray,
            "potential_tracks/markers",
            _latched(1),
            self._on_viewer_of_potential_tracks,
        )
        self._placed = publisher(PointCloud2, "detections/placed", 100)

    def publish(self, result: ScanResult, entered: float) -> Latency:
        """Publish the result of a scan, new tracks first, and return its latency.

        `entered` is the `perf_counter` at the beginning of the callback.
        """
        begin = time.perf_counter()
        header = make_header(result.stamp_ns, result.frame_id)
        self._tracks.publish(track_cloud(header, result.starts))
        published = time.perf_counter()
        self._publish_more(header, result)
        end = time.perf_counter()
        return Latency(
            to_tracks=published - entered,
            to_all=end - entered,
            waiting=result.waiting,
            core=result.core_seconds,
            publishing=end - begin,
        )

    def _publish_more(self, header: Header, result: ScanResult) -> None:
        if self._placed.get_subscription_count():  # first: trackers wait for it
            self._publish_placed(header, result.scan)
        self._current.publish(track_cloud(header, result.current))
        self._fixed_echoes.publish(track_cloud(header, result.fixed_echoes))
        # Nested messages are slow to build in Python: only if there is a subscriber.
        if self._odometry.get_subscription_count():
            for track in result.starts:
                self._odometry.publish(track_odometry(header, track))
        # Those that ended, and those that are withheld or have become fixed echoes.
        gone = np.setdiff1d(self._shown[1].track_id, result.current.track_id).tolist()
        self._shown, self._echoes = (header, result.current), result.fixed_echoes
        if self._markers.get_subscription_count():
            self._markers.publish(
                track_markers(header, result.current, gone, afresh=self._redraw, **self._sizes)
            )
            self._redraw = False
        if self._fixed_echo_markers.get_subscription_count():
            self._draw_echoes(header)
        if self._with_potential_tracks:
            self._publish_potential(header)

    @property
    def _sizes(self) -> MarkerSizes:
        settings = self._session.settings
        return marker_sizes(settings.sensor.max_range, settings.common.max_speed)

    def clear(self, header: Header) -> None:
        """Publish empty tracks and markers."""
        self._shown, self._echoes = (header, NO_TRACKS), ()
        self._markers.publish(clear_markers(header))
        self._potential_markers.publish(clear_markers(header))
        self._fixed_echo_markers.publish(clear_markers(header))
        self._current.publish(track_cloud(header, []))
        self._fixed_echoes.publish(track_cloud(header, []))

    def show_potential_tracks(self, shown: bool) -> None:
        """Publish potential tracks from now on, or no longer; the last ones are removed then."""
        if self._with_potential_tracks and not shown:
            header, _ = self._shown
            self._potential.publish(track_cloud(header, []))
            self._potential_markers.publish(clear_markers(header))
        self._with_potential_tracks = shown

    def _publish_placed(self, header: Header, scan: Scan) -> None:
        detections = convert(scan, self._session.settings.sensor, 0)
        offset = np.zeros(len(scan)) if scan.time_offset is None else scan.time_offset
        order = -1 if stated_axes(header.frame_id) == "down" else 1
        placed = PlacedDetections(
            detections["position"][:, ::order],
            detections["covariance"][:, ::order, ::order],
            offset,
            scan.features,
        )
        self._placed.publish(placed_detections_cloud(header, placed))

    def _publish_potential(self, header: Header) -> None:
        potential = TrackArrays.of(self._session.initiator.potential_tracks())
        tracks = exchanged(potential, header.frame_id)
        self._potential.publish(track_cloud(header, tracks))
        if self._potential_markers.get_subscription_count():
            self._draw(
                self._potential_markers, potential_track_markers(header, tracks, **self._sizes)
            )

    def _draw_echoes(self, header: Header) -> None:
        markers = fixed_echo_markers(header, self._echoes, minimum_size=self._sizes["minimum_size"])
        self._draw(self._fixed_echo_markers, markers)

    def _draw(self, publisher: Publisher, markers: MarkerArray) -> None:
        """Publish latched markers, which later viewers get as well."""
        publisher.publish(markers)
        self._drawn.add(publisher)

    def _on_viewer_change(self, event: Any) -> None:
        """Publish all markers for a new viewer, after deletion of those of an earlier run.

        Discovery has two sides, so the viewer may miss this message: the next scan repeats it.
        """
        if event.current_count_change > 0:
            header, tracks = self._shown
            self._markers.publish(track_markers(header, tracks, afresh=True, **self._sizes))
            self._redraw = True

    def _on_viewer_of_echoes(self, event: Any) -> None:
        """Publish the present fixed echoes for a new viewer, in place of those drawn last."""
        drawn = self._fixed_echo_markers in self._drawn
        if event.current_count_change > 0 and (drawn or len(self._echoes)):
            self._draw_echoes(self._shown[0])

    def _on_viewer_of_potential_tracks(self, event: Any) -> None:
        """Remove the potential tracks drawn last for a new viewer; the next scan draws its own."""
        if event.current_count_change > 0 and self._potential_markers in self._drawn:
            header, _ = self._shown
            self._potential_markers.publish(clear_markers(header))
