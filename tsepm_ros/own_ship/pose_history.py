"""Where the sensor was when an echo left and came back."""

from __future__ import annotations

import enum
import math
from bisect import bisect_left
from collections.abc import Callable

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_sample import PoseSample

RATE_SPAN = 2.0
"""Time over which poses are compared for the sensor's velocity, s."""
SHORTEST_RATE_SPAN = 0.5
"""Where there are poses for less than this, s, their errors drown their difference."""
SHORTEST_PERIOD = 0.009
"""Least time between two samples that are kept, s: below that of 100 Hz, far below a roll's."""


class PoseCoverage(enum.Enum):
    """Whether a history can answer for a span of time."""

    YES = "yes"
    NOT_YET = "not yet"
    NEVER = "never"


class PoseHistory:
    """Recent poses, interpolated linearly in between.

    Yaw, roll and pitch are interpolated each by itself, the short way round. That is no rotation at
    a constant rate, but differs from it only in the second order of the turn between two samples.
    Beyond the first and the last sample, where the pose is extrapolated, roll and pitch are those
    of that sample: a ship rolls to and fro.

    Samples of more than 100 Hz are thinned: the newest one is always there, and gives way to the
    next if it is less than `SHORTEST_PERIOD` after the one before it. `coverage` counts only those
    that stay, so that what is covered is answered to the bit as with all later samples.

    Parameters
    ----------
    min_samples : int
        The oldest samples go where there are more than this number and they are older than
        `min_span`: their number is bounded by this or ``min_span / SHORTEST_PERIOD``.
    min_span : float
        Time before the newest sample, s, for which samples are kept: a ping lasts seconds, and
        its poses are looked up as soon as the last of them is there.
    max_extrapolation : float
        Time beyond the first or last sample, s, for which the nearest two samples still answer.
    max_gap : float
        Longest time between two samples, s, that is interpolated across.
    """

    def __init__(
        self,
        min_samples: int = 10_000,
        min_span: float = 300.0,
        max_extrapolation: float = 0.0,
        max_gap: float = math.inf,
    ) -> None:
        self.max_extrapolation = max_extrapolation
        self.max_gap = max_gap
        self._min_samples = min_samples
        self._min_span = min_span
        self._samples: list[PoseSample] = []
        self._late: list[PoseSample] = []
        self._late_since = math.nan

    def __len__(self) -> int:
        """Number of samples held."""
        return len(self._samples)

    def add(self, sample: PoseSample) -> bool:
        """Add a sample; returns False, and does not use it, if it is not later than the last one.

        Those that follow one another so, with none later in between, are kept for `start_over`.
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

    def _keep(self, samples: list[PoseSample], newest: PoseSample) -> None:
        del samples[_settled(samples) :]
        samples.append(newest)
        old = bisect_left(samples, newest.stamp - self._min_span, key=_stamp)
        del samples[: min(old, max(len(samples) - self._min_samples, 0))]

    @property
    def late_span(self) -> float:
        """Time from the first to the last of the samples kept for `start_over`, s."""
        return self._late[-1].stamp - self._late_since if self._late else 0.0

    def start_over(self) -> None:
        """Put the samples that came late one after the other, if any, in place of all before."""
        self._samples, self._late = self._late, self._samples
        self._late.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._samples.clear()
        self._late.clear()

    @property
    def last_stamp(self) -> float | None:
        """Stamp of the newest sample, s."""
        return self._samples[-1].stamp if self._samples else None

    def coverage(self, first: float, last: float) -> PoseCoverage:
        """Whether poses from `first` to `last` (s) can be given, now or with later samples."""
        if not self._samples:
            return PoseCoverage.NOT_YET
        if first < self._samples[0].stamp - self.max_extrapolation:
            return PoseCoverage.NEVER
        settled = _settled(self._samples)
        if last > self._samples[settled - 1].stamp:
            return PoseCoverage.NOT_YET
        if first < self._samples[0].stamp and settled < 2:
            return PoseCoverage.NOT_YET
        stamps = np.array([sample.stamp for sample in self._bracket(first, last)])
        begin = max(int(np.searchsorted(stamps, first, side="right")) - 1, 0)
        inside = stamps[begin : int(np.searchsorted(stamps, last)) + 1]
        return PoseCoverage.NEVER if (np.diff(inside) > self.max_gap).any() else PoseCoverage.YES

    def can_extrapolate(self, last: float) -> bool:
        """Whether `last` (s) is beyond the newest sample by no more than what is allowed."""
        return bool(self._samples) and last <= self._samples[-1].stamp + self.max_extrapolation

    def poses(self, times: FloatArray) -> FloatArray:
        """Poses at the given times.

        Parameters
        ----------
        times : (n,) ndarray
            s.

        Returns
        -------
        (n, 3) ndarray
            x, y, yaw.

        Raises
        ------
        ValueError
            If a time is beyond what the history covers and may extrapolate.
        """
        return self.poses_with_attitude(times)[:, :3]

    def poses_with_attitude(self, times: FloatArray) -> FloatArray:
        """As `poses`, with the attitude: x, y, yaw, roll, pitch, (n, 5)."""
        times = np.asarray(times, float)
        if len(times) == 0:
            return np.zeros((0, 5))
        samples = self._around(float(times.min()), float(times.max()))
        stamps = np.array([sample.stamp for sample in samples])
        values = np.array([(one.x, one.y, one.yaw, one.roll, one.pitch) for one in samples])
        values[:, 2:] = np.unwrap(values[:, 2:], axis=0)
        if len(samples) == 1:
            poses = np.repeat(values, len(times), axis=0)
        else:
            # At a sample's own stamp the one before it counts, which is there: the next may not be.
            left = np.clip(np.searchsorted(stamps, times) - 1, 0, len(stamps) - 2)
            step = (stamps[left + 1] - stamps[left])[:, None]
            share = np.repeat((times - stamps[left])[:, None] / step, 5, axis=1)
            share[:, 3:] = share[:, 3:].clip(0.0, 1.0)
            poses = values[left] + share * (values[left + 1] - values[left])
        newest = self._samples[-1]
        beyond = times > newest.stamp
        if newest.rates is not None and beyond.any():
            ahead = (times[beyond] - newest.stamp)[:, None]
            carried = values[-1, :3] + ahead * np.array(newest.rates)
            poses[beyond, :3] = np.where(np.isnan(carried), poses[beyond, :3], carried)
        return poses

    def rates(self, times: FloatArray, last: float) -> FloatArray:
        """Velocities and rates of the yaw at the given times, in the fixed frame.

        The samples' own rates, interpolated linearly; beyond the newest sample those it has. Where
        they are unknown, the difference of the poses over the `RATE_SPAN` around a time: less where
        the history begins or had a gap before, and moved back so that it ends at the first sample
        at or after `last`. That sample and those before it are all that is used: what comes later
        changes nothing of what is covered up to `last`.

        A source's own rates are mostly far better: white errors of sigma in the positions leave
        ``sigma sqrt(2) / RATE_SPAN`` in each component of the velocity, 0.7 m/s of 1 m. Moved back
        by up to half the span, the difference is as old.

        Parameters
        ----------
        times : (n,) ndarray
            s, at most `last`.
        last : float
            End of the span of time that is covered, s.

        Returns
        -------
        (n, 3) ndarray
            vx, vy in m/s and rad/s; nan where they are unknown and there are poses for less than
            `SHORTEST_RATE_SPAN`.
        """
        times = np.asarray(times, float)
        if not self._samples or not times.size:
            return np.full((len(times), 3), np.nan)
        newest = self._samples[-1].stamp
        samples = self._bracket(min(float(times.min()), newest) - RATE_SPAN, last)
        stamps = np.array([sample.stamp for sample in samples])
        right = np.searchsorted(stamps, times).clip(max=len(stamps) - 1)
        left = (right - 1).clip(min=0)
        given = np.array([sample.rates or (np.nan,) * 3 for sample in samples])
        step = stamps[right] - stamps[left]
        share = np.divide(times - stamps[left], step, out=np.ones(len(times)), where=step > 0)
        own = given[left] + share.clip(0.0, 1.0)[:, None] * (given[right] - given[left])
        unknown = np.isnan(own)
        if not unknown.any():
            return own
        return np.where(unknown, self._differences(samples, stamps, times, last), own)

    def _differences(
        self, samples: list[PoseSample], stamps: FloatArray, times: FloatArray, last: float
    ) -> FloatArray:
        """Rates by the poses at the ends of a span around each time; nan where it is too short."""
        final = min(int(np.searchsorted(stamps, last)), len(stamps) - 1)
        after_gap = np.diff(stamps, prepend=stamps[0]) > self.max_gap
        since = np.maximum.accumulate(np.where(after_gap, stamps, stamps[0]))
        end = np.minimum(times + 0.5 * RATE_SPAN, stamps[final])
        right = np.searchsorted(stamps, times).clip(max=final)
        begin = np.maximum(end - RATE_SPAN, since[right])
        yaws = np.unwrap([sample.yaw for sample in samples])
        changes = [
            np.interp(end, stamps, along) - np.interp(begin, stamps, along)
            for along in ([sample.x for sample in samples], [sample.y for sample in samples], yaws)
        ]
        span = end - begin
        span[span < SHORTEST_RATE_SPAN] = np.nan
        return np.stack(changes, axis=-1) / span[:, None]

    def covariance(self, time: float) -> FloatArray | None:
        """Pose covariance of the sample nearest to a time (s); None if unknown."""
        if not self._samples:
            return None
        return min(self._around(time, time), key=lambda s: abs(s.stamp - time)).covariance

    def _around(self, first: float, last: float) -> list[PoseSample]:
        """The samples around a span of time that is covered."""
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
    """Number of samples that stay: all but a newest one too close to the one before it."""
    close = len(samples) > 1 and samples[-1].stamp - samples[-2].stamp < SHORTEST_PERIOD
    return len(samples) - close


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
    """Sensor poses that place echoes received by a moving, turning sensor.

    An echo leaves at t0 = stamp + transmit_offset and arrives at t1, and its position is valid
    halfway, at stamp + time_offset. Its azimuth was measured against the heading at t1, its range
    r is the mean of both legs. With u the line of sight, the leg back is
    ``r - u.(s(t1) - s(t0)) / 2`` to first order, so the target is at distance r along u from
    ``s(t1) - u u.(s(t1) - s(t0)) / 2``, with the yaw at t1.

    Parameters
    ----------
    poses_at : callable
        Gives the sensor's poses (x, y, yaw), (m, 3), at m times, such as `PoseHistory.poses`.
    stamp : float
        Start of transmit, s.
    time_offset : (n,) ndarray or None
        Time after `stamp` for which each position is valid, s; None: 0 for all.
    azimuth : (n,) ndarray
        rad, sensor frame.
    transmit_offset : (n,) ndarray, optional
        Time after `stamp` at which each ping left, s; 0 if not given.
    heading : bool, optional
        False where the azimuths count from the fixed frame's x axis already: the yaw is then 0.

    Returns
    -------
    (3,) or (n, 3) ndarray
        One pose for the scan where there are no time offsets, else one per detection.
    """
    turned = 1.0 if heading else 0.0
    delay = np.zeros(1) if transmit_offset is None else transmit_offset
    if time_offset is None or not time_offset.any():
        return poses_at(np.array([stamp]))[0] * [1.0, 1.0, turned]
    sent = poses_at(stamp + delay)
    poses = poses_at(stamp + 2.0 * time_offset - delay) * [1.0, 1.0, turned]
    sight = np.stack([np.cos(azimuth + poses[:, 2]), np.sin(azimuth + poses[:, 2])], axis=1)
    moved = ((poses[:, :2] - sent[:, :2]) * sight).sum(axis=1, keepdims=True)
    poses[:, :2] -= 0.5 * moved * sight
    return poses
