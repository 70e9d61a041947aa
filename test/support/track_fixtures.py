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
"""What the adapter tests share."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from msg_adapters import make_header
from tsepm_ros.tracker.tracks import ConfirmedTrack

STATE = (3000.25, -4.5, 4000.5, 2.25)
COVARIANCE = np.array(
    [
        [9000.0, 100.0, 2000.0, 30.0],
        [100.0, 4.0, 31.0, 0.5],
        [2000.0, 31.0, 5000.0, 80.0],
        [30.0, 0.5, 80.0, 3.0],
    ]
)


@pytest.fixture
def header() -> Any:
    """Header in a fixed frame, at a date whose nanoseconds no float64 holds."""
    return make_header(1_700_000_000_123_456_789, "map")


@pytest.fixture
def make_track() -> Callable[..., ConfirmedTrack]:
    """Make a track; keywords replace its values."""

    def make(**values: Any) -> ConfirmedTrack:
        defaults = {
            "track_id": 7,
            "stamp": 1_700_000_000.123456789,
            "state": np.array(STATE),
            "covariance": COVARIANCE.copy(),
            "hits": ((0, 3), (1, 0), (3, 2), (4, 4), (6, 1)),
            "evaluation": 1.25,
            "score": 6.5,
            "scan_count": 7,
            "age": 72.0,
        }
        return ConfirmedTrack(**{**defaults, **values})

    return make


@pytest.fixture
def over_the_wire() -> Callable[[Any], Any]:
    """Take a message through ROS's serialisation, which refuses values of a wrong type."""
    serialization = pytest.importorskip("rclpy.serialization")

    def transfer(message: Any) -> Any:
        return serialization.deserialize_message(
            serialization.serialize_message(message), type(message)
        )

    return transfer
