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
"""What the node must publish: the same numbers given to the initiator directly."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2

from support.sonar_driver import Ping, points, stamp_ns
from tsepm_ros import ConfirmedTrack, Scan, SensorModel, make_initiator
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.tracker.tracker import Tracker

STATE = ("state_x", "state_vx", "state_y", "state_vy")
COVARIANCE = tuple(f"cov_{row}{column}" for row in range(4) for column in range(4))


def as_scan(ping: Ping, **more: Any) -> Scan:
    return Scan(
        stamp=ping.stamp_ns / 10**9,
        range=np.asarray(ping.range, float),
        azimuth=np.asarray(ping.azimuth, float),
        **more,
    )


def initiator(method: str = SessionOptions().method, **options: Any) -> Tracker:
    return make_initiator(method, sensor=SensorModel(), **options)


def confirmed(pings: Iterable[Ping], **options: Any) -> list[list[ConfirmedTrack]]:
    """Newly confirmed tracks of every ping, and those that are published anew."""
    method = initiator(**options)
    return [[*method.process(as_scan(ping)), *method.revised] for ping in pings]


def assert_same(
    messages: Sequence[PointCloud2], expected: Sequence[Sequence[ConfirmedTrack]]
) -> None:
    """Check that the messages carry these tracks, one message per scan; ids aside."""
    assert [message.width for message in messages] == [len(tracks) for tracks in expected]
    assert any(expected), "the scene must confirm tracks, or nothing was compared"
    for message, tracks in zip(messages, expected, strict=True):
        for point, track in zip(points(message), tracks, strict=True):
            assert_same_track(point, track)


def assert_same_track(point: dict[str, float], track: ConfirmedTrack) -> None:
    np.testing.assert_allclose([point[name] for name in STATE], track.state, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        [point[name] for name in COVARIANCE],
        track.covariance.ravel(),
        rtol=0,
        atol=1e-9 * np.linalg.norm(track.covariance),
    )
    assert (point["x"], point["y"], point["z"]) == (*track.position.astype(np.float32), 0)
    np.testing.assert_allclose(point["evaluation"], track.evaluation, rtol=1e-9)
    np.testing.assert_equal(point["score"], track.score)
    assert (point["hit_count"], point["scan_count"]) == (len(track.hits), track.scan_count)
    np.testing.assert_allclose(point["age"], track.age, rtol=1e-12)


def assert_stamps(messages: Sequence[PointCloud2], pings: Sequence[Ping]) -> None:
    """Check that every message has its ping's stamp, to the nanosecond."""
    assert [stamp_ns(message) for message in messages] == [ping.stamp_ns for ping in pings]
