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
"""Whether echoes that recur fall together in the fixed frame, and what would make them do so.

What stands has one place, however the vessel turns and moves. Echoes of the last minutes are placed
in the fixed frame as they are registered, and under a few hypotheses of what is set up wrong: with
azimuths that are clockwise, with ranges that count from the far end, and with own ship's clock
shifted. Under each, every echo has the sum x of the kernels of the others that lie near to it, and
the hypothesis the score ``sum log(1 + x)``, in which places that are crowded count little more than
others. A hypothesis is said where it fits clearly better than what is set up: by the gains d of the
echoes, ``sum d / sqrt(sum d^2)``, which are spread over several places.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import Mounting, UnregisteredScan, registration_arrival_times
from tsepm_ros.session.drop_reasons import Notice
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel

FRAMES, ECHOES = 40, 24
"""Scans that are kept, those between which the sensor turned or moved most, and echoes of each."""
LEAST_TIME, MEMORY, LEAST_FRAMES = 0.5, 180.0, 16
"""Time from one of these to the next, s, at least; age beyond which more than so many go, s."""
POSES, POSE_PERIOD = 4096, 0.1
"""Poses of own ship that are kept, and time between two, s, at least."""
BATCH = 8, 24, 192
"""Scans that are kept after which places are compared: at first, at most, and once they are clear.
"""
INFLATED, REACH = 1.25, 3.0
"""Deviations of a kernel in those that are stated, which may be too small; and its reach in its."""
APART = 4
"""Scans kept between two echoes of one place, at least: a target that moves is elsewhere then."""
LONGEST, STEPS = 2.0, 8
"""Largest shift of the clock that is tried, s, and steps to it."""
CLEAR, BETTER, CERTAIN = 6.0, 4.5, 4.0
"""Standard deviations of a gain from which on a hypothesis fits clearly better, and a shift of the
clock does that is so many of its own away from 0."""
SLOPE = 2.0
"""Standard deviations of the slope of the scores below which the clock is as it is."""
WORTH = 0.5
"""Deviations of an echo by which a shift of the clock that is said moves places, at least."""
PLACE, PLACES = 8.0, 3.0
"""Side of a place in standard deviations of an echo; places over which a gain is spread, at least.
"""
SEEN = 6.0
"""Standard deviations of an echo by which places move, at least, as the sensor turns or moves."""
STANDS = "as echoes of what stands show, "
MIRRORED = (
    f"{STANDS}the azimuths are clockwise, where own ship's yaw is counter-clockwise: use the field "
    "bearing in place of azimuth; of images, the other image.port_first (of single bearings: "
    "image.clockwise); of a sonar that hangs upside down, mounting.roll 3.1416; if azimuths are "
    "right, own ship's heading is clockwise (a compass's, or NED): send it in ENU"
)
REVERSED = (
    f"{STANDS}ranges count from the far end: of images, use the other image.near_first; else the "
    "driver must send ranges from the sonar"
)
CLOCK = (
    STANDS + "own ship is {:.2f} +- {:.2f} s {} by its stamps: give own_ship_delay {:.2f}, to "
    "sonar_detector too, and start again"
)
"""What is said of each hypothesis."""


class RegistrationCheck:
    """Keeps echoes of the last minutes, and says once what is set up wrong.

    Parameters
    ----------
    delay : float
        By which own ship's stamps are shifted already, s.

    Attributes
    ----------
    finding : str
        What is set up wrong by the last look, in a sentence; empty: nothing that shows.
    """

    def __init__(self, delay: float) -> None:
        self._delay = delay
        self._poses: deque[tuple[float, ...]] = deque(maxlen=POSES)
        self.start_over()

    def start_over(self) -> None:
        """Begin without scans and findings."""
        self._kind = self.finding = ""
        self._forget_scans()

    def _forget_scans(self) -> None:
        self._frames: list[tuple[FloatArray, FloatArray]] = []  # of echoes (5, n), and poses
        self._new, self._wait = 0, BATCH[0]

    def add_pose(self, sample: PoseSample) -> None:
        """Take a pose of own ship."""
        last = self._poses[-1][0] if self._poses else -math.inf
        if sample.stamp < last:
            self._poses.clear()
        if not last <= sample.stamp < last + POSE_PERIOD:
            pose = sample.x, sample.y, sample.yaw, sample.roll, sample.pitch
            self._poses.append((sample.stamp, *pose))

    def take(
        self, arrived: UnregisteredScan, scan: Scan, sensor: SensorModel, mounting: Mounting
    ) -> list[Notice]:
        """Take a scan as it arrived and as it was registered; what is set up wrong."""
        newest = self._frames[-1][0][0, 0] if self._frames else -math.inf
        if arrived.north_referenced or not len(scan) or scan.stamp < newest + LEAST_TIME:
            return []
        times = registration_arrival_times(arrived)
        if len(times) in (1, len(scan)):  # else echoes were left out
            self._keep(_echoes_of(scan, times, sensor), np.reshape(scan.sensor_pose, (-1, 3))[0])
        if self._new < self._wait:
            return []
        self._new = 0
        return self._compared(sensor, mounting)

    def _keep(self, echoes: FloatArray, pose: FloatArray) -> None:
        """Keep the echoes of a scan; drop those that show least."""
        frames = self._frames
        frames.append((echoes, pose))
        self._new += 1
        while len(frames) > LEAST_FRAMES and echoes[0, 0] - frames[0][0][0, 0] > MEMORY:
            del frames[0]
        if len(frames) > FRAMES:
            poses = np.array([frame[1] for frame in frames])
            change = np.abs(poses[2:] - poses[:-2]) @ [1.0, 1.0, float(np.median(echoes[1]))]
            del frames[1 + int(change.argmin())]

    def _compared(self, sensor: SensorModel, mounting: Mounting) -> list[Notice]:
        """Compare the hypotheses over the scans that are kept."""
        first, last = (self._poses[k][0] if self._poses else math.nan for k in (0, -1))
        frames = [
            frame
            for frame in self._frames
            if first <= frame[0][0].min() and frame[0][0].max() <= last - LONGEST
        ]
        if len(frames) <= APART:
            return []
        number = np.repeat(np.arange(len(frames)), [frame.shape[1] for frame, _ in frames])
        columns = np.concatenate([frame for frame, _ in frames], axis=1)
        known = np.array(self._poses).T
        known[3] = np.unwrap(known[3])
        echoes = _Kept._make([*columns, number, known, mounting])
        sigma, pose = float(np.median(echoes.sigma)), np.array([pose for _, pose in frames])
        turned = np.ptp(np.unwrap(pose[:, 2])) * float(np.median(echoes.range))
        moved = float(np.ptp(pose[:, :2], axis=0).max())
        if turned + moved < SEEN * sigma:
            return []
        others = {MIRRORED: echoes._replace(azimuth=-echoes.azimuth)}
        if moved > SEEN * sigma:
            ends = sensor.min_range + sensor.max_range
            others[REVERSED] = echoes._replace(range=np.abs(ends - echoes.range))
        as_is = echoes.scores()
        scores = {said: one.scores() for said, one in others.items()}
        gain, said = max((_gain(others[said], scores[said] - as_is), said) for said in scores)
        if gain > 0.0:
            return self._say(said, said)
        shift, deviation = echoes.best_shift(as_is, sigma)
        self._wait = min(2 * self._wait, BATCH[1 if deviation else 2])
        least = max(CERTAIN * deviation, WORTH * sigma / max(echoes.rate, 1e-9))
        if least < abs(shift) < LONGEST and _gain(
            echoes, echoes.scores(shift) - max([as_is, *scores.values()], key=np.sum), BETTER
        ):
            late = "late" if shift > 0.0 else "early"
            return self._say(CLOCK, CLOCK.format(abs(shift), deviation, late, self._delay + shift))
        if self._kind in scores and _gain(echoes, as_is - scores[self._kind]):
            self._kind = self.finding = ""
        return []

    def _say(self, kind: str, sentence: str) -> list[Notice]:
        """Note a finding, and look anew: what it advises may be followed from now on."""
        self._forget_scans()
        known, self._kind, self.finding = kind == self._kind, kind, sentence
        return [] if known else [Notice("registration", sentence)]


class _Kept(NamedTuple):
    """Echoes of several scans, (n,) each, the scans' numbers, and poses of own ship, (6, k)."""

    time: FloatArray
    range: FloatArray
    azimuth: FloatArray
    along: FloatArray
    turn: FloatArray
    scan: IntArray
    known: FloatArray
    mounting: Mounting

    @property
    def sigma(self) -> FloatArray:
        """Deviation of the places, m, (n,)."""
        return np.maximum(self.along, self.turn * self.range)

    @property
    def rate(self) -> float:
        """How much places move apart with a shift of the clock, m/s."""
        apart = [self.places(shift) for shift in (-0.1, 0.1)]
        speed = (apart[1] - apart[0]) / 0.2
        return float(np.sqrt(((speed - speed.mean(axis=0)) ** 2).sum(axis=1).mean()))

    def places(self, shift: float = 0.0) -> FloatArray:
        """Places (n, 2) of the echoes, own ship's clock shifted by a time, s."""
        vessel = [np.interp(self.time + shift, self.known[0], row) for row in self.known[1:]]
        x, y, yaw = self.mounting.sensor_poses(np.stack(vessel, axis=1)).T
        angle = self.azimuth + yaw
        return np.stack([x + self.range * np.cos(angle), y + self.range * np.sin(angle)], axis=1)

    def scores(self, shift: float = 0.0, wider: float = 1.0) -> FloatArray:
        """Scores (n,) of the echoes, own ship's clock shifted by a time, s."""
        place, sigma = self.places(shift), INFLATED * wider * self.sigma
        reach = REACH * math.sqrt(2.0) * float(sigma.max())
        first, second = KDTree(place).query_pairs(reach, output_type="ndarray").T
        apart = np.abs(self.scan[first] - self.scan[second]) >= APART
        first, second = first[apart], second[apart]
        square = ((place[first] - place[second]) ** 2).sum(axis=1)
        kernel = np.exp(-0.5 * square / (sigma[first] ** 2 + sigma[second] ** 2))
        return np.log1p(sum(np.bincount(row, kernel, len(place)) for row in (first, second)))

    def best_shift(self, as_is: FloatArray, sigma: float) -> tuple[float, float]:
        """The shift of the clock that fits best, and its deviation, s; 0 where that is as it is."""
        step, best = 2.0 * sigma / max(self.rate, 1e-9), 0.0
        if step > LONGEST:
            return 0.0, math.inf
        worse = [as_is - self.scores(side) for side in (-step, step)]
        if min(map(_certainty, worse)) > CLEAR:
            of_scans = np.bincount(self.scan, worse[0] - worse[1]).astype(float)
            if abs(_certainty(of_scans)) < SLOPE:
                return 0.0, 0.0
        else:
            tried = np.linspace(-LONGEST, LONGEST, 2 * STEPS + 1)
            wider = max(1.0, LONGEST / STEPS / step)
            best = float(tried[np.argmax([self.scores(shift, wider).sum() for shift in tried])])
        narrow = step / 8.0
        while True:
            middle, before, after = (self.scores(best + side) for side in (0.0, -step, step))
            slope, bend = after - before, float((after + before - 2.0 * middle).sum())
            best += step * float(np.clip(0.5 * slope.sum() / max(-bend, 1e-9), -1.5, 1.5))
            if step <= narrow:
                break
            step *= 0.4
        of_scans = np.bincount(self.scan, slope)
        return best, step * math.sqrt((of_scans**2).sum()) / max(-bend, 1e-9)


def _certainty(gain: FloatArray) -> float:
    """Sum of gains (n,) over its standard deviation."""
    return float(gain.sum()) / math.sqrt(float((gain**2).sum()) + 1e-9)


def _gain(echoes: _Kept, gain: FloatArray, least: float = CLEAR) -> float:
    """The sum of gains (n,) of echoes; 0 unless it is certain, and of several places."""
    side = PLACE * float(np.median(echoes.sigma))
    _, cell = np.unique(np.floor(echoes.places() / side), axis=0, return_inverse=True)
    of_place = np.bincount(cell, gain)
    spread = of_place.sum() ** 2 > PLACES * (of_place**2).sum()
    return float(gain.sum()) if _certainty(gain) > least and spread else 0.0


def _echoes_of(scan: Scan, times: FloatArray, sensor: SensorModel) -> FloatArray:
    """The echoes of a scan that are likeliest to stand, else the strongest, or some, (5, n).

    Of each the time of arrival, range, azimuth, and the deviations of these.
    """
    along = np.sqrt(sensor.range_variance(scan.range)) if scan.range_std is None else scan.range_std
    turn = sensor.azimuth_std if scan.azimuth_std is None else scan.azimuth_std
    columns = np.broadcast_arrays(times, scan.range, scan.azimuth, along, turn)
    worth = scan.features.get("standing", scan.features.get("intensity", np.zeros(len(scan))))
    if len(scan) <= ECHOES:
        return np.stack(columns)
    order = np.random.default_rng(len(scan)).permutation(len(scan))
    order = order[np.argsort(-np.nan_to_num(worth[order]), kind="stable")]
    return np.stack(columns)[:, order[:ECHOES]]
