"""The node that hands tracks on to chart plotters and navigation stacks."""

from __future__ import annotations

import math
import socket
import uuid
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pyproj  # noqa: F401 - of `GeographicReference`: missing at the start, not later
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import NavSatFix, NavSatStatus, PointCloud2

from msg_adapters import MessageError, message_class, read_own_ship, read_track_cloud
from msg_adapters.stamps import ns_to_seconds, time_to_ns
from msg_adapters.track_messages import radar_tracks, track_arrays, tracked_objects
from tsepm_ros.nodes.base_node import ParameterisedNode, refusing, run
from tsepm_ros.nodes.subscriptions import OfferedSubscription, QosWatch
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.registration import exchanged
from tsepm_ros.session.inputs import MAX_STATE, bounded
from tsepm_ros.settings.node_options import BridgeNodeOptions, udp_address
from tsepm_ros.settings.settings import help_text
from tsepm_ros.tools.bridge import nmea
from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tracker.tracks import TrackArrays

TRACKS, OWN_SHIP, FIX = "tracks/current", "own_ship/odometry", "fix"
DEPTH = 10
CHECK_PERIOD = 1.0
"""Time between checks whether the context was shut down, s."""
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort is compatible with every publisher."""
MESSAGES: dict[str, tuple[str, Callable[..., Any]]] = {
    "tracks/radar": ("radar_msgs/msg/RadarTracks", radar_tracks),
    "tracks/objects": ("autoware_perception_msgs/msg/TrackedObjects", tracked_objects),
}
"""Of each topic the message type and what makes it of tracks."""


class TrackBridge(ParameterisedNode):
    """Subscribes to the held tracks and publishes them in the messages and sentences of others."""

    _drop = ParameterisedNode.drop

    def __init__(self, **node_options: Any) -> None:
        super().__init__("track_bridge", **node_options)
        options: BridgeNodeOptions = self.options[BridgeNodeOptions]
        self._options = options
        self._instance = uuid.uuid4()
        self._numbers = nmea.TargetNumbers()
        self._reported = -math.inf
        self._odometry: bytes | None = None
        self._reference: GeographicReference | None = None
        with refusing("origin"):
            if options.origin:
                self._reference = GeographicReference.read(options.origin)
        self._address = udp_address(options.nmea_address)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
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
            self._messages.append((self.create_publisher(kind, topic, DEPTH), make))
        if self._address:
            host, port = self._address
            self.get_logger().info(
                f"NMEA 0183 {self._options.nmea_sentences} to {host}, UDP port {port}"
            )

    def _subscribe(self) -> None:
        durability = DurabilityPolicy.TRANSIENT_LOCAL
        self._tracks = OfferedSubscription(
            self, PointCloud2, TRACKS, DEPTH, self._take, QosWatch(self), durability=durability
        )
        if self._options.own_ship_source == "odometry":
            # It may come much more often than tracks: only the newest before these is read.
            self.create_subscription(Odometry, OWN_SHIP, self._keep, NEWEST, raw=True)
        if not self._options.origin:
            self.create_subscription(NavSatFix, FIX, self._take_fix, NEWEST)
        # A node without a timer might never notice that the context was shut down by a signal.
        self.steady_timer(CHECK_PERIOD, lambda: None)

    def destroy_node(self) -> None:
        """Destroy the node and close its socket."""
        self._socket.close()
        super().destroy_node()

    def _keep(self, odometry: bytes) -> None:
        self._odometry = odometry

    def _take(self, cloud: PointCloud2) -> None:
        """Hand on the tracks that are held after a ping, if somebody takes them now."""
        wanted = [one for one in self._messages if one[0].get_subscription_count()]
        try:
            stamp = ns_to_seconds(time_to_ns(cloud.header.stamp))
            # A stamp that goes back is of another run.
            due = self._address and not (
                self._reported <= stamp < self._reported + self._options.nmea_period
            )
            if not due and not wanted:
                return
            tracks = track_arrays(read_track_cloud(cloud), stamp)
        except MessageError as error:
            self._drop("bad_tracks", f"{TRACKS} is not used: {error}")
            return
        usable = bounded(tracks)
        if not usable.all():
            sentence = "a track whose state is not finite is not handed on, nor one beyond"
            self._drop("bad_state", f"{sentence} {MAX_STATE:g} m", int((~usable).sum()))
            tracks = tracks.where(usable)
        for publisher, make in wanted:
            publisher.publish(make(cloud.header, tracks, self._instance))
        if due:
            self._reported = stamp
            self._report(exchanged(tracks, cloud.header.frame_id.lstrip("/")), stamp)

    def _report(self, tracks: TrackArrays, stamp: float) -> None:
        """Send sentences of tracks in east and north."""
        ended, without = self._numbers.update(tracks.track_id.tolist())
        if without:
            self._drop("numbers", f"tracks beyond {nmea.NUMBERS} are not sent", without)
        given, talker = self._options.nmea_sentences, self._options.nmea_talker
        kinds = ("TTM", "TLL") if given == "both" else (given,)
        for kind in kinds:
            self._send(nmea.lost(talker, ended, stamp, kind))
        if "TTM" in kinds and len(tracks):
            own_ship = self._own_ship(stamp)
            if own_ship is not None:
                numbers = self._numbers.of
                self._send(nmea.ttm(talker, tracks, numbers, own_ship, self._from_north))
        if "TLL" in kinds and len(tracks):
            if self._reference is None:
                sentence = f"no TLL: there is no usable position on {FIX}, and no origin"
                self._drop("no_position", sentence)
            else:
                places = self._reference.geographic(tracks.state[:, 0::2])
                self._send(nmea.tll(talker, tracks, self._numbers.of, places))

    def _send(self, sentences: Iterator[str]) -> None:
        address = self._address or ("", 0)
        for one in sentences:
            try:
                self._socket.sendto(one.encode("ascii"), address)
            except OSError as error:
                self._drop("not_sent", f"sentences cannot be sent to {address}: {error}")
                return

    def _own_ship(self, stamp: float) -> tuple[FloatArray, FloatArray] | None:
        """Position and velocity of own ship at a stamp; None, and said, where not known."""
        if self._options.own_ship_source == "none":
            return np.zeros(2), np.zeros(2)
        if self._odometry is None:
            self._drop(
                "no_own_ship",
                f"there is no message on {OWN_SHIP}; a fixed sonar needs own_ship_source:=none",
            )
            return None
        try:
            sample = read_own_ship(deserialize_message(self._odometry, Odometry))
            sample.check()
        except (ValueError, RuntimeError) as error:  # the last: no message
            self._drop("bad_own_ship", f"{OWN_SHIP} is not used: {error}")
            return None
        elapsed = stamp - sample.stamp
        if abs(elapsed) > self._options.own_ship_timeout:
            self._drop(
                "own_ship_stale",
                f"{OWN_SHIP} is {elapsed:.3g} s older than what it is needed for, more than "
                f"own_ship_timeout of {self._options.own_ship_timeout:g} s",
            )
            return None
        velocity = np.nan_to_num(np.array((sample.rates or (0.0, 0.0))[:2]))
        return np.array([sample.x, sample.y]) + elapsed * velocity, velocity

    def _take_fix(self, fix: NavSatFix) -> None:
        """Tie the fixed frame to the earth where own ship is now."""
        if fix.status.status < NavSatStatus.STATUS_FIX:
            self._drop("no_fix", f"{FIX} says that it has no position")
            return
        try:
            own_ship = self._own_ship(ns_to_seconds(time_to_ns(fix.header.stamp)))
            if own_ship is not None:
                east, north = own_ship[0].tolist()
                self._reference = GeographicReference(fix.latitude, fix.longitude, east, north)
        except ValueError as error:
            self._drop("bad_fix", f"{FIX} is not used: {error}")


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(TrackBridge, args, help_text("track_bridge", __doc__))
