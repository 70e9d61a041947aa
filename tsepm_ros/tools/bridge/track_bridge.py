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
"""The node that hands tracks on to chart plotters and navigation stacks."""

from __future__ import annotations

import math
import socket
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pyproj  # noqa: F401 - of `GeographicReference`: missing at the start, not later
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import NavSatFix, PointCloud2

from msg_adapters import (
    MessageError,
    message_class,
    read_own_ship,
    read_track_cloud,
)
from msg_adapters.nav_messages import read_fix
from msg_adapters.stamps import ns_to_seconds, time_to_ns
from msg_adapters.stamps import refusing as refusing_message
from msg_adapters.track_messages import radar_tracks, track_arrays, tracked_objects
from tsepm_ros.diagnostics import input_health as health
from tsepm_ros.nodes.base_node import (
    OVERRIDABLE,
    BaseNode,
    refusing_node_parameter,
    run_node,
)
from tsepm_ros.nodes.subscriptions import OfferedSubscription, SubscriptionQos
from tsepm_ros.nodes.tf_own_ship import tf_buffer, tf_own_ship
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import RATE_SPAN, PoseHistory, PoseSample, pose_jump
from tsepm_ros.own_ship.registration import exchanged_after_registration
from tsepm_ros.session.drop_reasons import OWN_SHIP as OWN_SHIP_DATA
from tsepm_ros.session.inputs import bounded_input_tracks
from tsepm_ros.settings.node_options import BridgeNodeOptions, udp_address_option
from tsepm_ros.settings.settings import settings_help
from tsepm_ros.tools.bridge import nmea
from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tools.live_commands import NEWEST
from tsepm_ros.tracker.tracks import TrackArrays

TRACKS, OWN_SHIP, FIX = "tracks/current", "own_ship/odometry", "fix"
DEPTH = 10
JUMP, AGREEING = 100.0, 5
"""Distance, m, between a fix and where odometry and the fix before have own ship, from which on a
fix is doubted; and the number of fixes in a row that agree before they are believed."""
SIGNAL_K = "Signal K"
MESSAGES: dict[str, tuple[str, Callable[..., Any]]] = {
    "tracks/radar": ("radar_msgs/msg/RadarTracks", radar_tracks),
    "tracks/objects": ("autoware_perception_msgs/msg/TrackedObjects", tracked_objects),
}
"""Of each topic the message type and what makes it of tracks."""


class TrackBridge(BaseNode):
    """Subscribes to confirmed tracks and publishes them in the messages and sentences of others."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("track_bridge", **node_options)
        self.watch(health.TRACKS, "track message", TRACKS)
        options: BridgeNodeOptions = self.options[BridgeNodeOptions]
        self._options = options
        self._instance, self._largest = uuid.uuid4(), (-1, -math.inf)
        self._numbers, self._poses = nmea.NmeaTargetNumbers(), PoseHistory(2, 2.0 * RATE_SPAN)
        self._reported = -math.inf
        self._odometry: bytes | None = None
        self._frame, self._reference_frame = "", ""  # of the tracks, and of the reference
        self._reference: GeographicReference | None = None
        self._doubted: list[GeographicReference] = []
        with refusing_node_parameter("origin"):
            if options.origin:
                self._reference = GeographicReference.read(options.origin)
        kinds = ("TTM", "TLL") if options.nmea_sentences == "both" else (options.nmea_sentences,)
        given = {
            **dict.fromkeys(kinds, udp_address_option("nmea_address", options.nmea_address)),
            SIGNAL_K: udp_address_option("signal_k_address", options.signal_k_address),
        }
        self._addresses = {kind: address for kind, address in given.items() if address}
        self._told = {kind: nmea.NmeaReports() for kind in self._addresses}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._socket.setblocking(False)
        self._from_north = options.own_ship_source != "none" or bool(options.origin)
        self._publish()
        self._subscribe()
        self.refuse_unused_overrides()

    def _publish(self) -> None:
        """Make the publishers of the messages whose packages are installed."""
        self._messages: list[tuple[Any, Callable[..., Any]]] = []
        for topic, (name, make) in MESSAGES.items():
            try:
                kind = message_class(name, readable=(name,))
            except MessageError:
                self.get_logger().info(f"{name.partition('/')[0]} is not installed: no {topic}")
                continue
            self._messages.append(
                (
                    self.create_publisher(kind, topic, DEPTH, qos_overriding_options=OVERRIDABLE),
                    make,
                )
            )
        for receiver, (host, port) in self._addresses.items():
            self.get_logger().info(f"{receiver} to {host}, UDP port {port}")

    def _subscribe(self) -> None:
        durability = DurabilityPolicy.TRANSIENT_LOCAL
        self._tracks = OfferedSubscription(
            self,
            PointCloud2,
            TRACKS,
            DEPTH,
            self._take,
            SubscriptionQos(self),
            durability=durability,
        )
        if self._options.own_ship_source == "odometry":
            # It may come much more often than tracks: only the newest before these is read.
            self.create_subscription(Odometry, OWN_SHIP, self._keep, NEWEST, raw=True)
            self.watch(OWN_SHIP_DATA, "own-ship data", OWN_SHIP)
        elif self._options.own_ship_source == "tf":
            self._buffer = tf_buffer(self)
        if not self._options.origin:
            self.create_subscription(NavSatFix, FIX, self._take_fix, NEWEST)
            self.watch(health.FIX, "fix", FIX)

    def destroy_node(self) -> None:
        """End what the receivers show, destroy the node and close its socket."""
        self._report_tracks(TrackArrays.from_tracks([]), self._reported)
        self._socket.close()
        super().destroy_node()

    def _keep(self, odometry: bytes) -> None:
        self._odometry = odometry
        self._heard(OWN_SHIP_DATA)

    def _heard(self, task: str) -> None:
        """Note an arrival, by its time: odometry is read later, or never."""
        now = time.monotonic()
        self.health.heard(task, now, now)

    def _take(self, cloud: PointCloud2) -> None:
        """Hand on the confirmed tracks after a ping, if somebody takes them now."""
        self._heard(health.TRACKS)
        wanted = [output for output in self._messages if output[0].get_subscription_count()]
        try:
            stamp = ns_to_seconds(time_to_ns(cloud.header.stamp))
            # A stamp that goes back is of another run.
            due = self._addresses and not (
                self._reported <= stamp < self._reported + self._options.nmea_period
            )
            if not due and not wanted:
                return
            tracks = track_arrays(read_track_cloud(cloud), stamp)
        except MessageError as error:
            self.drop("bad_tracks", f"{TRACKS} is not used: {error}")
            return
        usable = bounded_input_tracks(tracks)
        if not usable.all():
            self.drop(
                "bad_state",
                "a track whose state or covariance is not finite, or on no place of the earth, is "
                "not handed on",
                int(np.count_nonzero(~usable)),
            )
            tracks = tracks.where(usable)
        again, self._largest = nmea.nmea_ids_again(self._largest, tracks, stamp)
        if again:  # other vessels
            self._report_tracks(TrackArrays.from_tracks([]), stamp)
            self._instance = uuid.uuid4()
        for publisher, make in wanted:
            publisher.publish(make(cloud.header, tracks, self._instance))
        self._frame = cloud.header.frame_id.lstrip("/")
        if due:
            self._reported = stamp
            self._report_tracks(exchanged_after_registration(tracks.sure, self._frame), stamp)

    def _report_tracks(self, tracks: TrackArrays, stamp: float) -> None:
        """Send reports of tracks in east and north."""
        present = tracks.track_id.tolist()
        without = self._numbers.update(present)
        if without and self._addresses.keys() - {SIGNAL_K}:
            self.drop("numbers", f"tracks beyond {nmea.NUMBERS} are not sent", without)
        for kind, told in self._told.items():
            reports: Mapping[int, nmea.Report] = {}
            try:
                reports = self._reports(kind, tracks, stamp) if present else {}
            except ValueError as error:
                self.drop(getattr(error, "reason", "bad_own_ship"), f"no {kind}: {error}")
            for text in told.texts(set(present), stamp, reports):
                try:
                    self._socket.sendto(text.encode("ascii"), self._addresses[kind])
                except OSError as error:
                    sentence = f"reports cannot be sent to {self._addresses[kind]}: {error}"
                    self.drop("not_sent", sentence)

    def _reports(self, kind: str, tracks: TrackArrays, stamp: float) -> Mapping[int, nmea.Report]:
        """Reports of a kind.

        Raises
        ------
        ValueError
            If own ship, or for places on the earth the reference, is not known.
        """
        talker, numbers = self._options.nmea_talker, self._numbers.of
        number = len(set(tracks.track_id.tolist()) if kind == SIGNAL_K else numbers)
        if kind == "TTM":
            position, velocity, frame = self._own_ship(stamp)
            self._check_frame(frame)
            reports: Mapping[int, nmea.Report] = nmea.nmea_ttm(
                talker, tracks, numbers, (position, velocity), self._from_north
            )
        elif self._reference is None:
            raise MessageError("no_position", f"no usable position on {FIX}, and no origin")
        else:
            self._check_frame(self._reference_frame)
            places = self._reference.geographic(tracks.state[:, 0::2])
            if kind == SIGNAL_K:
                reports = nmea.nmea_deltas(tracks, self._instance, places)
            else:
                reports = nmea.nmea_tll(talker, tracks, numbers, places)
        if len(reports) < number:
            self.drop(
                "too_far",
                f"tracks that are on no place of the earth, or faster than {nmea.MAX_SPEED} knots, "
                f"are not sent as {kind}",
                number - len(reports),
            )
        return reports

    def _check_frame(self, frame: str) -> None:
        """Refuse own ship in another frame than that of the tracks; unnamed frames are equal."""
        if frame and self._frame and frame != self._frame:
            raise MessageError(
                "frames",
                f"own ship is in the frame {frame!r}, but the tracks are in {self._frame!r}: let "
                f"{OWN_SHIP} and {TRACKS} have one frame (fixed_frame of track_initiator), or give "
                "own_ship_source:=tf",
            )

    def _own_ship(self, stamp: float) -> tuple[FloatArray, FloatArray, str]:
        """Position, velocity and frame of own ship at a stamp.

        A velocity that its source does not state is that of its poses; of the first one 0.

        Raises
        ------
        ValueError
            If it is not known.
        """
        source, frame = self._options.own_ship_source, self._options.own_ship_frame
        if source == "none":
            return np.zeros(2), np.zeros(2), ""
        by_tf = source == "tf"
        sample = tf_own_ship(self._buffer, self._frame, frame, stamp) if by_tf else self._newest()
        with refusing_message("bad_own_ship", f"{'tf' if by_tf else OWN_SHIP} is not used:"):
            sample.check()
        elapsed = stamp - sample.stamp
        if abs(elapsed) > self._options.own_ship_timeout:
            raise MessageError(
                "own_ship_stale",
                f"its stamp, {stamp:.3f} s, is {abs(elapsed):.3g} s "
                f"{'after' if elapsed > 0.0 else 'before'} that of own ship, {sample.stamp:.3f} s, "
                f"more than own_ship_timeout of {self._options.own_ship_timeout:g} s",
            )
        if (  # clock or origin were set
            sample.stamp < (self._poses.last_stamp or sample.stamp)
            or pose_jump(self._poses.newest, sample)
        ):
            self._poses.clear()
        self._poses.add(sample)
        velocity = np.nan_to_num(self._poses.rates(np.array([sample.stamp]), sample.stamp)[0, :2])
        return np.array([sample.x, sample.y]) + elapsed * velocity, velocity, sample.frame_id

    def _newest(self) -> PoseSample:
        """Own ship by the newest odometry."""
        if self._odometry is None:
            raise MessageError(
                "no_own_ship",
                f"there is no message on {OWN_SHIP}; a fixed sonar needs own_ship_source:=none",
            )
        with refusing_message("bad_own_ship", f"{OWN_SHIP} is not used:"):
            try:
                return read_own_ship(deserialize_message(self._odometry, Odometry))
            except RuntimeError as error:
                raise ValueError(f"it is no message: {error}") from error

    def _take_fix(self, fix: NavSatFix) -> None:
        """Tie the fixed frame to the earth where own ship is now."""
        self._heard(health.FIX)
        try:
            stamp, latitude, longitude, std = read_fix(fix)
            position, _, frame = self._own_ship(stamp)
            reference = GeographicReference(latitude, longitude, *position.tolist())
            self._tie(reference, frame, JUMP + 3.0 * float(np.nan_to_num(std)))
        except ValueError as error:
            self.drop(getattr(error, "reason", "bad_fix"), f"{FIX} is not used: {error}")

    def _tie(self, reference: GeographicReference, frame: str, near: float) -> None:
        """Take a reference, unless it is not near where the one before has own ship.

        Raises
        ------
        MessageError
            If it is not, until `AGREEING` in a row are near to each other.
        """
        known = self._reference if frame == self._reference_frame else None
        away = known.distance(reference) if known else 0.0
        if not away <= near:  # or not on the earth
            agrees = self._doubted and self._doubted[-1].distance(reference) <= near
            self._doubted = [*(self._doubted if agrees else ()), reference]
            if len(self._doubted) < AGREEING:
                raise MessageError(
                    "fix_jump",
                    f"it is {away:.0f} m from where own ship is by the fixes before and its own "
                    f"motion; it is used if {AGREEING} fixes in a row agree",
                )
        self._reference, self._reference_frame, self._doubted = reference, frame, []


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(TrackBridge, args, settings_help("track_bridge", __doc__))
