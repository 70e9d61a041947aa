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
"""What holds after every message, whatever it was."""

from collections import Counter
from collections.abc import Mapping

import numpy as np
from campaign import Finding

from tsepm_ros.session.drop_reasons import DROP_REASONS, drop_reason_of
from tsepm_ros.session.session import ScanResult
from tsepm_ros.tracker.tracks import TrackArrays

ROUNDING = 1e-9
"""Speed that rounding of positions may leave, m/s."""
MAX_SPEED_SLACK = 1.0 + 1e-6
MAX_ASYMMETRY = 1e-12
"""Of the correlations: rounding alone."""


def require(condition: object, sentence: str) -> None:
    """Raise a Finding with the sentence unless the condition holds."""
    if not condition:
        raise Finding(sentence)


def check_tracks(tracks: TrackArrays, what: str) -> None:
    """States are finite; covariances are finite, symmetric and positive definite; ids differ."""
    if not len(tracks):
        return
    covariance = tracks.covariance
    require(np.isfinite(tracks.state).all(), f"a state of {what} is not finite")
    require(np.isfinite(covariance).all(), f"a covariance of {what} is not finite")
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    require((variance > 0).all(), f"a variance of {what} is not positive")
    scale = np.sqrt(variance)
    correlation = covariance / scale[:, :, None] / scale[:, None, :]
    asymmetry = float(np.abs(correlation - correlation.transpose(0, 2, 1)).max())
    require(asymmetry < MAX_ASYMMETRY, f"a covariance of {what} is not symmetric: {asymmetry!r}")
    least = float(np.linalg.eigvalsh(correlation).min())
    require(least > 0.0, f"a covariance of {what} is not positive definite: {least!r}")
    try:
        np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise Finding(f"a covariance of {what} has no Cholesky factor") from None
    require(len(set(tracks.track_id.tolist())) == len(tracks), f"ids of {what} are not unique")


class TrackBook:
    """The ids of a session: each begins once, and lives until it ends."""

    def __init__(self, max_speed: float, most_of_starts: float) -> None:
        self.max_speed, self.most_of_starts = max_speed, most_of_starts
        self._given: set[int] = set()

    def check(self, result: ScanResult) -> None:
        """Check a result."""
        for tracks, what in (
            (result.new, "new tracks"),
            (result.current, "confirmed tracks"),
            (result.fixed_echoes, "fixed echoes"),
        ):
            check_tracks(tracks, what)
        new = set(result.new.track_id.tolist())
        require(not new & self._given, f"the ids {sorted(new & self._given)} were given before")
        self._given |= new
        confirmed = result.current[~np.isin(result.current.track_id, list(new))]
        for tracks, most, what in (
            (result.new, self.most_of_starts, "new tracks"),
            (confirmed, self.max_speed, "confirmed tracks"),
        ):
            own = np.isin(tracks.track_id, list(self._given))  # not those of a downstream tracker
            speed = np.hypot(tracks.state[:, 1], tracks.state[:, 3])[own]
            limit = most * MAX_SPEED_SLACK + ROUNDING
            require((speed <= limit).all(), f"a speed of {what} is above the maximum")


def lost_scans(dropped: Mapping[str, int]) -> int:
    """Number of scans among the drops."""
    return sum(number for name, number in dropped.items() if drop_reason_of(name).lost == "scan")


def check_reasons(dropped: Counter[str]) -> None:
    """Every reason is described, and none is a fault of the program."""
    for name in dropped:
        require(name in DROP_REASONS, f"the reason {name} is not described")
    require(not dropped["internal_error"], f"{dropped['internal_error']} internal errors")


def same_tracks(one: TrackArrays, other: TrackArrays) -> bool:
    """Whether tracks are equal to the bit, but for their ids."""
    return (
        np.array_equal(one.state, other.state)
        and np.array_equal(one.covariance, other.covariance)
        and np.array_equal(one.stamp, other.stamp)
    )
