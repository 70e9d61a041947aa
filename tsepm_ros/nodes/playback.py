"""Publishing events at their times: what the simulator and the player share."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage

from msg_adapters import ns_to_time, seconds_to_ns

Event = tuple[float, Callable[[], None]]
"""Time in the recording (s) and what publishes then."""

WAIT_PERIOD = 0.05
PUBLISHER_DEPTH = 1000
"""Messages that a publisher keeps for subscribers that have not acknowledged them yet."""
ACKNOWLEDGE_EVERY = 500
"""Events after which all must be acknowledged. Less than the depth, so nothing unacknowledged is
overwritten; not fewer, since the middleware may take its heartbeat of 3 s to acknowledge."""
ACKNOWLEDGE_TIME = 10.0
"""Time that a reliable subscriber is given to acknowledge, s; after that it is taken for dead."""


ACKNOWLEDGE_STEP = 0.2


class Playback:
    """Publishes a sequence of events, paced by the wall clock.

    It does not outrun a reliable subscriber: no message is overwritten before it is acknowledged,
    and the last ones are acknowledged before the end.

    Parameters
    ----------
    node : rclpy.node.Node
    events : callable
        Gives the events, in order of time, anew for every loop.
    publishers : sequence of Publisher
        Those whose messages must arrive, made with at least PUBLISHER_DEPTH.
    wait_for : Publisher
        Begin when this one has `wait_for_subscribers` subscribers.
    wait_for_subscribers : int
        0: begin at once.
    settling_time : float
        Time between that and the first event, s. A publisher knows of a subscription before the
        subscription knows of it; what is published in between is lost, reliable or not.
    rate_factor : float
        How much faster than real time.
    publish_clock : bool
        Publish the events' times on /clock.
    loop : bool
        Begin again at the end.

    Attributes
    ----------
    finished : Future
        Done when the last event has been published and taken.
    """

    def __init__(
        self,
        node: Node,
        events: Callable[[], Iterator[Event]],
        publishers: Sequence[Publisher],
        *,
        wait_for: Publisher,
        wait_for_subscribers: int,
        settling_time: float,
        rate_factor: float,
        publish_clock: bool,
        loop: bool,
    ) -> None:
        self.finished: Future = Future()
        self._node = node
        self._make_events = events
        self._publishers = publishers
        self._wait_for = wait_for
        self._wait_for_subscribers = wait_for_subscribers
        self._settling_time = settling_time
        self._rate_factor = rate_factor
        self._loop = loop
        self._clock: Any = None
        if publish_clock:
            self._clock = node.create_publisher(ClockMessage, "/clock", 10)
        self._events = events()
        self._next = next(self._events, None)
        self._begin: float | None = None
        self._published = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(WAIT_PERIOD, self._step, clock=steady)
        if wait_for_subscribers:
            node.get_logger().info(
                f"waiting for {wait_for_subscribers} subscriber(s) of {wait_for.topic_name}"
            )

    def _step(self) -> None:
        if self._begin is None:
            if self._wait_for.get_subscription_count() < self._wait_for_subscribers:
                return
            settling = self._settling_time if self._wait_for_subscribers else 0.0
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
        return self._next[0] / self._rate_factor if self._next is not None else 0.0

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
        for publisher in self._publishers:
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
        if self._loop:
            self._events = self._make_events()
            self._next = next(self._events, None)
            self._begin = time.monotonic() - self._wall_time()
            self._schedule(WAIT_PERIOD)
            return
        self._node.destroy_timer(self._timer)
        self._wait_for_acknowledgement()
        self._node.get_logger().info("finished")
        self.finished.set_result(None)
