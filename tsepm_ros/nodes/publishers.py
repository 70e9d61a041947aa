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
"""Publishers of the results of a scan: the topics of the node, and log lines of its tracks.

Messages that are slow to build need a subscriber. The log lines have a limited rate.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
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
from msg_adapters.track_messages import marker_sizes
from tsepm_ros.diagnostics.health_figures import LatencyFigures
from tsepm_ros.nodes.base_node import OVERRIDABLE
from tsepm_ros.nodes.subscriptions import SubscriptionQos
from tsepm_ros.own_ship.registration import exchanged_after_registration, registration_axes
from tsepm_ros.session.session import ScanResult, Session
from tsepm_ros.tracker.maintenance.track_maintenance import ENDS
from tsepm_ros.tracker.measurement import convert_measurements
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.tracks import NO_TRACKS, ConfirmedTrack, TrackArrays

MAX_LINES = 10
"""Most lines of confirmed tracks, and of ended ones, per period."""
PERIOD = 10.0
"""Time over which the lines are counted, s."""
ELSEWHERE = {
    "confirmed": "all are on tracks",
    "ended": "/diagnostics counts all by their reasons",
}
"""Where the events are that no line says."""
LATCHED, VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
OUTPUTS = {
    "tracks": (PointCloud2, 100, VOLATILE),
    "tracks/current": (PointCloud2, 1, LATCHED),
    "tracks/odometry": (Odometry, 100, VOLATILE),
    "tracks/markers": (MarkerArray, 10, LATCHED),
    "fixed_echoes": (PointCloud2, 1, LATCHED),
    "fixed_echoes/markers": (MarkerArray, 1, LATCHED),
    "potential_tracks": (PointCloud2, 10, VOLATILE),
    "potential_tracks/markers": (MarkerArray, 1, LATCHED),
    "detections/placed": (PointCloud2, 100, VOLATILE),
}
"""Topics with their types, depths and durabilities."""
HELD = {"tracks/current": "current", "fixed_echoes": "fixed_echoes"}
"""Clouds of confirmed tracks, latched, and the field of a result that each has."""


def published_announcement(track: ConfirmedTrack, frame_id: str, reason: str) -> str:
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


class AnnouncementPublisher:
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
        self._say, self._clock = say, clock
        self._begin = dict.fromkeys(ELSEWHERE, -math.inf)
        self._lines = dict.fromkeys(ELSEWHERE, 0)
        self._left_out: dict[str, list[int]] = {event: [] for event in ELSEWHERE}

    def announce(self, result: ScanResult, reason: Callable[[ConfirmedTrack], str]) -> None:
        """Announce new and ended tracks of a scan; `reason` returns why one was confirmed."""
        new = {track.track_id: track for track in result.new}
        self._add(
            "confirmed",
            new,
            lambda number: published_announcement(
                new[number], result.frame_id, reason(new[number])
            ),
        )
        self._add(
            "ended",
            result.ended,
            lambda number: f"track {number} ended: {ENDS[result.ended[number]]}",
        )

    def _add(self, event: str, ids: Iterable[int], line: Callable[[int], str]) -> None:
        """Say the lines of an event of tracks by their ids, or count those above the limit."""
        left_out = self._left_out[event]
        if self._clock() - self._begin[event] >= PERIOD:
            if left_out:
                self._say_left_out(event)
            self._begin[event], self._lines[event] = self._clock(), 0
        for number in ids:
            if self._lines[event] < MAX_LINES:
                self._lines[event] += 1
                self._say(line(number))
            else:
                left_out.append(number)
        if left_out and self._lines[event] == MAX_LINES:  # once, and then with the next period
            self._lines[event] += 1
            self._say_left_out(event)

    def _say_left_out(self, event: str) -> None:
        """Say how many tracks were left out since this was said last."""
        ids, number = self._left_out[event], len(self._left_out[event])
        which = f"id {ids[0]}" if number == 1 else f"ids {ids[0]} to {ids[-1]}"
        self._say(
            f"{number} more {event} track{'s' if number > 1 else ''} ({which}), not listed one by "
            f"one: above {MAX_LINES} lines in {PERIOD:.0f} s; {ELSEWHERE[event]}"
        )
        ids.clear()


class TrackPublishers:
    """Publishes the result of each scan.

    Parameters
    ----------
    node : rclpy.node.Node
    session : Session
        Of a sensor of the picture.
    watch : SubscriptionQos
    with_potential_tracks : bool
        Whether potential tracks are published too.
    """

    def __init__(
        self, node: Node, session: Session, watch: SubscriptionQos, with_potential_tracks: bool
    ) -> None:
        self._session, self._picture = session, session.picture
        self._with_potential_tracks = with_potential_tracks
        self._header = make_header(0, "")
        self._result: ScanResult | None = None
        self._wanted: set[str] = set()
        self._redraw = True
        self._has_drawn_potential = False
        for_viewers: dict[str, Callable[[], None]] = {
            **{topic: partial(self._publish_held, topic) for topic in HELD},
            "tracks/markers": self._draw_afresh,
            "fixed_echoes/markers": self._draw_echoes,
            "potential_tracks/markers": self._clear_potential,
        }
        self._publishers = {
            topic: node.create_publisher(
                kind,
                topic,
                QoSProfile(depth=depth, durability=durability),  # which overrides change
                event_callbacks=watch.publisher_events(topic, for_viewers.get(topic)),
                qos_overriding_options=OVERRIDABLE,
            )
            for topic, (kind, depth, durability) in OUTPUTS.items()
        }

    def publish(self, result: ScanResult, entered: float) -> LatencyFigures:
        """Publish the result of a scan, new tracks first, and return its latency.

        `entered` is the `perf_counter` at the beginning of the callback.
        """
        begin = time.perf_counter()
        header = make_header(result.stamp_ns, result.frame_id)
        latched = self._publishers["tracks"].qos_profile.durability == LATCHED  # by an override
        if latched or self._is_heard("tracks"):
            self._publish("tracks", self._cloud(header, result.starts))
        published = time.perf_counter()
        self._publish_more(header, result)
        end = time.perf_counter()
        return LatencyFigures(
            to_tracks=published - entered,
            to_all=end - entered,
            waiting=result.waiting,
            core=result.core_seconds,
            publishing=end - begin,
        )

    def _cloud(self, header: Header, tracks: TrackArrays) -> PointCloud2:
        """The cloud of tracks, of several sensors with those that saw each."""
        is_named = bool(self._session.sensor)
        seen_by = self._picture.tracker.seen_by(tracks) if is_named else None
        return track_cloud(header, tracks, seen_by)

    def _publish(self, topic: str, message: Any) -> None:
        self._publishers[topic].publish(message)

    def _held(self, topic: str) -> TrackArrays:
        """The confirmed tracks of a topic, after the last scan."""
        return NO_TRACKS if self._result is None else getattr(self._result, HELD[topic])

    def _publish_held(self, topic: str) -> None:
        """Publish a topic of confirmed tracks: in every scan from its first subscriber on."""
        self._wanted.add(topic)
        if self._result is not None:
            self._publish(topic, self._cloud(self._header, self._held(topic)))

    def _is_heard(self, topic: str) -> bool:
        return self._publishers[topic].get_subscription_count() > 0

    def _publish_more(self, header: Header, result: ScanResult) -> None:
        if self._is_heard("detections/placed"):  # first: trackers wait for it
            self._publish_placed(header, result.scan)
        before = self._result
        self._header, self._result = header, result
        for topic in HELD:
            if topic in self._wanted or self._is_heard(topic):
                self._publish_held(topic)
        # Nested messages are slow to build in Python: only if there is a subscriber.
        if self._is_heard("tracks/odometry"):
            for track in result.starts:
                self._publish("tracks/odometry", track_odometry(header, track))
        if self._is_heard("tracks/markers"):
            # Those that ended, and those that have become fixed echoes.
            drawn = NO_TRACKS if before is None else before.current
            self._draw_tracks(np.setdiff1d(drawn.track_id, result.current.track_id).tolist())
            self._redraw = False
        if self._is_heard("fixed_echoes/markers"):
            self._draw_echoes()
        if self._with_potential_tracks:
            self._publish_potential(header)

    @property
    def _sizes(self) -> dict[str, Any]:
        each = [session.settings for session in self._picture.sessions.values()]
        reach = max(settings.sensor.max_range for settings in each)
        return marker_sizes(reach, each[0].common.max_speed)

    def clear(self, stamp_ns: int) -> None:
        """Publish at a stamp, ns, that there are no tracks, and remove the markers."""
        header = self._header = make_header(stamp_ns, self._header.frame_id)
        self._result = None
        for topic in ("tracks/markers", "potential_tracks/markers", "fixed_echoes/markers"):
            self._publish(topic, clear_markers(header))
        for topic in HELD:
            self._publish(topic, self._cloud(header, NO_TRACKS))

    def show_potential_tracks(self, shown: bool) -> None:
        """Publish potential tracks from now on, or no longer; the last ones are removed then."""
        if self._with_potential_tracks and not shown:
            self._publish("potential_tracks", track_cloud(self._header, []))
            self._clear_potential()
        self._with_potential_tracks = shown

    def _publish_placed(self, header: Header, scan: Scan) -> None:
        session = self._picture.sessions[scan.sensor]
        detections = convert_measurements(scan, session.settings.sensor, 0)
        offset = np.zeros(len(scan)) if scan.time_offset is None else scan.time_offset
        order = -1 if registration_axes(header.frame_id) == "down" else 1
        placed = PlacedDetections(
            detections["position"][:, ::order],
            detections["covariance"][:, ::order, ::order],
            offset,
            scan.features,
            session.state.number if scan.sensor else None,
        )
        self._publish("detections/placed", placed_detections_cloud(header, placed))

    def _publish_potential(self, header: Header) -> None:
        potential = TrackArrays.from_tracks(self._picture.tracker.potential_tracks())
        tracks = exchanged_after_registration(potential, header.frame_id)
        self._publish("potential_tracks", track_cloud(header, tracks))
        if self._is_heard("potential_tracks/markers"):
            markers = potential_track_markers(header, tracks, **self._sizes)
            self._publish("potential_tracks/markers", markers)
            self._has_drawn_potential = True

    def _draw_tracks(self, gone: Sequence[int] = ()) -> None:
        tracks = self._held("tracks/current")
        markers = track_markers(self._header, tracks, gone, afresh=self._redraw, **self._sizes)
        self._publish("tracks/markers", markers)

    def _draw_afresh(self) -> None:
        """Publish all markers for a new viewer, after deletion of those of an earlier run.

        Discovery has two sides, so the viewer may miss this message: the next scan repeats it.
        """
        self._redraw = True
        self._draw_tracks()

    def _draw_echoes(self) -> None:
        """Publish the present fixed echoes, also for a new viewer in place of those drawn last."""
        size = self._sizes["minimum_size"]
        markers = fixed_echo_markers(self._header, self._held("fixed_echoes"), minimum_size=size)
        self._publish("fixed_echoes/markers", markers)

    def _clear_potential(self) -> None:
        """Remove the potential tracks drawn last for a new viewer; the next scan draws its own."""
        if self._has_drawn_potential:
            self._publish("potential_tracks/markers", clear_markers(self._header))
