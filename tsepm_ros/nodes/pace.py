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
"""How fast messages come, how long they waited, and which of them are passed over."""

from __future__ import annotations

import math
import statistics
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

MAX_BACKLOG = 2.0
"""Time in the queue from which on the newest message is taken, s."""
BACKLOG_INTERVALS = 5.0
"""The same in scan intervals: a burst of a slow sonar is processed whole."""
LAST_IMAGES = 9
"""Images of which the interval and the time are the medians."""
LONGEST = 600.0
"""Time in the queue above which the clocks of publisher and subscriber differ, s."""


def pace_seconds_in_queue(information: Any) -> float:
    """Time that a message waited in the middleware, s, by the information that came with it.

    From its arrival here, where the middleware notes that, else from its publication. 0 where
    neither is known, or where the clocks of the two computers differ.

    Parameters
    ----------
    information : mapping or rmw_message_info_t
        `received_timestamp` and `source_timestamp`, ns of the system clock.
    """
    stamp = information["received_timestamp"] or information["source_timestamp"]
    if stamp <= 0:
        return 0.0
    waited = 1e-9 * (time.time_ns() - stamp)
    return waited if 0.0 <= waited <= LONGEST else 0.0


def newest_at_pace(
    message: Any,
    information: Any,
    interval: float,
    take_waiting: Callable[[], list[tuple[Any, Any]]],
    is_behind: bool = False,
) -> tuple[Any, Any, list[Any]]:
    """The message to be processed: the newest, where the oldest waited too long in the queue.

    Parameters
    ----------
    message, information
        The oldest in the queue.
    interval : float
        Between scans, s; 0 while it is unknown.
    take_waiting : callable
        Takes all others from the queue, oldest first.
    is_behind : bool, optional
        Whether messages come faster than they are processed: then the newest in any case.

    Returns
    -------
    message, information
    skipped : list
        Older messages that are not processed, oldest first.
    """
    waited = pace_seconds_in_queue(information)
    is_late = interval and waited > max(MAX_BACKLOG, BACKLOG_INTERVALS * interval)
    heard = [(message, information)]
    if is_late or is_behind:
        heard += take_waiting()
    *skipped, (message, information) = heard
    return message, information, [older for older, _ in skipped]


class Pace:
    """How fast images come, and how fast they are processed.

    Attributes
    ----------
    interval, time : float
        Medians of the last `LAST_IMAGES`: between stamps, and that an image takes, s; 0: unknown.
    arrived : float
        When the message in work arrived, s of the monotonic clock.
    age : float
        Of the last image, from its arrival to the end of publishing, s.
    lost : int
        Images that did not arrive, and that the node was not too slow for.
    """

    def __init__(self) -> None:
        self._stamps = deque[float](maxlen=LAST_IMAGES)
        self._times = deque[float](maxlen=LAST_IMAGES)
        self._free = self.arrived = time.monotonic()
        self._number, self.lost = None, 0  # type: int | None, int
        self.age = self.interval = self.time = 0.0

    @property
    def is_behind(self) -> bool:
        """Whether images come faster than they are processed."""
        return 0.0 < self.interval < self.time

    def is_late(self, now: float) -> bool:
        """Whether images are behind, or wait long, at a time of the monotonic clock, s."""
        goes_on = now - self._free <= max(2.0 * self.interval, 2.0 * self.time, MAX_BACKLOG)
        return goes_on and (self.is_behind or (not self.interval and self.age > MAX_BACKLOG))

    def came(self, stamps: Sequence[float], number: int | None = None) -> int:
        """Note images by their stamps, s, all but the last passed over; the number of these.

        It includes those that the middleware has overwritten while the image before was processed:
        by the publisher's `number` of the last, else by the stamps.
        """
        last, passed = (self._stamps or stamps)[-1], len(stamps) - 1
        self._stamps.extend(stamps)
        self.interval = statistics.median(
            [b - a for a, b in zip(self._stamps, [*self._stamps][1:], strict=False) if b > a]
            or [0.0]
        )
        interval, busy = self.interval or math.inf, (self._times or [0.0])[-1]
        missing, before = round((stamps[0] - last) / interval) - 1 if passed else 0, self._number
        self._number = number
        if number is not None and before is not None and number > before and stamps[-1] > last:
            missing = number - before - len(stamps)
            interval = min(interval, (stamps[-1] - last) / (number - before))
            self.lost += max(missing - math.ceil(busy / interval), 0)
        return passed + max(min(missing, math.ceil(busy / interval)), 0)

    def done(self) -> None:
        """Note the end of an image: it took what has passed since its arrival, or the last end."""
        now = time.monotonic()
        self._times.append(now - max(self._free, self.arrived))
        self._free, self.age, self.time = now, now - self.arrived, statistics.median(self._times)
