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
"""From arriving messages to a session, for the node and offline runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from msg_adapters import (
    MessageError,
    read_detections,
    read_land,
    read_own_ship,
    tracker_report,
)
from tsepm_ros.session.drop_reasons import drop_reason_of
from tsepm_ros.session.inputs import Now
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions


class MessageInput:
    """Passes the messages that `track_initiator` subscribes to on to a session.

    The session drops and counts unusable messages.

    Parameters
    ----------
    session : Session
    options : InitiatorNodeOptions
        Options for reading detections.
    say : callable, optional
        Called with each sentence about data that a message does not have and that was assumed.

    Attributes
    ----------
    options : InitiatorNodeOptions
        Options for reading detections; may be replaced.
    """

    def __init__(
        self,
        session: Session,
        options: InitiatorNodeOptions,
        say: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        self._session = session
        self.options = options
        self._say = say

    def take_detections(self, message: Any, now: Now) -> None:
        """Take a message of any type of `read_detections` that arrived at `now`, s."""
        try:
            ping = read_detections(
                message,
                bearing_reference=self.options.bearing_reference,
                sound_speed=self.options.sound_speed,
                sensor=self._session.settings.sensor,
            )
        except MessageError as error:
            self._session.drop(error.reason, f"detections dropped: {error}")
            return
        for reason, number in ping.dropped.items():
            meaning = drop_reason_of(reason).meaning or reason
            self._session.drop(reason, f"{number} detections dropped: {meaning}", number)
        for assumption in ping.assumptions:
            self._say(assumption)
        self._session.add_scan(ping.sensor_scan, now)

    def take_own_ship(self, message: Any) -> None:
        """Take a nav_msgs/Odometry, for all sensors of the picture."""
        with self._dropping("own-ship data", reason="own_ship_invalid"):
            sample = read_own_ship(message, self._session.fixed_frame)
            for session in self._session.picture.sessions.values():
                session.add_own_ship(sample)

    def take_tracked(self, message: Any) -> None:
        """Take a downstream tracker's report, a cloud in the layout of tracks."""
        with self._dropping("tracked targets", prefix="tracked_"):
            self._session.add_tracked(tracker_report(message))

    def take_land(self, message: Any) -> None:
        """Take a nav_msgs/OccupancyGrid."""
        with self._dropping("land"):
            self._session.add_land(read_land(message), message.header.frame_id)

    @contextmanager
    def _dropping(self, subject: str, reason: str = "", prefix: str = "") -> Iterator[None]:
        """Drop and count an unusable message, by its error's reason if no other is given."""
        try:
            yield
        except MessageError as error:
            self._session.drop(reason or prefix + error.reason, f"{subject} dropped: {error}")
