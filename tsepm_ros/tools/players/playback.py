"""Simulator and player: events at their times, on the topics of a driver and of the truth."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from msg_adapters import (
    make_header,
    ns_to_time,
    odometry_message,
    seconds_to_ns,
    track_cloud,
    truth_markers,
    truth_tracks,
)
from tsepm_ros.nodes.base_node import OVERRIDABLE, ParameterError, ParameterisedNode
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.settings.node_options import PlaybackOptions

Event = tuple[float, Callable[[], None]]
"""Time in the recording (s) and the function that publishes the message."""

WAIT_PERIOD = 0.05
"""Time between checks for subscribers, s."""
LOG_PERIOD = 5.0
"""Minimum time between log entries of the playback's progress, s."""
PUBLISHER_DEPTH = 1000
"""Queue depth of a publisher: messages kept until they are acknowledged."""
EVENTS_PER_ACKNOWLEDGEMENT = 500
"""Events after which all messages must be acknowledged. It is below the depth, so that no
unacknowledged message is overwritten; an acknowledgement may take the heartbeat period of 3 s."""
MAX_ACKNOWLEDGE_TIME = 10.0
"""Maximum time for the acknowledgement, s; later a reliable subscriber is considered dead."""
MAX_SINGLE_WAIT = 0.2
"""Maximum time of a single wait for the acknowledgement, s."""


class Played:
    """Source of the events: a scenario, a recording or a bag.

    Attributes
    ----------
    detections : Publisher
        The playback waits for its subscribers.
    publishers : list of Publisher
        Publishers whose messages must be acknowledged, of depth PUBLISHER_DEPTH or more.
    """

    detections: Publisher
    publishers: list[Publisher]

    def events(self) -> Iterator[Event]:
        """Iterate over the events in order of time, from the first; once per loop."""
        raise NotImplementedError

    def close(self) -> None:
        """Close what is open."""


class PlayingNode(ParameterisedNode):
    """A node that plays what `make` makes of it and its options.

    Attributes
    ----------
    finished : Future
        Done when the last event has been published and acknowledged.
    """

    def __init__(
        self,
        name: str,
        make: Callable[[ParameterisedNode, Mapping[type, Any]], Played],
        **node_options: Any,
    ) -> None:
        super().__init__(name, **node_options)
        self._played = make(self, self.options)
        self.finished = Playback(self, self._played, self.options[PlaybackOptions]).finished
        self.refuse_unused_overrides()

    def destroy_node(self) -> None:
        """Destroy the node and close what it plays."""
        super().destroy_node()
        self._played.close()


def check_start_offset(start_offset: float, duration: float, played: str) -> None:
    """Refuse a start offset beyond the duration, both s.

    Raises
    ------
    ParameterError
        If the start offset is beyond the duration.
    """
    if start_offset > duration:
        raise ParameterError(
            f"start_offset: {start_offset:g} s is beyond the end of the {played} of {duration:g} s"
        )


class Playback:
    """Publishes a sequence of events, paced by the wall clock.

    The playback waits for reliable subscribers: no message is overwritten before it is
    acknowledged, and all are acknowledged before the end. It waits for `settling_time` before the
    first event: discovery has two sides, and a message that is published after the publisher has
    discovered a subscription but before the opposite discovery is lost, even if reliable.

    Parameters
    ----------
    node : rclpy.node.Node
    played : Played
    options : PlaybackOptions

    Attributes
    ----------
    finished : Future
        Done when the last event has been published and acknowledged.
    """

    def __init__(self, node: Node, played: Played, options: PlaybackOptions) -> None:
        self.finished: Future = Future()
        self._node = node
        self._played = played
        self._options = options
        self._clock: Any = None
        if options.publish_clock:
            self._clock = node.create_publisher(
                ClockMessage, "/clock", 10, qos_overriding_options=OVERRIDABLE
            )
        self._events = played.events()
        self._next = next(self._events, None)
        self._begin: float | None = None
        self._published = 0
        self._timer = node.create_timer(
            WAIT_PERIOD, self._step, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        if options.wait_for_subscribers:
            node.get_logger().info(
                f"waiting for {options.wait_for_subscribers} subscriber(s) of "
                f"{played.detections.topic_name}"
            )

    def _step(self) -> None:
        if self._begin is None:
            awaited = self._options.wait_for_subscribers
            if self._played.detections.get_subscription_count() < awaited:
                return
            settling = self._options.settling_time if awaited else 0.0
            self._begin = time.monotonic() + settling - self._wall_time()
        while self._next is not None:
            wait = self._begin + self._wall_time() - time.monotonic()
            if wait > 0:
                self._schedule(wait)
                return
            self._publish()
        self._end()

    def _wall_time(self) -> float:
        """Wall time at which the next event is due, s, from the origin of the events' times."""
        return self._next[0] / self._options.rate_factor if self._next is not None else 0.0

    def _publish(self) -> None:
        assert self._next is not None
        stamp, publish = self._next
        if self._clock is not None:
            self._clock.publish(ClockMessage(clock=ns_to_time(seconds_to_ns(stamp))))
        publish()
        self._published += 1
        if self._published % EVENTS_PER_ACKNOWLEDGEMENT == 0:
            self._wait_for_acknowledgement()
        self._next = next(self._events, None)

    def _wait_for_acknowledgement(self) -> None:
        for publisher in self._played.publishers:
            until = time.monotonic() + MAX_ACKNOWLEDGE_TIME
            while (
                publisher.get_subscription_count()
                and time.monotonic() < until
                and self._node.context.ok()  # a signal does not interrupt the wait
                and not publisher.wait_for_all_acked(Duration(seconds=MAX_SINGLE_WAIT))
            ):
                pass

    def _schedule(self, wait: float) -> None:
        self._timer.timer_period_ns = max(math.ceil(wait * 1e9), 1)
        self._timer.reset()

    def _end(self) -> None:
        if self._options.loop:
            self._events = self._played.events()
            self._next = next(self._events, None)
            self._begin = time.monotonic() - self._wall_time()
            self._schedule(WAIT_PERIOD)
            return
        self._node.destroy_timer(self._timer)
        self._wait_for_acknowledgement()
        self._node.get_logger().info("finished")
        self.finished.set_result(None)


class DriverTopics:
    """Publishers of detections, own ship and truth.

    Parameters
    ----------
    node : rclpy.node.Node
    detections_type : type
        Message class of the detections.
    fixed_frame, sensor_frame : str
        Frame of own ship and truth; frame of the detections.
    own_ship : bool, optional
        Whether there is an own ship; without it there is no topic that a node might wait for.

    Attributes
    ----------
    detections : Publisher
    publishers : list of Publisher
        Publishers whose messages must be acknowledged.
    """

    def __init__(
        self,
        node: Node,
        detections_type: type,
        fixed_frame: str,
        sensor_frame: str,
        own_ship: bool = True,
    ) -> None:
        self._frames = fixed_frame, sensor_frame
        self._place, self._reach = np.zeros(2), 0.0  # of the own ship; largest range of a target
        publisher = partial(node.create_publisher, qos_overriding_options=OVERRIDABLE)
        self.detections = publisher(detections_type, "detections", PUBLISHER_DEPTH)
        self._truth = publisher(PointCloud2, "ground_truth", PUBLISHER_DEPTH)
        self._truth_markers = publisher(MarkerArray, "ground_truth/markers", 10)
        self.publishers = [self.detections, self._truth]
        self._own_ship: Publisher = None
        if own_ship:
            self._own_ship = publisher(Odometry, "own_ship/odometry", PUBLISHER_DEPTH)
            self.publishers.append(self._own_ship)

    def sensor_header(self, stamp: float) -> Header:
        """Header of detections with a stamp, s."""
        return make_header(seconds_to_ns(stamp), self._frames[1])

    def publish_own_ship(
        self,
        stamp: float,
        pose: tuple[float, float, float | None],
        rates: tuple[float, float, float],
        roll: float = 0.0,
        pitch: float = 0.0,
    ) -> None:
        """Publish the own ship.

        Parameters
        ----------
        stamp : float
            s.
        pose : tuple of float
            x, y and yaw in the fixed frame, m and rad; None for an unknown yaw.
        rates : tuple of float
            vx, vy (fixed frame, m/s) and yaw rate (rad/s).
        roll, pitch : float, optional
            rad.

        Raises
        ------
        ValueError
            If there is no own ship.
        """
        if self._own_ship is None:
            raise ValueError("there is no own ship")
        x, y, yaw = pose
        self._place = np.array([x, y])
        frame_id, child_frame_id = self._frames
        sample = PoseSample(
            stamp,
            x,
            y,
            yaw or 0.0,
            rates=rates,
            roll=roll,
            pitch=pitch,
            frame_id=frame_id,
            child_frame_id=child_frame_id,
        )
        self._own_ship.publish(odometry_message(sample, heading_known=yaw is not None))

    def publish_truth(self, stamp: float, states: NDArray[np.float64]) -> None:
        """Publish the targets' true states (k, 4) at a stamp, s."""
        header = make_header(seconds_to_ns(stamp), self._frames[0])
        truth = truth_tracks(stamp, states)
        self._truth.publish(track_cloud(header, truth))
        ranges = np.hypot(*(np.reshape(states, (-1, 4))[:, 0::2] - self._place).T)
        self._reach = max(self._reach, float(ranges.max(initial=0.0)))
        self._truth_markers.publish(truth_markers(header, truth, self._reach))
