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
"""Mutated messages in process: every type, every method, with and without an own ship.

Between good pings with two targets come mutated detections, odometry, reports of a tracker and
charts. In every other case these are only messages that are refused; then the good pings must give
the tracks of the stream alone, to the bit.
"""

import copy
import functools
import math
import resource
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import campaign
import numpy as np
from campaign import Tried
from invariants import TrackBook, check_reasons, lost_scans, require, same_tracks
from mutation import mutate
from streams import KINDS, GoodPing, Stream, good_stream

from msg_adapters import MessageError, read_detections, read_land, read_own_ship, tracker_report
from msg_adapters.message_input import MessageInput
from tsepm_ros import available_methods
from tsepm_ros.session.session import ScanResult, Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions, SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.options import CommonOptions

METHODS = available_methods()
SOURCES = ("none", "odometry")
PER_PING = 80
"""Most mutated messages between two pings."""
MAX_MEMORY = 1500.0
"""Resident memory of the process that is too much, MB."""


@dataclass
class Fed:
    """A session that is fed with messages, and what it has answered."""

    settings: Settings
    node: InitiatorNodeOptions = field(default_factory=InitiatorNodeOptions)
    results: list[ScanResult] = field(default_factory=list)
    sent: int = 0

    def __post_init__(self) -> None:
        self.session = Session(self.settings)
        self.input = MessageInput(self.session, self.node)
        self.book = TrackBook(self.settings.common.max_speed, speed_limit(self.settings))
        self.now = 0.0

    def feed(self, kind: str, message: Any) -> list[ScanResult]:
        """Give a message, and process what is ready; check the answer and the counts."""
        self.now += 0.01
        getattr(self.input, f"take_{kind}")(message, *([self.now] if kind == "detections" else []))
        self.sent += kind == "detections"
        return self._take(self.session.process(self.now))

    def feed_ping(self, ping: GoodPing) -> None:
        for pose in ping.poses if self.settings.session.own_ship_source != "none" else ():
            self.feed("own_ship", pose)
        self.feed("detections", ping.detections)

    def finish(self) -> list[ScanResult]:
        """Process what waits."""
        return self._take(self.session.process(last=True))

    def _take(self, results: Iterator[ScanResult]) -> list[ScanResult]:
        new = list(results)
        for result in new:
            self.book.check(result)
        self.results += new
        return new

    def check_counts(self) -> None:
        """Every message of detections is a result, a counted drop, or waits."""
        dropped = self.session.dropped
        check_reasons(dropped)
        lost = lost_scans(dropped)
        counted = len(self.results) + lost + self.session.figures().waiting
        require(
            counted == self.sent,
            f"{self.sent} messages: {len(self.results)} results, {lost} drops, "
            f"{self.session.figures().waiting} waiting; {dict(dropped)}",
        )


def speed_limit(settings: Settings) -> float:
    """The greatest speed of a start, m/s: without bound where `limit_speed` is off."""
    common = settings.make_tracker().common
    return common.max_speed if common.limit_speed == "on" else math.inf


def settings_of(method: str, source: str, **common: Any) -> Settings:
    return Settings(
        session=SessionOptions(method=method, own_ship_source=source, own_ship_max_gap=60.0),
        common=CommonOptions(max_speed=10.0, **common),
    )


@functools.cache
def clean_results(
    method: str, source: str, kind: str, density: str, min_speed: float
) -> list[ScanResult]:
    """Results of the good stream alone."""
    fed = Fed(settings_of(method, source, clutter_density=density, min_speed=min_speed))
    stream = good_stream(kind)
    for ping in stream.pings:
        fed.feed_ping(ping)
    fed.finish()
    fed.check_counts()
    require(len(fed.results) == len(stream.pings), "the good stream is not processed whole")
    return fed.results


READERS = {
    "detections": functools.partial(read_detections, sound_speed=0.0),
    "own_ship": read_own_ship,
    "tracked": tracker_report,
    "land": read_land,
}


def is_refused(kind: str, message: Any) -> bool:
    """Whether a message is refused whole when it is read."""
    try:
        READERS[kind](message)
    except MessageError:
        return True
    return False


def chosen(stream: Stream, index: int, source: str, rng: np.random.Generator) -> tuple[str, Any]:
    """A message to mutate, near in time to a ping."""
    ping = stream.pings[index]
    kind = str(rng.choice(["detections", "own_ship", "tracked", "land"], p=[0.7, 0.15, 0.1, 0.05]))
    if kind == "detections":
        return kind, stream.between(index, rng)
    if kind == "own_ship":
        if source == "none":  # the node does not subscribe to it
            return "detections", stream.between(index, rng)
        return kind, ping.poses[rng.integers(len(ping.poses))]
    return kind, stream.tracked(index) if kind == "tracked" else stream.land


def case(number: int, rng: np.random.Generator) -> Tried:
    """A stream with mutated messages between its pings."""
    method = METHODS[number % len(METHODS)]
    kind = KINDS[number // len(METHODS) % len(KINDS)]
    refused_only = number % 4 < 2
    source = SOURCES[int(rng.integers(2))]
    density = str(rng.choice(["given", "given", "given", "estimated"]))
    min_speed = float(rng.choice([0.0, 0.0, 1.0]))
    stream = good_stream(kind)
    expected = clean_results(method, source, kind, density, min_speed)
    fed = Fed(settings_of(method, source, clutter_density=density, min_speed=min_speed))
    tried: Tried = Counter()
    accepted = 0
    for index, ping in enumerate(stream.pings):
        message = None
        for _ in range(int(rng.integers(PER_PING + 1))):
            if message is None or rng.random() < 0.5:
                what, message = chosen(stream, index, source, rng)
                message = copy.deepcopy(message)
            mutate(message, rng)  # every second time on top of the change before
            refused = is_refused(what, message)
            if refused_only and not refused:
                continue
            accepted += not refused
            fed.feed(what, message)
            fed.check_counts()
            tried[f"mutated {what}"] += 1
            tried[f"method {method}"] += 1
            tried[f"type {kind}"] += what == "detections"
            tried["messages"] += 1
        fed.feed_ping(ping)
        fed.check_counts()
    fed.finish()
    fed.check_counts()
    if refused_only or not accepted:
        _check_same(fed.results, expected)
        tried["good pings after refused messages"] += len(expected)
    tried["drops"] += sum(fed.session.dropped.values())
    tried["results"] += len(fed.results)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    require(memory < MAX_MEMORY, f"{memory:.0f} MB of memory")
    return tried


def _check_same(found: list[ScanResult], expected: list[ScanResult]) -> None:
    """The good stream gives what it gives alone."""
    require(len(found) == len(expected), f"{len(found)} results in place of {len(expected)}")
    for index, (one, other) in enumerate(zip(found, expected, strict=True)):
        require(
            same_tracks(one.new, other.new) and same_tracks(one.current, other.current),
            f"the tracks of ping {index} are not those of the stream alone",
        )


if __name__ == "__main__":
    sys.exit(campaign.main("messages", __doc__, case))
