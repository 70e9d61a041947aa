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
"""Stamps as time messages, nanoseconds and seconds; and health as diagnostic_msgs."""

import math

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import (
    MessageError,
    diagnostics,
    ns_to_seconds,
    ns_to_time,
    seconds_to_ns,
    time_to_ns,
)
from tsepm_ros.diagnostics.health_figures import Level, Status


@pytest.mark.parametrize(
    ("nanoseconds", "sec", "nanosec"),
    [
        pytest.param(0, 0, 0, id="zero"),
        pytest.param(1_700_000_000_123_456_789, 1_700_000_000, 123_456_789, id="date"),
        pytest.param(999_999_999, 0, 999_999_999, id="below one second"),
        pytest.param(-1, -1, 999_999_999, id="before the epoch"),
        pytest.param((2**31 - 1) * 10**9, 2**31 - 1, 0, id="largest second"),
    ],
)
def test_nanoseconds_and_time_message_are_each_other_s_inverse(nanoseconds, sec, nanosec):
    message = ns_to_time(nanoseconds)
    assert (message.sec, message.nanosec) == (sec, nanosec)
    assert time_to_ns(Time(sec=sec, nanosec=nanosec)) == nanoseconds


@pytest.mark.parametrize("seconds", [2**31, -(2**31) - 1], ids=["above", "below"])
def test_time_message_refuses_what_its_seconds_cannot_hold(seconds):
    with pytest.raises(ValueError, match="stamp must be within 32-bit seconds"):
        ns_to_time(seconds * 10**9)


@pytest.mark.parametrize(
    ("seconds", "nanoseconds"),
    [
        pytest.param(0.1, 100_000_000, id="tenth"),
        pytest.param(-0.5, -500_000_000, id="negative"),
        # Exactly representable: one rounding of the product with 1e9 would be off by up to 128 ns.
        pytest.param(1_700_000_000 + 2**-22, 1_700_000_000_000_000_238, id="date"),
    ],
)
def test_seconds_to_nanoseconds_rounds_once(seconds, nanoseconds):
    assert seconds_to_ns(seconds) == nanoseconds


def test_seconds_of_nanoseconds_are_the_nearest_float():
    assert ns_to_seconds(1_700_000_000_123_456_789) == 1_700_000_000.123456789
    assert ns_to_seconds(100_000_000) == 0.1


@pytest.mark.parametrize("seconds", [math.nan, math.inf])
def test_seconds_that_are_not_finite_are_refused(seconds):
    with pytest.raises(ValueError, match="stamp must be finite"):
        seconds_to_ns(seconds)


@pytest.mark.parametrize("nanosec", [10**9, 2**32 - 1])
def test_a_stamp_of_a_second_of_nanoseconds_is_refused(nanosec):
    with pytest.raises(MessageError, match=f"nanosec of a stamp must be below 1e9; got {nanosec}"):
        time_to_ns(Time(sec=5, nanosec=nanosec))
    assert time_to_ns(Time(sec=5, nanosec=10**9 - 1)) == 6 * 10**9 - 1


def test_health_is_a_message_of_its_levels_in_order_with_floats_of_six_digits(over_the_wire):
    values = {"b": 1 / 3, "a": 7, "c": "text", "d": float("nan")}
    statuses = [Status(level.name, level, "said", values) for level in Level]
    message = over_the_wire(diagnostics(1_700_000_000_123_456_789, "node", statuses))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert [(one.name, one.level, one.message) for one in message.status] == [
        (f"node: {level.name}", getattr(DiagnosticStatus, level.name), "said") for level in Level
    ]
    found = [(value.key, value.value) for value in message.status[0].values]
    assert found == [("b", "0.333333"), ("a", "7"), ("c", "text"), ("d", "nan")]
