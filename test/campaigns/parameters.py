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
"""Every parameter of the track initiator at and beyond the ends of its range, in every method.

A value is refused with a sentence that names its parameter, or a stream of good pings is processed
with it: from the start, and as a change in the middle and back. After single values come random
pairs. Every eighth case calls the services of a node with values of every type: each is answered.
"""

import functools
import math
import resource
import sys
from collections import Counter

import campaign
import numpy as np
from campaign import Finding, Tried
from invariants import check_reasons, require
from messages import Fed, speed_limit
from streams import good_stream
from support.parameter_values import NODES, Caller, make
from support.ros_domains import own_domain
from support.ros_world import World

from tsepm_ros import available_methods
from tsepm_ros.parameters import Parameter, Value
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.settings import (
    TRACK_INITIATOR,
    Settings,
    make_groups,
    settings_from,
    settings_table,
    settings_with_method,
)

METHODS = available_methods()
KIND = "sensor_msgs/msg/PointCloud2"
MEMORY = 6 * 2**30
"""Address space of the process, bytes: more is an allocation without bound."""
NUMBERS = (0.0, 1e-300, 1e-12, 1e-9, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e12, 1e154, 1e300, 1.7e308)
SPECIAL = (math.nan, math.inf, -math.inf, -1.0, -1e300)
INTEGERS = (0, 1, 2, 3, 15, 16, 17, 1000, 10**6, 2**31 - 1, 2**31, 2**63 - 1, -1, -(2**63))
WRONG: tuple[Value, ...] = ("", "nan", "1e-06", "x" * 300, True, 0)
USUAL = {"own_ship_source": "odometry", "own_ship_max_gap": 60.0}
CALLS = 200
"""Calls of the services of a node in a case."""
SLOW = ("learned_file",)
"""Not of a session."""


@functools.cache
def rows() -> dict[str, Parameter]:
    """The table of the node, with the parameters of every method."""
    every = functools.reduce(settings_with_method, METHODS, TRACK_INITIATOR)
    return {row.name: row for row in settings_table(every) if row.name not in SLOW}


def values_of(row: Parameter) -> list[Value]:
    """Values to try: the ends of the range, values beside them, and what is no value."""
    if row.choices:
        return [*row.choices, "nonsense", *WRONG[:2]]
    if row.type is bool:
        return [True, False, "", 1]
    if row.type is str:
        return ["", "odom", "map", "/", "x" * 300, "\n", 1]
    ends = [x for x in (row.minimum, row.maximum) if math.isfinite(x)]
    if row.type is int:
        beside = {int(end) + step for end in ends for step in (-1, 0, 1)}
        return [*sorted(beside), *INTEGERS, 1.5, ""]
    beside = [float(np.nextafter(x, to)) for x in ends for to in (-math.inf, math.inf)]
    return [*ends, *beside, *NUMBERS, *SPECIAL, "", True]


@functools.cache
def single(seed_key: int) -> list[tuple[str, str, Value]]:
    """All methods, parameters and values in the order of a seed; foreign groups only once."""
    listed = []
    for method in METHODS:
        for name, row in rows().items():
            group = name.partition(".")[0]
            if group in METHODS and group != method:
                continue
            listed += [(method, name, value) for value in values_of(row)]
    order = np.random.default_rng(seed_key).permutation(len(listed))
    return [listed[index] for index in order]


def case(number: int, rng: np.random.Generator) -> Tried:
    """A value, or a pair of them, or calls of a node."""
    if number % 8 == 7:
        return _called(rng)
    number -= number // 8
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    listed = single(1)
    if number < len(listed):
        method, name, value = listed[number]
        return _tried(method, {name: value})
    method, name, value = listed[rng.integers(len(listed))]
    _, other, more = next(
        triple
        for triple in (listed[i] for i in rng.integers(0, len(listed), 10_000).tolist())
        if triple[0] == method and triple[1] != name
    )
    return _tried(method, {name: value, other: more})


def _called(rng: np.random.Generator) -> Tried:
    """Random calls of the services of a node."""
    tried: Tried = Counter()
    kind = NODES[rng.choice(len(NODES), p=(0.7, 0.1, 0.1, 0.1))]
    with own_domain() as domain, World(domain) as world:
        caller = Caller(world, make(world, kind))
        for _ in range(CALLS):
            tried += caller.call(rng)
    return tried


def _tried(method: str, values: dict[str, Value]) -> Tried:
    given = {**USUAL, "method": method, **values}
    where = f"{method}, {values}"
    try:
        groups = make_groups(TRACK_INITIATOR, given)
        settings = settings_from(groups)
        settings.make_tracker()
    except ValueError as error:
        named = any(name.rpartition(".")[2] in str(error) for name in given)
        require(named, f"{where}: the refusal names no parameter: {error}")
        require("\n" not in str(error) and len(str(error)) < 600, f"{where}: {error}")
        return Counter({"values": 1, "refused": 1})
    try:
        fed = Fed(settings, node=groups[InitiatorNodeOptions])
        _process(fed, {})
        if settings.session.sweep == "off":
            fed.check_counts()
        if not any(rows()[name].read_only for name in values):  # a change, and back
            before = settings_from(make_groups(TRACK_INITIATOR, {**USUAL, "method": method}))
            fed = Fed(before)
            fed.book.max_speed = max(before.common.max_speed, settings.common.max_speed)
            fed.book.most_of_starts = max(speed_limit(before), speed_limit(settings))
            _process(fed, {5: settings, 9: before})
    except Finding as error:
        raise Finding(f"{where}: {error}") from error
    return Counter({"values": 1, "accepted": 1, f"accepted by {settings.session.method}": 1})


def _process(fed: Fed, changes: dict[int, Settings]) -> None:
    """The good stream, with other settings from some of its pings on."""
    for index, ping in enumerate(good_stream(KIND).pings):
        if index in changes:
            fed.session.validate(changes[index])
            fed.session.configure(changes[index])
        fed.feed_ping(ping)
        check_reasons(fed.session.dropped)
    fed.finish()
    check_reasons(fed.session.dropped)


if __name__ == "__main__":
    sys.exit(campaign.main("parameters", __doc__, case))
