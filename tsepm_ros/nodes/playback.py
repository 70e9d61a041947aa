"""Publishing events at their times: what the simulator and the player share."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage

from msg_adapters import ns_to_time, seconds_to_ns
from tsepm_ros.nodes.node_parameters import ParameterError
from tsepm_ros.settings.node_options import PlaybackOptions

Event = tuple[float, Callable[[], None]]
"""Time in the recording (s) and what publishes then."""

WAIT_PERIOD = 0.05
"""Time between looks at the subscribers, s."""
LOG_PERIOD = 5.0
"""Least time between log entries that say how far the playback is, s."""
PUBLISHER_DEPTH = 1000
"""Messages that a publisher keeps for subscribers that have not acknowledged them yet."""
ACKNOWLEDGE_EVERY = 500
"""Events after which all must be acknowledged. Less than the depth, so nothing unacknowledged is
overwritten; not fewer, since the middleware may take its heartbeat of 3 s to acknowledge."""
ACKNOWLEDGE_TIME = 10.0
"""Time that a reliable subscriber is given to acknowledge, s; after that it is taken for dead."""
ACKNOWLEDGE_STEP = 0.2
"""Longest single wait in that time, s."""


class Played(Protocol):
    """What is played: a scenario, a recording or a bag."""

    @property
    def detections(self) -> Publisher:
        """Publisher whose subscribers are waited for."""

    @property
    def publishers(self) -> Sequence[Publisher]:
        """Those whose messages must arrive, made with at least PUBLISHER_DEPTH."""

    def events(self) -> Iterator[Event]:
        """Iterate over the events in order of time; anew for every loop."""


def check_start_offset(start_offset: float, duration: float, played: str) -> None:
    """Refuse a start beyond the end of what is played, s.

    Raises
    ------
    ParameterError
        If it is.
    """
    if start_offset > duration:
        raise ParameterError(
            f"start_offset: {start_offset:g} s is beyond the end of the {played} of {duration:g} s"
        )


class Playback:
    """Publishes a sequence of events, paced by the wall clock.

    It does not outrun a reliable subscriber: no message is overwritten before it is acknowledged,
    and the last ones are acknowledged before the end. Before the first event it settles: a
    publisher knows of a subscription before the subscription knows of it; what is published in
    between is lost, reliable or not.

    Parameters
    ----------
    node : rclpy.node.Node
    played : Played
    options : PlaybackOptions

    Attributes
    ----------
    finished : Future
        Done when the last event has been published and taken.
    """

    def __init__(self, node: Node, played: Played, options: PlaybackOptions) -> None:
        self.finished: Future = Future()
        self._node = node
        self._played = played
        self._options = options
        self._clock: Any = None
        if options.publish_clock:
            self._clock = node.create_publisher(ClockMessage, "/clock", 10)
        self._events = played.events()
        self._next = next(self._events, None)
        self._begin: float | None = None
        self._published = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(WAIT_PERIOD, self._step, clock=steady)
        if options.wait_for_subscribers:
            node.get_logger().info(
                f"waiting for {options.wait_for_subscribers} subscriber(s) of "
                f"{played.detections.topic_name}"
            )

    def _step(self) -> None:
        if self._begin is None:
            wanted = self._options.wait_for_subscribers
            if self._played.detections.get_subscription_count() < wanted:
                return
            settling = self._options.settling_time if wanted else 0.0
            self._begin = time.monotonic() + settling - self._wall_time()
        while self._next is not None:
            wait = self._begin + self._wall_time() - time.monotonic()
            if wait > 0:
                self._schedule(wait)
                return
            self._publish()
        self._end()

    def _wall_time(self) -> float:
        """When the next event is due, s of wall time, counted as the events' times are."""
        return self._next[0] / self._options.rate_factor if self._next is not None else 0.0

    def _publish(self) -> None:
        assert self._next is not None
        stamp, publish = self._next
        if self._clock is not None:
            self._clock.publish(ClockMessage(clock=ns_to_time(seconds_to_ns(stamp))))
        publish()
        self._published += 1
        if self._published % ACKNOWLEDGE_EVERY == 0:
            self._wait_for_acknowledgement()
        self._next = next(self._events, None)

    def _wait_for_acknowledgement(self) -> None:
        for publisher in self._played.publishers:
            until = time.monotonic() + ACKNOWLEDGE_TIME
            while (
                publisher.get_subscription_count()
                and time.monotonic() < until
                and self._node.context.ok()  # the wait itself hears no signal
                and not publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_STEP))
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
