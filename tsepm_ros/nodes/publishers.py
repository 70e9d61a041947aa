"""Publishers: the topics of the node, and the log of its tracks.

Log lines of confirmed tracks and of their ends, at a limited rate.

Topics of the track initiator; messages that are slow to build need a subscriber.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
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
from tsepm_ros.nodes import quality_of_service
from tsepm_ros.nodes.quality_of_service import QosWatch
from tsepm_ros.own_ship.registration import exchanged, stated_axes
from tsepm_ros.session.session import ScanResult, Session
from tsepm_ros.tracker.maintenance.track_maintenance import ENDS
from tsepm_ros.tracker.measurement import convert
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.tracks import NO_TRACKS, ConfirmedTrack, TrackArrays

MAX_LINES = 10
"""Most lines of confirmed tracks, and of ended ones, per period."""
PERIOD = 10.0
"""Time over which the lines are counted, s."""


def announcement(track: ConfirmedTrack, frame_id: str, reason: str) -> str:
    """One line of a confirmed track: its id, place, speed and direction, and the reason.

    The direction is counter-clockwise from the x axis of the fixed frame; the reason begins with
    the hits.
    """
    x, vx, y, vy = track.state.tolist()
    direction = math.degrees(math.atan2(vy, vx))
    return (
        f"track {track.track_id} confirmed at x {x:.1f} m, y {y:.1f} m in {frame_id}, "
        f"{math.hypot(vx, vy):.1f} m/s towards {direction:.0f} deg from x: {reason}"
    )


class TrackAnnouncements:
    """Says a line for each confirmed track and for each end, each at most `MAX_LINES` per `PERIOD`.

    Of the tracks left out, one line per period says the number and the ids.

    Parameters
    ----------
    say : callable
        Called with each line.
    clock : callable, optional
        Returns the time, s.
    """

    def __init__(
        self, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._confirmed = _LimitedLines(say, clock, "confirmed", "all are on tracks")
        self._ended = _LimitedLines(say, clock, "ended", "/diagnostics counts all by their reasons")

    def announce(self, result: ScanResult, reason: Callable[[ConfirmedTrack], str]) -> None:
        """Announce new and ended tracks of a scan; `reason` returns why one was confirmed."""
        new = {track.track_id: track for track in result.new}
        self._confirmed.add(
            new, lambda number: announcement(new[number], result.frame_id, reason(new[number]))
        )
        self._ended.add(
            result.ended, lambda number: f"track {number} ended: {ENDS[result.ended[number]]}"
        )


class _LimitedLines:
    """Lines of one kind of event of tracks."""

    def __init__(
        self, say: Callable[[str], None], clock: Callable[[], float], event: str, elsewhere: str
    ) -> None:
        self._say, self._clock, self._event, self._elsewhere = say, clock, event, elsewhere
        self._begin, self._lines, self._summed = -math.inf, 0, False
        self._left_out: list[int] = []

    def add(self, ids: Mapping[int, object], line: Callable[[int], str]) -> None:
        """Say the lines of tracks by their ids, or count those above the limit."""
        if self._clock() - self._begin >= PERIOD:
            if self._left_out:
                self._say_left_out()
            self._begin, self._lines, self._summed = self._clock(), 0, False
        for number in ids:
            if self._lines < MAX_LINES:
                self._lines += 1
                self._say(line(number))
            else:
                self._left_out.append(number)
        if self._left_out and not self._summed:
            self._summed = True
            self._say_left_out()

    def _say_left_out(self) -> None:
        """Say how many tracks were left out since this was said last."""
        first, last, number = self._left_out[0], self._left_out[-1], len(self._left_out)
        which = f"id {first}" if number == 1 else f"ids {first} to {last}"
        self._say(
            f"{number} more {self._event} track{'s' if number > 1 else ''} ({which}), not listed "
            f"one by one: above {MAX_LINES} lines in {PERIOD:.0f} s; {self._elsewhere}"
        )
        self._left_out.clear()


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
            draw: Callable[[], None] | None = None,
        ) -> Publisher:
            matched = self._on_viewer(draw) if draw else None
            return node.create_publisher(
                message_type,
                topic,
                qos,
                event_callbacks=watch.publisher_events(topic, matched),
                qos_overriding_options=quality_of_service.PUBLISHER,
            )

        self._shown: tuple[Header, TrackArrays] = make_header(0, ""), NO_TRACKS
        self._echoes: Sequence[ConfirmedTrack] = ()
        self._drawn: set[Publisher] = set()
        self._redraw = True
        self._tracks = publisher(PointCloud2, "tracks", 100)
        self._current = publisher(PointCloud2, "tracks/current", _latched(1))
        self._odometry = publisher(Odometry, "tracks/odometry", 100)
        self._markers = publisher(MarkerArray, "tracks/markers", _latched(10), self._draw_afresh)
        self._fixed_echoes = publisher(PointCloud2, "fixed_echoes", _latched(1))
        self._fixed_echo_markers = publisher(
            MarkerArray, "fixed_echoes/markers", _latched(1), self._redraw_echoes
        )
        self._potential = publisher(PointCloud2, "potential_tracks", 10)
        self._potential_markers = publisher(
            MarkerArray,
            "potential_tracks/markers",
            _latched(1),
            self._clear_potential,
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
        potential = TrackArrays.of(self._session.tracker.potential_tracks())
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

    @staticmethod
    def _on_viewer(draw: Callable[[], None]) -> Callable[[Any], None]:
        """The callback of subscribers that come and go, which draws for those that come."""
        return lambda event: draw() if event.current_count_change > 0 else None

    def _draw_afresh(self) -> None:
        """Publish all markers for a new viewer, after deletion of those of an earlier run.

        Discovery has two sides, so the viewer may miss this message: the next scan repeats it.
        """
        header, tracks = self._shown
        self._markers.publish(track_markers(header, tracks, afresh=True, **self._sizes))
        self._redraw = True

    def _redraw_echoes(self) -> None:
        """Publish the present fixed echoes for a new viewer, in place of those drawn last."""
        if self._fixed_echo_markers in self._drawn or len(self._echoes):
            self._draw_echoes(self._shown[0])

    def _clear_potential(self) -> None:
        """Remove the potential tracks drawn last for a new viewer; the next scan draws its own."""
        if self._potential_markers in self._drawn:
            self._potential_markers.publish(clear_markers(self._shown[0]))
