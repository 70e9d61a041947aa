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
"""Whether what stands stays in place in the fixed frame, and which set-up would make it do so.

Echoes of the last minutes are kept, of scans between which the sensor turned or moved most. Every
so often they are looked at: a fit over set-ups (`own_ship.alignment`) names the error that explains
them as a right set-up would, or says that the cause is unknown. A finding begins the memory anew,
and each look from then on renews it, ends it, or cannot tell.
"""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.alignment import (
    APART,
    AS_IS,
    CLOCK,
    CLOCKWISE,
    LEAST,
    LIMITS,
    RIGHT,
    SEEN,
    UNKNOWN,
    Fit,
    Looks,
)
from tsepm_ros.own_ship.pose_history import PoseHistory
from tsepm_ros.own_ship.registration import Mounting, UnregisteredScan, registration_arrival_times
from tsepm_ros.session.drop_reasons import Notice
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel

FRAMES, ECHOES = 32, 24
"""Scans that are kept, those between which the sensor turned or moved most, and echoes of each."""
LEAST_TIME, MEMORY, MEMORY_OF_FINDING, LEAST_FRAMES = 0.5, 180.0, 30.0, 16
"""Time from one of these to the next, s, at least; age beyond which more than so many go, s, and
once something is found, which may be mended. Every so many scans, errors are looked for, and a
finding is renewed, or ended."""
POSE_STEP, UNKNOWN_TIME = 0.25, 60.0
"""Time between the poses that a look takes, and that scans must span before it is said that the
cause is unknown, s."""
OWN, SAME = 0.5, 1.5
"""Part of `LEAST` that a figure has as an error beside that of its fit, as all echoes are off alike
where a sonar is tilted; errors by which it may differ from the one that was said last."""
SENTENCES = {
    "yaw": (
        "the sensor's or own ship's heading is off: give mounting.yaw {value:.4f} +- {error:.4f} "
        "rad ({degrees:.1f} degrees from now; of tf, turn the sensor's frame by these), or mend "
        "the heading"
    ),
    "clock": (
        "own ship is {size:.2f} +- {error:.2f} s {late} by its stamps, if sound_speed is right: "
        "give own_ship_delay {value:.2f}, to sonar_detector too, and start again"
    ),
    "azimuth_scale": (
        "the angles of echoes are true when multiplied by {value:.2f} +- {error:.2f}: of images, "
        "the field of view is so many times sensor.azimuth_min to azimuth_max; else look for the "
        "unit of azimuths, and for the beam spacing of the driver"
    ),
    "range_scale": (
        "ranges fit own ship's motion when multiplied by {value:.2f} +- {error:.2f}: of images, "
        "look at image.far_range; else for the unit of ranges, the speed of sound, or the unit of "
        "own ship's positions"
    ),
    "mirrored": (
        "the azimuths are clockwise, where own ship's yaw is counter-clockwise: use the field "
        "bearing in place of azimuth; of images, the other image.port_first (of single bearings: "
        "image.clockwise); of a sonar that hangs upside down, mounting.roll 3.1416; if azimuths "
        "are right, own ship's heading is clockwise (a compass's, or NED): send it in ENU"
    ),
    "reversed": (
        "ranges count from the far end: of images, use the other image.near_first; else the "
        "driver must send ranges from the sonar"
    ),
    CLOCKWISE: (
        "own ship's heading is clockwise, as a compass's, a negated one, or that of a pose in NED "
        "(x north, y east): send the pose in ENU, x east, y north, and yaw counter-clockwise from "
        "east; if it is so, the azimuths are clockwise, and the heading or mounting.yaw is off"
    ),
    UNKNOWN: (
        "what stands does not fit own ship's motion; cause unknown: check mounting.x, y and yaw, "
        "own ship's heading and position (units, axes, clock, another vessel's), and the azimuths, "
        "the field of view and the ranges of the sonar; several may be wrong"
    ),
}
"""What is said of each kind of error."""


class RegistrationCheck:
    """Keeps echoes of the last minutes, and says what is set up wrong.

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
        self.start_over()

    def start_over(self) -> None:
        """Begin without scans and findings."""
        self._found: Fit | None = None
        self.finding = ""
        self._forget_scans()

    def _forget_scans(self) -> None:
        self._frames: list[tuple[FloatArray, FloatArray]] = []  # of echoes (5, n), and poses
        self._number, self._due = 0, -math.inf  # of scans so far, and the next one's least stamp

    def take(
        self,
        arrived: UnregisteredScan,
        scan: Scan,
        sensor: SensorModel,
        mounting: Mounting,
        poses: PoseHistory,
    ) -> list[Notice]:
        """Take a scan as it arrived and as it was registered; what is set up wrong."""
        frames, times = self._frames, registration_arrival_times(arrived)
        whole = len(times) in (1, len(scan))  # else echoes were left out
        if arrived.north_referenced or not whole or not len(scan) or scan.stamp < self._due:
            return []
        echoes = _echoes_of(scan, times, sensor)
        frames.append((echoes, np.reshape(scan.sensor_pose, (-1, 3))[0]))
        self._number += 1
        oldest = scan.stamp - (MEMORY if self._found is None else MEMORY_OF_FINDING)
        while len(frames) > LEAST_FRAMES and frames[0][0][0, 0] < oldest:
            del frames[0]
        if len(frames) > FRAMES:
            places = np.array([pose for _, pose in frames])
            change = np.abs(places[2:] - places[:-2]) @ [1.0, 1.0, float(np.median(echoes[1]))]
            del frames[1 + int(change.argmin())]
        part = (scan.stamp - float(frames[0][0][0, 0])) / FRAMES if len(frames) == FRAMES else 0.0
        self._due = scan.stamp + max(LEAST_TIME, part)
        if self._number % LEAST_FRAMES:
            return []
        looks = self._looks(sensor, mounting, poses)
        return self._compared(looks, mounting) if looks and looks.moved > SEEN else []

    def _looks(self, sensor: SensorModel, mounting: Mounting, poses: PoseHistory) -> Looks | None:
        """The scans around which poses are known, as arrays; None if there are too few."""
        longest, last = LIMITS[1, CLOCK] + POSE_STEP, poses.last_stamp or 0.0
        frames = [echoes for echoes, _ in self._frames if echoes[0].max() <= last - longest]
        if len(frames) <= APART:
            return None
        spans = [(one[0].min() - longest, one[0].max() + longest) for one in frames]
        around = np.unique(np.concatenate([np.arange(*span, POSE_STEP) for span in spans]))
        try:
            x, y, yaw = mounting.sensor_poses(poses.held_poses(around)).T
        except ValueError:  # a gap
            return None
        time, range_, azimuth, along, turn = np.concatenate(frames, axis=1)
        number = np.repeat(np.arange(len(frames)), [one.shape[1] for one in frames])
        ends, known = sensor.min_range + sensor.max_range, np.stack([around, x, y, np.unwrap(yaw)])
        return Looks(time, range_, azimuth, along, turn, number, ends, known, mounting.yaw)

    def _compared(self, looks: Looks, mounting: Mounting) -> list[Notice]:
        """Compare set-ups over the scans that are kept."""
        found = self._found
        if found is not None:
            as_is, now = looks.refined(RIGHT, AS_IS), looks.refined(*found[:3])
            stated = found._replace(evidence=looks.evidence(found.set_up))
            if now.differs and looks.gain(now, as_is, places=0.0):
                return self._say(now, mounting)
            if looks.gain(as_is, stated, places=0.0):
                self.start_over()
                return []
        fit = looks.explanation()
        if fit.kind == RIGHT and found is not None and found.kind == UNKNOWN:
            self.start_over()
        soon = fit.kind == UNKNOWN and np.ptp(looks.time) < UNKNOWN_TIME
        return self._say(fit, mounting) if fit.kind in SENTENCES and not soon else []

    def _say(self, fit: Fit, mounting: Mounting) -> list[Notice]:
        """Note a finding, and look anew: what it advises may be followed from now on."""
        self._forget_scans()
        known = self._found if self._found is not None and self._found.kind == fit.kind else None
        error = math.hypot(fit.error, OWN * LEAST[fit.parameter])
        if known and (
            fit.error > OWN * LEAST[fit.parameter]
            or abs(fit.off - known.off) <= SAME * math.hypot(error, known.error)
        ):
            return []
        self._found = fit
        given = {"yaw": mounting.yaw, "clock": self._delay}.get(fit.kind, 0.0)
        before, self.finding = (
            self.finding,
            SENTENCES[fit.kind].format(
                value=fit.set_up[fit.parameter] + given,
                error=error,
                size=abs(fit.off),
                degrees=math.degrees(fit.off),
                late="late" if fit.off > 0.0 else "early",
            ),
        )
        return [Notice("registration", self.finding)] if self.finding != before else []


def _echoes_of(scan: Scan, times: FloatArray, sensor: SensorModel) -> FloatArray:
    """The echoes of a scan that are likeliest to stand, else the strongest, or some, (5, n).

    Of each the time of arrival, range, azimuth, and the standard deviations of these two.
    """
    along = np.sqrt(sensor.range_variance(scan.range)) if scan.range_std is None else scan.range_std
    turn = sensor.azimuth_std if scan.azimuth_std is None else scan.azimuth_std
    columns = np.stack(np.broadcast_arrays(times, scan.range, scan.azimuth, along, turn))
    worth = scan.features.get("standing", scan.features.get("intensity", np.zeros(len(scan))))
    some = np.random.default_rng(len(scan)).random(len(scan))
    return columns[:, np.lexsort((some, -np.nan_to_num(worth)))[:ECHOES]]
