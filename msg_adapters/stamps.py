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
"""What all messages share: the stamp and header, and the error for a message that is refused.

Stamps are builtin_interfaces/Time, integer nanoseconds and seconds. Integer nanoseconds are exact.
Seconds since 1970 in a float64 are not: they resolve 0.24 us.

The message of a node's health is made here, since it has nothing but a stamp and texts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from msg_adapters import messages
from tsepm_ros.diagnostics.health_figures import Status

NANOSECONDS_PER_SECOND = 1_000_000_000


class MessageError(ValueError):
    """A message that cannot be used as a whole.

    Parameters
    ----------
    reason : str
        Reason for counting. Every adapter may raise ``unknown_type``, ``unknown_version``,
        ``package_not_installed``, ``missing_field``, ``stamp_invalid`` and ``frame_axes``; messages
        of arrays ``wrong_length``;
        clouds ``duplicate_field``, ``wrong_datatype``, ``wrong_count``, ``bad_offset``,
        ``bad_row_step`` and ``short_data``;
        clouds of tracks ``bad_id`` too;
        odometry ``not_finite``, ``zero_quaternion`` and ``undefined_heading``.
    sentence : str
        Message for the log; it names the field.

    Attributes
    ----------
    reason : str
    """

    def __init__(self, reason: str, sentence: str) -> None:
        super().__init__(reason, sentence)
        self.reason = reason

    def __str__(self) -> str:
        """Return the sentence."""
        return str(self.args[1])


@contextmanager
def refusing(reason: str, subject: str = "") -> Iterator[None]:
    """Turn a ValueError into a MessageError whose sentence begins with its subject."""
    try:
        yield
    except ValueError as error:
        raise MessageError(reason, f"{subject} {error}".lstrip()) from None


def time_to_ns(time: messages.Time) -> int:
    """Return the nanoseconds of a time message.

    Raises
    ------
    MessageError
        If `nanosec` is a second or more, which no clock gives.
    """
    if not 0 <= time.nanosec < NANOSECONDS_PER_SECOND:
        raise MessageError(
            "stamp_invalid", f"nanosec of a stamp must be below 1e9; got {time.nanosec}"
        )
    return int(time.sec) * NANOSECONDS_PER_SECOND + int(time.nanosec)


def ns_to_time(nanoseconds: int) -> messages.Time:
    """Return the time message of integer nanoseconds.

    Raises
    ------
    ValueError
        If the seconds do not fit 32 bits with a sign.
    """
    seconds, rest = divmod(int(nanoseconds), NANOSECONDS_PER_SECOND)
    check_seconds(seconds)
    return messages.Time(sec=seconds, nanosec=rest)


def check_seconds(seconds: int) -> None:
    """Refuse the whole seconds of a stamp that a time message cannot have.

    Raises
    ------
    ValueError
        If the seconds do not fit 32 bits with a sign.
    """
    if not -(2**31) <= seconds < 2**31:
        raise ValueError(
            f"stamp must be within 32-bit seconds, as in ROS messages; got {seconds} s (is it in "
            "milliseconds or nanoseconds?)"
        )


def ns_to_seconds(nanoseconds: int) -> float:
    """Return the float64 nearest to the nanoseconds in seconds."""
    return nanoseconds / NANOSECONDS_PER_SECOND


def seconds_to_ns(seconds: float) -> int:
    """Return the integer nanoseconds nearest to a float64 in seconds.

    Raises
    ------
    ValueError
        If the seconds are not finite.
    """
    if not math.isfinite(seconds):
        raise ValueError(f"stamp must be finite; got {seconds!r}")
    # Separately, because the product of a date in seconds and 1e9 does not fit 53 bits.
    fraction, whole = math.modf(seconds)
    return int(whole) * NANOSECONDS_PER_SECOND + round(fraction * NANOSECONDS_PER_SECOND)


def make_header(stamp_ns: int, frame_id: str) -> messages.Header:
    """Return a message header.

    Parameters
    ----------
    stamp_ns : int
        Stamp, ns.
    frame_id : str
        Name of the frame.

    Raises
    ------
    ValueError
        If the stamp does not fit a time message.
    """
    return messages.Header(stamp=ns_to_time(stamp_ns), frame_id=frame_id)


def diagnostics(
    stamp_ns: int, node_name: str, statuses: Iterable[Status]
) -> messages.DiagnosticArray:
    """Build the message of a node's health on ``/diagnostics``.

    Parameters
    ----------
    stamp_ns : int
        ns.
    node_name : str
        Fully qualified: two boats have nodes of one name. The name of a status is ``node: task``,
        as rqt_robot_monitor and the aggregator expect; the hardware is named after the node, too.
    statuses : iterable of Status
        Their values are written in their order, floats with six digits.

    Returns
    -------
    diagnostic_msgs.msg.DiagnosticArray
    """
    return messages.DiagnosticArray(
        header=make_header(stamp_ns, ""),
        status=[
            messages.DiagnosticStatus(
                level=bytes([status.level]),
                name=f"{node_name}: {status.task}",
                message=status.message,
                hardware_id=node_name,
                values=[
                    messages.KeyValue(
                        key=key, value=f"{value:.6g}" if isinstance(value, float) else f"{value}"
                    )
                    for key, value in status.values.items()
                ],
            )
            for status in statuses
        ],
    )
