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
"""History of own ship's poses, and the sensor's pose at transmit and reception of echoes."""

from __future__ import annotations

import cmath
import enum
import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, checked_covariance, turned

RATE_SPAN = 2.0
"""Time over which differences of poses give the sensor's velocity, s."""
MIN_RATE_SPAN = 0.5
"""Shortest time for differences of poses, s: below, pose errors dominate."""
LARGEST_ERRORS = 50.0, math.radians(30.0)
"""Steps of position and heading that may be errors, m and rad: ten deviations of 5 m, a plain fix,
and of 3 degrees."""
MAX_RATES = 50.0, math.radians(90.0)
"""Speed and turn rate of own ship beyond which it jumps, where none is stated, m/s and rad/s."""
RATE_ERRORS = 5.0, math.radians(10.0)
"""Errors of stated rates, m/s and rad/s, beside twice the rates: they may be through the water, of
another point of the vessel, or along other axes."""
LONG_STEP = 1.5
"""Ratio of an interval to the one before from which the stamp may be a jump."""
LEGS, COURSE_CHANGE, FROZEN_WAY = 20, math.radians(60.0), 20.0
"""Last legs with one heading, and change of course to either hand that is a turn, rad; and way by
the stated velocity with one position, m: a fix may come once in seconds."""
MIN_SPAN = 300.0
"""Time for which samples are kept beside that for which scans wait, s: longer than echoes take, and
than what stands is looked at again."""
MIN_SAMPLE_PERIOD = 0.009
"""Shortest time between stored samples, s: below the period of 100 Hz, far below a roll's."""


@dataclass(frozen=True)
class PoseSample:
    """Pose of the sensor, or of its vessel, at a time.

    Attributes
    ----------
    stamp : float
        s.
    x, y, yaw : float
        Fixed frame, m and rad.
    covariance : (3, 3) ndarray or None
        Covariance of x, y, yaw; None if unknown.
    rates : (float, float, float) or None
        Velocity vx, vy (fixed frame, m/s) and yaw rate (rad/s); None if all are unknown, nan for
        an unknown component: differences of poses replace them. `known_pose_rates` treats zeros.
    roll, pitch : float
        Attitude, rad, as in `tsepm_ros.own_ship.registration`; 0 if unknown.
    frame_id, child_frame_id : str
        The fixed frame, and the frame of the sensor or vessel; empty if unnamed.
    """

    stamp: float
    x: float
    y: float
    yaw: float
    covariance: FloatArray | None = None
    rates: tuple[float, float, float] | None = None
    roll: float = 0.0
    pitch: float = 0.0
    frame_id: str = ""
    child_frame_id: str = ""

    def check(self) -> None:
        """Check that the sample is usable for registration.

        Raises
        ------
        ValueError
            If it is not; the message names the value.
        """
        rates = self.rates or ()
        pose = (self.x, self.y, self.yaw, self.roll, self.pitch)
        if not math.isfinite(self.stamp):
            raise ValueError(f"stamp must be finite; got {self.stamp}")
        if not all(abs(value) <= MAX_MAGNITUDE["sensor_pose"] for value in pose):
            raise ValueError(f"pose must be finite and on earth; got {pose}")
        if any(abs(rate) > MAX_MAGNITUDE["sensor_velocity"] for rate in rates):
            raise ValueError(
                f"rates must be at most {MAX_MAGNITUDE['sensor_velocity']:g}; got {rates}"
            )
        if self.covariance is not None:
            checked_covariance("covariance", self.covariance)
            position = self.covariance[:2, :2]  # a large heading variance must not hide its error
            if np.linalg.eigvalsh(position)[0] < -1e-9 * np.abs(position).max():
                raise ValueError("covariance of x and y must be positive semi-definite")


def known_pose_rates(vx: float, vy: float, yaw_rate: float) -> tuple[float, float, float]:
    """Replace zero rates by nan: Odometry cannot mark a rate unknown.

    Velocity and yaw rate are treated separately, since a source may provide only one of them. For a
    ship at rest, or on a straight course, the differences of poses give the same rates.
    """
    if not (vx or vy):
        vx = vy = math.nan
    return vx, vy, yaw_rate or math.nan


def pose_jump(before: PoseSample | None, after: PoseSample) -> str:
    """What no vessel does from a pose to a later one, in words; empty if there is nothing.

    A step is a jump where neither the rates that both poses state, or else those of any vessel, nor
    errors of a position fix or a compass make it.
    """
    if before is None or after.stamp <= before.stamp:
        return ""
    seconds, unknown = after.stamp - before.stamp, (math.nan,) * 3
    pairs = zip(before.rates or unknown, after.rates or unknown, strict=True)
    vx, vy, turn_rate = (0.5 * (first + second) for first, second in pairs)
    way, turn = complex(after.x - before.x, after.y - before.y), turned(after.yaw - before.yaw)
    for k, (step, rate, words, size) in enumerate(
        (
            (way, complex(vx, vy), "own ship's position jumps by {:.3g} m", 1.0),
            (turn, turn_rate, "own ship's heading jumps by {:.3g} degrees", math.radians(1.0)),
        )
    ):
        known = not cmath.isnan(rate)
        off = abs(step - rate * seconds if known else step)
        off = min(off, abs(2.0 * math.pi - off)) if k else off
        allowed = RATE_ERRORS[k] + 2.0 * abs(rate) if known else MAX_RATES[k]
        if off > math.hypot(allowed * seconds, LARGEST_ERRORS[k]):
            stated = f"its stated rates make {abs(rate) * seconds / size:.3g} of it"
            return (
                f"{words.format(abs(step) / size)} in {seconds:.3g} s at {after.stamp:.3f} s, "
                f"{stated if known else 'and no rate is stated'}"
            )
    return ""


class FrozenCheck:
    """Finds a heading that stays equal to the last bit while the course turns, or a position.

    Attributes
    ----------
    finding : str
        In words; empty: both are renewed, or the course is straight and own ship at rest.
    """

    def __init__(self) -> None:
        self._legs, self._turned = deque[PoseSample](maxlen=LEGS), ""
        self._fix: tuple[PoseSample, PoseSample, complex] | None = None
        self.finding = ""

    def take(self, sample: PoseSample) -> str:
        """Take the next pose; returns a finding that is new."""
        self._take_heading(sample)
        known, self.finding = self.finding, self._of_position(sample) or self._turned
        return "" if known else self.finding

    def _of_position(self, sample: PoseSample) -> str:
        """How far the stated velocity went while the position is the same; empty: not so far."""
        first, last, way = self._fix or (sample, sample, 0.0j)
        if (sample.x, sample.y) != (first.x, first.y):
            first, last, way = sample, sample, 0.0j
        way += complex(*np.nan_to_num((last.rates or (0.0, 0.0))[:2])) * min(
            max(sample.stamp - last.stamp, 0.0), RATE_SPAN
        )  # a clock may be set
        self._fix = first, sample, way
        return (
            f"own ship's position is the same to the last bit for "
            f"{sample.stamp - first.stamp:.3g} s, in which its stated velocity makes "
            f"{abs(way):.3g} m: the position is not renewed, or the velocity is through the water"
            if abs(way) > FROZEN_WAY
            else ""
        )

    def _take_heading(self, sample: PoseSample) -> None:
        if not self._legs or sample.yaw != self._legs[-1].yaw:
            self._legs, self._turned = deque([sample], maxlen=LEGS), ""
        last = self._legs[-1]
        if math.hypot(sample.x - last.x, sample.y - last.y) <= LARGEST_ERRORS[0]:
            return
        self._legs.append(sample)
        courses = np.angle(np.diff([complex(leg.x, leg.y) for leg in self._legs]))
        turn = float(np.abs(np.sin(courses - courses[0])).max())
        if turn > math.sin(COURSE_CHANGE):
            self._turned = (
                f"own ship's heading is {sample.yaw:.6g} rad to the last bit for "
                f"{sample.stamp - self._legs[0].stamp:.3g} s, in which its course turned by "
                f"{math.degrees(math.asin(turn)):.0f} degrees: the heading is not renewed, or the "
                "vessel moves sideways"
            )


class PoseCoverage(enum.Enum):
    """Whether a history covers a span of time."""

    YES = "yes"
    NOT_YET = "not yet"
    NEVER = "never"


class PoseHistory:
    """Recent poses, interpolated linearly in between.

    Yaw, roll and pitch are interpolated separately, along the shorter arc. This differs from a
    rotation at a constant rate only in the second order of the turn between two samples. Beyond the
    first and the last sample the pose is extrapolated, while roll and pitch stay constant: a roll
    oscillates.

    Samples at more than 100 Hz are thinned: the newest sample is always stored, and the next sample
    replaces it if it is less than `MIN_SAMPLE_PERIOD` after its predecessor. `coverage` counts only
    permanent samples: later samples do not change a covered pose by a bit.

    Parameters
    ----------
    min_samples : int
        The oldest samples are removed where there are more than this number and they are older
        than `min_span`: their number is bounded by this or ``min_span / MIN_SAMPLE_PERIOD``.
    min_span : float
        Time before the newest sample, s, for which samples are kept: a ping lasts seconds, and
        its poses are requested as soon as the last of them has arrived. May be replaced.
    max_extrapolation : float
        Time beyond the first or last sample, s, over which poses are extrapolated.
    max_gap : float
        Longest interval between two samples, s, for interpolation.
    """

    def __init__(
        self,
        min_samples: int = 100,
        min_span: float = MIN_SPAN,
        max_extrapolation: float = 0.0,
        max_gap: float = math.inf,
    ) -> None:
        self.max_extrapolation, self.max_gap = max_extrapolation, max_gap
        self._min_samples, self.min_span = min_samples, min_span
        self._samples: list[PoseSample] = []
        self._late: list[PoseSample] = []
        self._late_since = math.nan

    def __len__(self) -> int:
        """Number of samples stored."""
        return len(self._samples)

    def add(self, sample: PoseSample) -> bool:
        """Add a sample; return False, without using it, if it is not later than the last sample.

        A run of late samples in ascending order, with no later sample between them, is kept for
        `start_over`.
        """
        if self._samples and sample.stamp <= self._samples[-1].stamp:
            if self._late and sample.stamp <= self._late[-1].stamp:
                self._late.clear()
            if not self._late:
                self._late_since = sample.stamp
            self._keep(self._late, sample)
            return False
        self._late.clear()
        self._keep(self._samples, sample)
        return True

    def stamp_jump(self, sample: PoseSample, longest: float) -> str:
        """What no right stamp does, in words; empty if there is nothing.

        The stamp of a sample jumps where it comes a longer interval after the newest than that came
        after the one before, and the sample is twice as near to the path after the shorter interval
        as to the path at its stamp: noise is as near to both.

        Parameters
        ----------
        sample : PoseSample
            Later than the newest.
        longest : float
            Interval of samples, s, above which nothing is said.
        """
        if len(self._samples) < 2:
            return ""
        before, newest = self._samples[-2:]
        usual, step = newest.stamp - before.stamp, sample.stamp - newest.stamp
        is_long = usual <= longest and step >= LONG_STEP * usual
        if not (is_long and 2.0 * self.off_path(sample, usual) <= self.off_path(sample, step)):
            return ""
        return (
            f"own ship's stamp jumps by {step:.3g} s to {sample.stamp:.3f} s, with a pose as of "
            f"{usual:.3g} s"
        )

    def off_path(self, sample: PoseSample, seconds: float) -> float:
        """How far a sample is from where the path goes on from the newest in a time, s.

        As a multiple of `LARGEST_ERRORS`; nan if the rates are unknown.
        """
        newest = self._samples[-1]
        vx, vy, turn_rate = self.rates(np.array([newest.stamp]), newest.stamp)[0].tolist()
        way, turn = complex(sample.x - newest.x, sample.y - newest.y), sample.yaw - newest.yaw
        off = abs(way - seconds * complex(vx, vy)) / LARGEST_ERRORS[0]
        return off + abs(turned(turn - seconds * turn_rate)) / LARGEST_ERRORS[1]

    def _keep(self, samples: list[PoseSample], newest: PoseSample) -> None:
        del samples[_settled(samples) :]
        samples.append(newest)
        old = bisect_left(samples, newest.stamp - self.min_span, key=_stamp)
        del samples[: min(old, max(len(samples) - self._min_samples, 0))]

    @property
    def late_span(self) -> float:
        """Time from the first to the last of the samples kept for `start_over`, s."""
        return self._late[-1].stamp - self._late_since if self._late else 0.0

    def start_over(self) -> None:
        """Replace the history by the current run of late samples."""
        self._samples, self._late = self._late, []

    def clear(self) -> None:
        """Remove all samples."""
        self._samples.clear()
        self._late.clear()

    @property
    def newest(self) -> PoseSample | None:
        """The newest sample."""
        return self._samples[-1] if self._samples else None

    @property
    def first_stamp(self) -> float | None:
        """Stamp of the oldest sample, s."""
        return self._samples[0].stamp if self._samples else None

    @property
    def last_stamp(self) -> float | None:
        """Stamp of the newest sample, s."""
        return self._samples[-1].stamp if self._samples else None

    def coverage(self, first: float, last: float) -> PoseCoverage:
        """Whether poses from `first` to `last` (s) are available, now or with later samples."""
        if not self._samples:
            return PoseCoverage.NOT_YET
        if first < self._samples[0].stamp - self.max_extrapolation:
            return PoseCoverage.NEVER
        settled = _settled(self._samples)
        newest = self._samples[settled - 1].stamp
        if self._has_gap(first, min(last, newest)):
            return PoseCoverage.NEVER
        if last > newest or (first < self._samples[0].stamp and settled < 2):
            return PoseCoverage.NOT_YET
        return PoseCoverage.YES

    def _has_gap(self, first: float, last: float) -> bool:
        """Whether samples between two times (s) are more than `max_gap` apart."""
        stamps = np.array([sample.stamp for sample in self._bracket(first, last)])
        begin = max(int(np.searchsorted(stamps, first, side="right")) - 1, 0)
        inside = stamps[begin : int(np.searchsorted(stamps, last)) + 1]
        return bool((np.diff(inside) > self.max_gap).any())

    def can_extrapolate(self, last: float) -> bool:
        """Whether `last` (s) is at most `max_extrapolation` after the newest sample."""
        return bool(self._samples) and last <= self._samples[-1].stamp + self.max_extrapolation

    def poses(self, times: FloatArray) -> FloatArray:
        """Poses at the given times.

        Parameters
        ----------
        times : (n,) ndarray
            s.

        Returns
        -------
        (n, 5) ndarray
            x, y, yaw, roll, pitch.

        Raises
        ------
        ValueError
            If a time is beyond the coverage and its extrapolation.
        """
        times = np.asarray(times, float)
        if len(times) == 0:
            return np.zeros((0, 5))
        samples = self._around(float(times.min()), float(times.max()))
        stamps = np.array([sample.stamp for sample in samples])
        values = np.array([(s.x, s.y, s.yaw, s.roll, s.pitch) for s in samples])
        values[:, 2:] = np.unwrap(values[:, 2:], axis=0)
        if len(samples) == 1:
            poses = np.repeat(values, len(times), axis=0)
        else:
            # A time at a sample's stamp uses the interval before: the next sample may be missing.
            left = np.clip(np.searchsorted(stamps, times) - 1, 0, len(stamps) - 2)
            interval = (stamps[left + 1] - stamps[left])[:, None]
            fraction = np.repeat((times - stamps[left])[:, None] / interval, 5, axis=1)
            fraction[:, 3:] = fraction[:, 3:].clip(0.0, 1.0)
            poses = values[left] + fraction * (values[left + 1] - values[left])
        newest = self._samples[-1]
        beyond = times > newest.stamp
        if newest.rates is not None and beyond.any():
            elapsed = (times[beyond] - newest.stamp)[:, None]
            predicted = values[-1, :3] + elapsed * np.array(newest.rates)
            poses[beyond, :3] = np.where(np.isnan(predicted), poses[beyond, :3], predicted)
        return poses

    def held_poses(self, times: FloatArray) -> FloatArray:
        """Poses (n, 5) at times (n,), s: beyond those that are known, as at their ends.

        Raises
        ------
        ValueError
            If no pose is known, or there is a gap.
        """
        if not self._samples:
            raise ValueError("no pose is known")
        last = self._samples[-1].stamp + self.max_extrapolation
        return self.poses(np.clip(times, self._samples[0].stamp, last))

    def rates(self, times: FloatArray, last: float) -> FloatArray:
        """Velocities and yaw rates at the given times, in the fixed frame.

        Rates of the samples are interpolated linearly, and constant beyond the newest sample.
        Unknown rates are differences of poses over the `RATE_SPAN` around each time. The span is
        shorter after the start of the history or a gap, and shifted back to end at the first sample
        at or after `last`. Samples after that sample are not used: they cannot change the rates up
        to `last`.

        A source's own rates are mostly far better: white errors of sigma in the positions leave
        ``sigma sqrt(2) / RATE_SPAN`` in each component of the velocity, 0.7 m/s for 1 m. A span
        shifted by up to half its length gives rates older by that time.

        Parameters
        ----------
        times : (n,) ndarray
            s, at most `last`.
        last : float
            End of the covered time, s.

        Returns
        -------
        (n, 3) ndarray
            vx, vy in m/s and yaw rate in rad/s; nan where they are unknown and the poses span less
            than `MIN_RATE_SPAN`.
        """
        times = np.asarray(times, float)
        if not self._samples or not times.size:
            return np.full((len(times), 3), np.nan)
        newest = self._samples[-1].stamp
        samples = self._bracket(min(float(times.min()), newest) - RATE_SPAN, last)
        stamps = np.array([sample.stamp for sample in samples])
        right = np.searchsorted(stamps, times).clip(max=len(stamps) - 1)
        left = (right - 1).clip(min=0)
        source_rates = np.array([sample.rates or (np.nan,) * 3 for sample in samples])
        interval = stamps[right] - stamps[left]
        fraction = np.ones(len(times))
        np.divide(times - stamps[left], interval, out=fraction, where=interval > 0)
        change = source_rates[right] - source_rates[left]
        rates = source_rates[left] + fraction.clip(0.0, 1.0)[:, None] * change
        unknown = np.isnan(rates)
        if not unknown.any():
            return rates
        return np.where(unknown, self._differences(samples, stamps, times, last), rates)

    def _differences(
        self, samples: list[PoseSample], stamps: FloatArray, times: FloatArray, last: float
    ) -> FloatArray:
        """Rates from the poses at the ends of a span around each time; nan for too short a span."""
        final = min(int(np.searchsorted(stamps, last)), len(stamps) - 1)
        after_gap = np.diff(stamps, prepend=stamps[0]) > self.max_gap
        since = np.maximum.accumulate(np.where(after_gap, stamps, stamps[0]))
        end = np.minimum(times + 0.5 * RATE_SPAN, stamps[final])
        right = np.searchsorted(stamps, times).clip(max=final)
        begin = np.maximum(end - RATE_SPAN, since[right])
        yaws = np.unwrap([sample.yaw for sample in samples])
        changes = [
            np.interp(end, stamps, values) - np.interp(begin, stamps, values)
            for values in ([sample.x for sample in samples], [sample.y for sample in samples], yaws)
        ]
        span = end - begin
        span[span < MIN_RATE_SPAN] = np.nan
        return np.stack(changes, axis=-1) / span[:, None]

    def covariance(self, time: float) -> FloatArray | None:
        """Pose covariance of the sample nearest to a time (s); None if unknown."""
        if not self._samples:
            return None
        return min(self._around(time, time), key=lambda s: abs(s.stamp - time)).covariance

    def _around(self, first: float, last: float) -> list[PoseSample]:
        """The samples around a covered span of time."""
        if self.coverage(first, last) is not PoseCoverage.YES and not (
            self.coverage(first, first) is not PoseCoverage.NEVER and self.can_extrapolate(last)
        ):
            raise ValueError(f"no pose is known from {first} s to {last} s")
        return self._bracket(first, last)

    def _bracket(self, first: float, last: float) -> list[PoseSample]:
        begin = max(bisect_left(self._samples, first, key=_stamp) - 1, 0)
        end = min(bisect_left(self._samples, last, key=_stamp) + 2, len(self._samples))
        begin = max(min(begin, end - 2), 0)
        return self._samples[begin:end]


def _settled(samples: list[PoseSample]) -> int:
    """Number of permanent samples: all but a newest sample too close to its predecessor."""
    return len(samples) - (
        len(samples) > 1 and samples[-1].stamp - samples[-2].stamp < MIN_SAMPLE_PERIOD
    )


def _stamp(sample: PoseSample) -> float:
    return sample.stamp


def echo_poses(
    poses_at: Callable[[FloatArray], FloatArray],
    stamp: float,
    time_offset: FloatArray | None,
    azimuth: FloatArray,
    *,
    transmit_offset: FloatArray | None = None,
    heading: bool = True,
) -> FloatArray:
    """Sensor poses that register the echoes received by a moving, turning sensor.

    A ping leaves at t0 = stamp + transmit_offset, its echo arrives at t1, and the position is valid
    halfway, at stamp + time_offset. The azimuth is relative to the heading at t1, the range r is
    the mean of both legs. With u the line of sight, the leg back is ``r - u.(s(t1) - s(t0)) / 2``
    to first order, so the target is at distance r along u from
    ``s(t1) - u u.(s(t1) - s(t0)) / 2``, with the yaw at t1.

    Parameters
    ----------
    poses_at : callable
        Function from m times to the sensor's poses (x, y, yaw), (m, 3): `PoseHistory.poses`.
    stamp : float
        Start of transmit, s.
    time_offset : (n,) ndarray or None
        Time after `stamp` at which each position is valid, s; None: 0 for all.
    azimuth : (n,) ndarray
        rad, sensor frame.
    transmit_offset : (n,) ndarray, optional
        Time after `stamp` at which each ping left, s; 0 if not given.
    heading : bool, optional
        False where the azimuths count from the fixed frame's x axis: the yaw is then 0.

    Returns
    -------
    (3,) or (n, 3) ndarray
        One pose for a scan without time offsets, else one per detection.
    """
    with_yaw = [1.0, 1.0, 1.0 if heading else 0.0]
    delay = np.zeros(1) if transmit_offset is None else transmit_offset
    if time_offset is None or not time_offset.any():
        return poses_at(np.array([stamp]))[0] * with_yaw
    sent = poses_at(stamp + delay)
    poses = poses_at(stamp + 2.0 * time_offset - delay) * with_yaw
    sight = np.stack([np.cos(azimuth + poses[:, 2]), np.sin(azimuth + poses[:, 2])], axis=1)
    displacement = ((poses[:, :2] - sent[:, :2]) * sight).sum(axis=1, keepdims=True)
    poses[:, :2] -= 0.5 * displacement * sight
    return poses
