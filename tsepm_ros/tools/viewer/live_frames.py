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
"""Frames from the messages of live topics, gathered by stamp.

Nothing here needs rclpy.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from msg_adapters import (
    MessageError,
    ns_to_seconds,
    read_fields,
    read_own_ship,
    read_track_cloud,
    time_to_ns,
)
from msg_adapters.track_messages import track_arrays
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import exchanged_after_registration, registration_axes
from tsepm_ros.tools.viewer.alarms import ObservedScan, finite_tracks
from tsepm_ros.tools.viewer.page_content import (
    Frame,
    make_page_frame,
    page_own_ship_history,
    page_own_ship_velocity,
    page_track_facts,
)
from tsepm_ros.tracker.tracks import NO_TRACKS, TrackArrays

DETECTIONS, NEW, TRACKS = "detections/placed", "tracks", "tracks/current"
POTENTIAL, FIXED = "potential_tracks", "fixed_echoes"
OWN_SHIP = "own_ship/odometry"
"""The topics that are watched, named as in the track initiator."""

SENSOR, SEEN_BY = "sensor", "seen_by"
"""Fields of `DETECTIONS` and of tracks where there are several sensors: the number of one, and bits
of those that see a track."""

CLOUDS = (NEW, DETECTIONS, TRACKS, POTENTIAL, FIXED)

MAX_PENDING = 16
"""Scans that wait to be drawn, and scans whose messages may still arrive late."""

MAX_HEADING_VARIANCE = 10.0
"""A heading with a larger variance, rad^2, is unknown: sources write large numbers for that."""

MAX_OWN_SHIP_AGE = 5.0
"""Age of own ship's newest message, s, up to which closest approaches are shown."""

TRACKS_WAIT = 1.0
"""Time that a scan waits for its confirmed tracks, s."""

RESTING = (0.0, 0.0, 0.0, 0.0, 0.0)
"""Own ship that does not move: x, y, heading and velocity."""

MIN_CELL = 1e-3
"""Smallest accuracy of potential tracks' positions, m."""


@dataclass
class ScanMessages:
    """The messages of one scan.

    Attributes
    ----------
    stamp : float
        s.
    number : int
        Number of the frame.
    restart : bool
        Whether its stamp goes back.
    clouds : list of (str, message)
        Messages that have not been read, with their topics.
    frame_id : str
        The fixed frame; empty before a message was read.
    detections : dict of int to (n, 2) ndarray
        By the number of the sensor; -1: there is one.
    tracks : dict of str to TrackArrays
        By topic: NEW, TRACKS and POTENTIAL.
    begun : float
        When its first message came, s of the monotonic clock.
    has_tracks : bool
        Whether its confirmed tracks have come.
    """

    stamp: float
    number: int
    restart: bool
    clouds: list[tuple[str, Any]] = field(default_factory=list)
    frame_id: str = ""
    detections: dict[int, FloatArray] = field(default_factory=dict)
    tracks: dict[str, TrackArrays] = field(
        default_factory=lambda: dict.fromkeys((NEW, TRACKS, POTENTIAL), NO_TRACKS)
    )
    begun: float = field(default_factory=time.monotonic)
    has_tracks: bool = False


class LiveFrames:
    """Gathers the messages of each scan to a frame.

    Messages belong together by their stamps. A stamp that goes back on its own topic is a restart
    of the source. Fixed echoes are shown until the next message of them. A scan waits for its
    confirmed tracks or those of a later scan, for at most `TRACKS_WAIT`; a scan without tracks is
    shown with the last.

    Parameters
    ----------
    report : callable
        Called with the topic and the error for a message that cannot be read.
    is_north : bool, optional
        Whether y is known to be north, even if own ship does not move.

    Attributes
    ----------
    source : str
        Source of own ship as the track initiator states it; empty: not known.
    """

    def __init__(self, report: Callable[[str, ValueError], None], is_north: bool = False) -> None:
        self._report, self._is_north = report, is_north
        self._scans: dict[int, ScanMessages] = {}  # the newest, by stamp
        self._newest: dict[str, int] = {}  # stamp by topic, ns
        self._number = 0
        self._fixed: tuple[str, TrackArrays] = "", NO_TRACKS
        self._held: tuple[str, TrackArrays] = "", NO_TRACKS  # the last confirmed tracks
        self._own_ship: PoseSample | None = None
        self._poses = page_own_ship_history()
        self._seen: dict[int, int] = {}  # bits of several sensors, by track
        self._known: set[int] = set()
        self._observed = 0  # number of the last scan that the alarms have seen
        self.source = ""

    def take(self, topic: str, cloud: Any) -> None:
        """Take a message of one of the CLOUDS; a message that is too late is left out."""
        stamp_ns = time_to_ns(cloud.header.stamp)
        restart = stamp_ns < self._newest.get(topic, stamp_ns)
        if restart:
            self._scans.clear()
            self._newest.clear()
            self._poses.clear()
            self._fixed = self._held = "", NO_TRACKS
        last = max(self._newest.values(), default=stamp_ns)
        self._newest[topic] = stamp_ns
        scan = self._scans.get(stamp_ns)
        if scan is None and stamp_ns >= last:
            self._number += 1
            scan = self._scans[stamp_ns] = ScanMessages(
                ns_to_seconds(stamp_ns), self._number, restart
            )
            if len(self._scans) > MAX_PENDING:
                del self._scans[next(iter(self._scans))]
        if scan is not None and (stamp_ns >= last or scan.clouds):
            scan.clouds.append((topic, cloud))
            scan.has_tracks |= topic == TRACKS

    def take_own_ship(self, message: Any) -> None:
        """Take the own ship's odometry."""
        try:
            sample = read_own_ship(message)
            sample.check()
            self._poses.add(sample)
            self._own_ship = sample
        except ValueError as error:
            self._report(OWN_SHIP, error)

    def take_frames(self) -> list[tuple[Frame, dict[str, Frame], ObservedScan | None]]:
        """Make the frames of the scans with new messages, each with its new tracks' facts.

        A scan is for the alarms once, when its confirmed tracks have come.
        """
        overdue = time.monotonic() - TRACKS_WAIT
        ready = [
            scan.number
            for scan in self._scans.values()
            if scan.has_tracks or scan.begun <= overdue or TRACKS not in self._newest
        ]
        return [
            self._frame(scan)
            for scan in self._scans.values()
            if scan.clouds and scan.number <= max(ready, default=0)
        ]

    @property
    def waits(self) -> bool:
        """Whether a scan waits for its confirmed tracks."""
        return any(scan.clouds for scan in self._scans.values())

    def _frame(self, scan: ScanMessages) -> tuple[Frame, dict[str, Frame], ObservedScan | None]:
        for topic, cloud in scan.clouds:
            try:
                self._read(scan, topic, cloud)
            except MessageError as error:
                self._report(topic, error)
        facts = self._new_facts(scan, TRACKS in [topic for topic, _ in scan.clouds])
        scan.clouds.clear()
        fixed_frame, fixed = self._fixed
        held_frame, held = self._held
        if not scan.has_tracks and held_frame == scan.frame_id:
            scan.tracks[TRACKS] = held
        pose = self._pose(scan)
        resting = RESTING if self.source == "none" else None
        fixed = fixed if fixed_frame == scan.frame_id else NO_TRACKS
        frame = make_page_frame(
            scan.stamp,
            scan.frame_id,
            number=scan.number,
            detections=np.concatenate([np.zeros((0, 2)), *scan.detections.values()]),
            tracks=scan.tracks[TRACKS],
            potential=scan.tracks[POTENTIAL],
            fixed=fixed,
            own_ship=pose,
            resting=resting,
            restart=scan.restart,
            seen=self._seen,
            sensors=[k for k, one in scan.detections.items() for _ in one if k >= 0],
        )
        if not scan.has_tracks or scan.number <= self._observed:
            return frame, facts, None
        self._observed = scan.number
        tracks = finite_tracks(scan.tracks[TRACKS])
        ids = frozenset(fixed.track_id.tolist())
        return frame, facts, ObservedScan(scan.stamp, tracks, ids, pose or resting, self.north)

    @property
    def north(self) -> bool:
        """Whether y is north: it is known, or own ship moves in the fixed frame."""
        return self.source in ("odometry", "tf") or self._is_north or self._own_ship is not None

    def _read(self, scan: ScanMessages, topic: str, cloud: Any) -> None:
        scan.frame_id = cloud.header.frame_id.lstrip("/")
        filled = cloud.width * cloud.height > 0
        if filled and topic == DETECTIONS:
            names = ("position_x", "position_y")[
                :: -1 if registration_axes(scan.frame_id) == "down" else 1
            ]
            position = read_fields(cloud, names)
            sensor = [*_of_several(cloud, SENSOR), -1][0]  # a message is of one scan
            scan.detections[sensor] = np.stack([position[name] for name in names], axis=1)
            return
        tracks = track_arrays(read_track_cloud(cloud), scan.stamp) if filled else NO_TRACKS
        tracks = exchanged_after_registration(tracks, scan.frame_id)
        if topic == TRACKS:
            self._held = scan.frame_id, tracks
            bits = _of_several(cloud, SEEN_BY)
            self._seen = dict(zip(tracks.track_id.tolist(), bits, strict=False))
            scan.tracks[TRACKS] = tracks
        elif topic == FIXED:
            self._fixed = scan.frame_id, tracks
        elif filled:
            scan.tracks[topic] = _hypotheses(tracks) if topic == POTENTIAL else tracks

    def _new_facts(self, scan: ScanMessages, complete: bool) -> dict[str, Frame]:
        """Facts of the tracks that are confirmed by a scan or seen for the first time.

        `complete`: whether the confirmed tracks have arrived, so that others are forgotten.
        """
        new, held = scan.tracks[NEW], scan.tracks[TRACKS]
        new_ids, ids = new.track_id.tolist(), held.track_id.tolist()
        first_seen = [row for row, key in enumerate(ids) if key not in self._known]
        facts = page_track_facts(held.where(np.array(first_seen, int)), None)
        facts.update(page_track_facts(new, scan.stamp))
        self._known = {*ids, *new_ids} if complete else self._known.union(new_ids)
        return facts

    def _pose(self, scan: ScanMessages) -> list[float] | None:
        """Own ship at the scan's stamp, or as in its newest message without a velocity."""
        pose = self._own_ship
        if pose is None or pose.frame_id != scan.frame_id:
            return None
        known = pose.covariance is None or pose.covariance[2, 2] < MAX_HEADING_VARIANCE
        elapsed = scan.stamp - pose.stamp
        fresh = elapsed <= MAX_OWN_SHIP_AGE
        vx, vy = page_own_ship_velocity(self._poses, scan.stamp) if fresh else (math.nan, math.nan)
        moved = np.nan_to_num(elapsed * np.array([vx, vy]))
        x, y = pose.x + moved[0], pose.y + moved[1]
        return [x, y, pose.yaw if known else math.nan, vx, vy, elapsed]


def _of_several(cloud: Any, name: str) -> list[int]:
    """Values of a field that clouds of several sensors alone have; else empty."""
    names = [one.name for one in cloud.fields if one.name == name]
    values = read_fields(cloud, names, integers=names)
    return [int(value) for one in values.values() for value in one]


def _hypotheses(tracks: TrackArrays) -> TrackArrays:
    """Potential tracks of a message, which has no hits, with their newest one.

    Hypotheses in the same place, to the accuracy of their positions, are taken for those of one
    newest detection.
    """
    variance = np.nan_to_num(tracks.covariance[:, [0, 2], [0, 2]].sum(axis=1), posinf=0.0)
    side = 2.0 * np.sqrt(max(float(np.median(variance)), MIN_CELL**2))
    with np.errstate(invalid="ignore"):
        cells = np.nan_to_num(np.floor(tracks.state[:, 0::2] / side))
    _, row = np.unique(cells[:, 0] + 1j * cells[:, 1], return_inverse=True)
    return replace(tracks, hits=np.fromiter([((0, index),) for index in row.tolist()], object))
