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
"""Sessions that note what they report, and what arrives at them."""

import dataclasses
import itertools
import math

import numpy as np

from support.builders import FIXED_RANGE_ERROR, scan_at
from tsepm_ros import Scan
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import TrackArrays

BOX = dataclasses.replace(load_scenario("box"), scans=10)

RULE = TsepmOptions(min_hits=3, window=4)


def settings(common: CommonOptions | None = None, rule: TsepmOptions = RULE, **options) -> Settings:
    return Settings(
        session=SessionOptions(**{"method": "tsepm", **options}),
        sensor=FIXED_RANGE_ERROR,
        common=common or CommonOptions(),
        methods={"tsepm": rule},
    )


class Reports(list):
    """What a session reported."""

    def __call__(self, reason: str, sentence: str) -> None:
        assert sentence
        self.append(reason)


class NotedSession(Session):
    """A session that notes in `heard` what it reports."""

    def __init__(self, settings: Settings, **more) -> None:
        self.heard = Reports()
        super().__init__(settings, self.heard, **more)


def session(*args, **options) -> NotedSession:
    return NotedSession(settings(*args, **options))


def moving_settings(**options) -> Settings:
    return settings(own_ship_source="odometry", **{"own_ship_max_gap": 3600.0, **options})


def moving(**options) -> NotedSession:
    return NotedSession(moving_settings(**options))


def arrived(scan: Scan, frame_id: str = "sonar", **more) -> UnregisteredScan:
    return UnregisteredScan(scan, frame_id, **more)


def ping(stamp: float, n: int = 1) -> UnregisteredScan:
    """A target that stands still, and more detections far off."""
    return arrived(
        scan_at(stamp, [(3000.0, 0.0)] + [(-2000.0 - 900 * k, 0.0) for k in range(n - 1)])
    )


def play(session: Session, stamps, now: float = math.inf):
    """Results of scans at the stamps, each processed as it comes."""
    results = []
    for stamp in stamps:
        session.add_scan(ping(float(stamp)), 0.0)
        results += session.process(now)
    return results


def play_empty(session: Session, stamps):
    """The same with scans that have no detections, and arrive at their stamps."""
    results = []
    for stamp in stamps:
        session.add_scan(arrived(Scan(float(stamp), [], [])), float(stamp))
        results += session.process()
    return results


def sail(session: Session, *stamps: float, frame_id: str = "odom") -> None:
    """Own-ship poses of a ship that runs along x at 2 m/s, at the stamps and every 20 s between."""
    for begin, end in itertools.pairwise([*stamps, stamps[-1]]):
        for stamp in [begin, *np.arange(begin + 20.0, end, 20.0)]:
            session.add_own_ship(
                PoseSample(float(stamp), 2.0 * stamp, 10.0, 0.5, frame_id=frame_id)
            )


def simulated(seed: int = 1) -> list[Scan]:
    return [simulated.scan for simulated in Simulator(BOX, seed)]


def current_ids(result) -> list[int]:
    return [track.track_id for track in result.current]


class FailingInitiator:
    """An initiator that fails at the scan of a stamp (s)."""

    def __init__(self, initiator: Tracker, stamp: float) -> None:
        self._initiator, self._fails_at = initiator, stamp

    def __getattr__(self, name: str):
        return getattr(self._initiator, name)

    def process(self, scan: Scan) -> TrackArrays:
        if scan.stamp == self._fails_at:
            raise ZeroDivisionError
        return self._initiator.process(scan)


@dataclasses.dataclass(frozen=True)
class FailingSettings(Settings):
    """Settings whose initiator fails at the scan of a stamp (s)."""

    fails_at: float = math.inf

    def make_tracker(self):
        return FailingInitiator(super().make_tracker(), self.fails_at)


def failing_at(stamp: float, settings: Settings) -> FailingSettings:
    return FailingSettings(**vars(settings), fails_at=stamp)
