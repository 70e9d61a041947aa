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
"""Alignment of echoes with own ship's motion: the set-up under which what stands stays in place.

An echo at range r and azimuth a, at a time t, is in the fixed frame at::

    way p(t + clock) + range_scale |flipped ends - r| exp(i (sense psi(t + clock) + yaw + k a))

with the sensor's position p, a complex number, its heading psi, and the sum `ends` of the nearest
and the farthest range. Of a right set-up yaw, clock and flipped are 0, and way, range_scale, sense
and the azimuth scale k are 1. What stands has one place: under the true set-up echoes fall where
others fall in whatever scans had that place in view. The occupancy of a place is the share of these
scans; scans near in time, or from nearly the same position, do not count. The evidence that an echo
stands is the square of the occupancy of its place. Boats that move along with own ship have one
place if way is 0; of a convoy in line, one comes to where another was.

Of each set-up, a right one too, all continuous parameters are fitted together: those that are not
its error may be off by what sonars and compasses have of their own, `LEAST`, half of which is a
standard deviation, as slant ranges and the tilt of a sonar look like small errors of them all.

Errors of continuous parameters are those of an M-estimator with Welsch's loss on the differences of
places: ``A^-1 (B + n^2 L) A^-1``, ``A = H + n L``, with its curvature H, the scatter B of the
gradients over scans, or over places where that is larger, and the inverse variances L of what is
held. An echo counts n times in H, in its pairs, and so L does.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray

ComplexArray = NDArray[np.complex128]
YAW, CLOCK, AZIMUTH_SCALE, RANGE_SCALE, FLIPPED, SENSE, WAY = range(7)
AS_IS = np.array([0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0])
"""Parameters of a set-up, rad, s, and five numbers, and those of a right one. The first four are
continuous."""
LIMITS = np.array([[-math.inf, -2.0, 0.4, 0.22], [math.inf, 2.0, 2.5, 4.5]])
"""Least and greatest continuous parameters that are tried."""
LEAST = np.array([math.radians(3.0), 0.1, 0.1, 0.1])
"""Smallest errors of these that are said, with at most half of this as standard deviation: sonars
and compasses have smaller ones of their own."""
INFLATED, REACH = 1.25, 3.0
"""Deviations of a kernel in those that are stated, which may be too small; and its reach in its."""
APART, AWAY, AWAY_SHARE = 4, 5.0, 0.2
"""Scans between two echoes of one place, at least, and the sensor's way between them, in standard
deviations of an echo, or in all of its way if that is short: a boat as fast is elsewhere then."""
LEAST_SCANS = 3
"""Scans that have a place in view, at least, for its occupancy."""
RATE_STEP = 0.1
"""Half of the time over which own ship's rates are taken, s."""
ROUGH, SIDE, SMEAR = 200, 4.0, 0.04
"""Echoes that a search over many set-ups uses, at most; side of its cells, in standard deviations
of an echo, and in the length that the sensor has moved, which a step of yaw turns."""
CROWDED = 0.75
"""A fit begins where echoes gather so much as under the best of all set-ups, or else as it is."""
WIDER = 3.0, 1.5, 1.0
"""Widths of the kernels in the steps of a fit."""
CLEAR, BETTER, MATERIAL = 5.0, 4.0, 1.2
"""Standard deviations of a gain from which on a set-up is better than that as it is, and than
another; of a step, from which on a parameter is not as it should be. Evidence of another set-up in
that of the one as it is, from which on it is more than slant ranges and a tilt leave."""
PLACE, PLACES = 8.0, 2.0
"""Side of a place in standard deviations of an echo; places over which a gain is spread, at least.
"""
WORTH = 0.5
"""Deviations of an echo by which places move with a parameter that is not as it should be."""
REGULAR, CHANCE = 0.3, 2.0
"""Occupancy of the places where echoes recur, weighted by itself, from which on things stand: that
of things that half of the scans detect, as their errors leave 0.6 of it. And their evidence in that
of the same echoes in the order of chance: clutter recurs where a set-up crowds it together."""
RIGHT, UNKNOWN, UNCLEAR = "right", "unknown", "unclear"
CLOCKWISE = "compass"
"""An error of a sense and a yaw: where this is no usual one, it is named if none of the others
explains the echoes. Until own ship turns, it looks like a yaw alone."""
_MIRRORED = np.array([0.0, 0.0, -1.0, 1.0, 0.0, 1.0, 1.0])
_COMPASS = np.array([0.5 * math.pi, 0.0, 1.0, 1.0, 0.0, -1.0, 1.0])
_CONVOY = np.array([0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0])
_YAWS = np.radians(np.arange(-180.0, 180.0, 10.0))[:, None]
KINDS: tuple[tuple[str, FloatArray, int, FloatArray], ...] = (
    ("clock", AS_IS, CLOCK, np.linspace(-2.0, 2.0, 17)[:, None]),
    ("azimuth_scale", AS_IS, AZIMUTH_SCALE, np.geomspace(0.4, 2.5, 13)[:, None]),
    ("mirrored", _MIRRORED, -1, np.ones((1, 1))),
    ("reversed", np.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0]), -1, np.ones((1, 1))),
    ("yaw", AS_IS, YAW, _YAWS),
    ("range_scale", AS_IS, RANGE_SCALE, np.geomspace(0.22, 4.5, 19)[:, None]),
    (CLOCKWISE, _MIRRORED, YAW, _YAWS),
    (CLOCKWISE, _COMPASS, YAW, _YAWS),
)
"""Errors: name, set-up, its parameter (none: way) and the values of this that are tried."""
BY_TURNS = 3
"""The first of these show as the sensor turns, the others as it moves on only."""
SEEN = 6.0
"""Standard deviations of an echo by which places move, at least, as the sensor turns or moves."""


class Fit(NamedTuple):
    """A set-up that was fitted.

    Attributes
    ----------
    kind : str
        `RIGHT`, a name of `KINDS`, `UNKNOWN` or `UNCLEAR`.
    set_up : (7,) ndarray
    parameter : int
        Index of the parameter that was fitted; none: -1.
    error : float
        Its standard deviation.
    evidence : (n,) ndarray
        Of each echo, that it stands.
    """

    kind: str
    set_up: FloatArray
    parameter: int
    error: float
    evidence: FloatArray

    @property
    def off(self) -> float:
        """Difference of the parameter from a right set-up's."""
        return float(self.set_up[self.parameter] - AS_IS[self.parameter])

    @property
    def differs(self) -> bool:
        """Whether it is another set-up than a right one, for its error and for those that occur."""
        at, backward = self.parameter, self.set_up[[AZIMUTH_SCALE, SENSE]].min() < 0.0
        return bool(at < 0 or backward) or abs(self.off) > max(LEAST[at], BETTER * self.error)

    @property
    def total(self) -> float:
        """The sum of the evidence."""
        return float(self.evidence.sum())

    @property
    def regular(self) -> bool:
        """Whether things stand where echoes recur."""
        return self.total > REGULAR * float(np.sqrt(self.evidence).sum())


class Looks(NamedTuple):
    """Echoes of several scans, and the sensor's poses.

    Attributes
    ----------
    time, range, azimuth : (n,) ndarray
        Time of arrival, s, range, m, and azimuth, rad, of each echo.
    along, turn : (n,) ndarray
        Standard deviations of range, m, and azimuth, rad.
    scan : (n,) ndarray
        Number of its scan, from 0 on, ascending.
    ends : float
        Sum of the sensor's nearest and farthest range, m.
    known : (4, k) ndarray
        Times, ascending, and the sensor's x, y and yaw, which is unwrapped.
    mounting : float
        Part of this yaw that is the mounting's, rad, if it is known.
    """

    time: FloatArray
    range: FloatArray
    azimuth: FloatArray
    along: FloatArray
    turn: FloatArray
    scan: IntArray
    ends: float
    known: FloatArray
    mounting: float = 0.0

    @property
    def moved(self) -> float:
        """How far places move as the sensor turns and moves, in standard deviations of an echo."""
        _, yaw = self.poses(self.time)
        return float(np.ptp(yaw) * np.median(self.range) / self.sigma) + self.way

    @property
    def way(self) -> float:
        """How far the sensor moves, in standard deviations of an echo."""
        position, _ = self.poses(self.time)
        return float(np.abs(position - position[0]).max()) / self.sigma

    @property
    def sigma(self) -> float:
        """Standard deviation of the place of an echo, the median, m."""
        return float(np.median(np.maximum(self.along, self.turn * self.range)))

    def poses(self, time: FloatArray) -> tuple[ComplexArray, FloatArray]:
        """Positions and yaws of the sensor at times, s."""
        x, y, yaw = (np.interp(time, self.known[0], row) for row in self.known[1:])
        return x + 1j * y, yaw

    def apart(self) -> BoolArray:
        """Which scans (s, s) are compared."""
        number = np.arange(self.scan[-1] + 1)
        position, _ = self.poses(self.time[np.searchsorted(self.scan, number)])
        way = np.abs(position[:, None] - position)
        least = min(AWAY * self.sigma, AWAY_SHARE * float(way.max()))
        return (np.abs(number[:, None] - number) >= APART) & (way >= least)

    def arms(self, set_ups: FloatArray) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """Positions of the sensor under set-ups (..., 7), vectors to the echoes, and its yaws."""
        of = set_ups[..., None, :]
        position, yaw = self.poses(self.time + of[..., CLOCK])
        angle = of[..., SENSE] * yaw + of[..., YAW] + of[..., AZIMUTH_SCALE] * self.azimuth
        range_ = of[..., RANGE_SCALE] * np.abs(of[..., FLIPPED] * self.ends - self.range)
        return of[..., WAY] * position, range_ * np.exp(1j * angle), yaw

    def cells(self, set_up: FloatArray) -> IntArray:
        """Numbers (n,) of the places where the echoes are under a set-up."""
        position, arm, _ = self.arms(set_up)
        side = PLACE * self.sigma * set_up[RANGE_SCALE]
        return np.unique(((position + arm) / side).round(), return_inverse=True)[1]

    def pairs(
        self, place: ComplexArray, arm: ComplexArray, scale: float, wider: float = 1.0
    ) -> tuple[IntArray, IntArray, ComplexArray, FloatArray]:
        """Pairs of near echoes of scans apart: both, their difference, and its variance."""
        sigma = wider * INFLATED * np.maximum(self.along * scale, self.turn * np.abs(arm))
        reach = REACH * math.sqrt(2.0) * float(np.median(sigma))
        tree = KDTree(np.stack([place.real, place.imag], axis=1))
        pairs = tree.query_pairs(reach, output_type="ndarray")
        first, second = pairs[self.apart()[tuple(self.scan[pairs].T)]].T
        return first, second, place[first] - place[second], sigma[first] ** 2 + sigma[second] ** 2

    def crowding(self, set_ups: FloatArray) -> FloatArray:
        """How much the echoes gather in cells under each of many set-ups (h, 7)."""
        some = slice(None, None, 1 + len(self.time) // ROUGH)
        of_echoes = ("time", "range", "azimuth", "scan")
        looks = self._replace(**{name: getattr(self, name)[some] for name in of_echoes})
        position, arm, _ = looks.arms(set_ups)
        place = (position + arm) / set_ups[:, RANGE_SCALE, None]
        place -= place.real.min() + 1j * place.imag.min()
        place /= self.sigma * max(SIDE, SMEAR * self.way)
        number = np.arange(len(set_ups))[:, None]
        key = number << 45 | place.real.astype(int) << 25 | place.imag.astype(int) << 5
        seen = np.unique(key | looks.scan // APART)
        cell, times = np.unique(seen >> 5, return_counts=True)
        return np.bincount(cell >> 40, times * np.log(times), len(set_ups)).astype(float)

    def evidence(self, set_up: FloatArray) -> FloatArray:
        """Evidence (n,) that an echo stands, 0 where few other scans had its place in view."""
        position, arm, yaw = self.arms(set_up)
        first, second, apart, variance = self.pairs(position + arm, arm, set_up[RANGE_SCALE])
        kernel = np.tile(np.exp(-0.5 * np.abs(apart) ** 2 / variance), 2)
        view = self.apart()[self.scan]
        begin = np.searchsorted(self.scan, np.arange(view.shape[1]))
        line = (position + arm)[:, None] - position[begin]
        range_ = np.abs(set_up[FLIPPED] * self.ends - np.abs(line) / set_up[RANGE_SCALE])
        angle = np.angle(line * np.exp(-1j * (set_up[SENSE] * yaw[begin] + set_up[YAW])))
        for value, known in ((range_, self.range), (angle / set_up[AZIMUTH_SCALE], self.azimuth)):
            view &= (value >= known.min()) & (value <= known.max())
        cell = np.concatenate([first, second]) * view.shape[1] + self.scan[[*second, *first]]
        seen = np.bincount(cell, kernel, view.size).reshape(view.shape).clip(max=1.0)
        number = view.sum(axis=1)
        share = (seen * view).sum(axis=1) / np.maximum(number, 1)
        return np.where(number >= LEAST_SCANS, share, 0.0) ** 2

    def step(
        self, set_up: FloatArray, at: int, near: FloatArray, wider: float = 1.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Joint steps (4,) of the continuous parameters to the least loss.

        All but that of index `at` are held near to those of another set-up, by `LEAST`.

        Returns
        -------
        step, error : (4,) ndarray
            And its standard deviation, in which what is not known of the others has its part.
        rate : (4,) ndarray
            Root mean square by which places move apart with a parameter, in deviations of an echo.
        """
        around = np.linspace(-RATE_STEP, RATE_STEP, 3)[:, None] * np.eye(7)[CLOCK]
        position, arms, _ = self.arms(set_up + around)
        places, arm, scale = position + arms, arms[1], set_up[RANGE_SCALE]
        rate = (places[2] - places[0]) / (2.0 * RATE_STEP)
        by = np.stack([1j * arm, rate, 1j * arm * self.azimuth, arm / scale])
        first, second, apart, variance = self.pairs(places[1], arm, scale, wider)
        by = by[:, first] - by[:, second]
        kernel = np.exp(-0.5 * np.abs(apart) ** 2 / variance)
        along = (by.conj() * apart).real
        slope = kernel / variance * along
        bend = (kernel / variance * by.conj() @ by.T).real + 1e-12 * np.eye(4)
        length = np.diag(bend)
        times = 1.0 + 2.0 * kernel.sum() / len(arm)  # that an echo counts, in its pairs
        held = np.where(np.arange(4) == at, 0.0, times * (0.5 * LEAST) ** -2)
        steep = np.maximum(1.0 - (kernel * (along / variance) ** 2).sum(axis=1) / length, 0.1)
        inverse = np.linalg.inv(bend * np.sqrt(np.outer(steep, steep)) + np.diag(held))
        errors = []
        for ends in ((self.scan[first], self.scan[second]), (self.cells(set_up)[first],)):
            parts = np.array(
                [sum(np.bincount(end, row, len(arm)) for end in ends) for row in slope]
            )
            number = np.abs(parts).sum(axis=1) ** 2 / ((parts**2).sum(axis=1) + 1e-12)
            parts = parts * np.sqrt(number / np.maximum(number - 1.0, 0.5))[:, None]
            errors.append(np.diag(inverse @ (parts @ parts.T + np.diag(times * held)) @ inverse))
        moves = INFLATED * wider * np.sqrt(length / (kernel.sum() + 1e-12))
        pull = held * (near - set_up)[:4] - slope.sum(axis=1)
        return np.linalg.solve(bend + np.diag(held), pull), np.sqrt(np.maximum(*errors)), moves

    def wrong(self, fit: Fit) -> bool:
        """Whether a continuous parameter is still not as it should be."""
        step, error, rate = np.abs(self.step(fit.set_up, fit.parameter, fit.set_up))
        return bool(((step > BETTER * error) & (step * rate > WORTH)).any())

    def usual(self, fit: Fit) -> bool:
        """Whether a heading, if clockwise, is a compass's, a negated one, or that of NED."""
        off = fit.set_up[YAW] + 2.0 * fit.set_up[SENSE] * self.mounting - [0.0, _COMPASS[YAW]]
        return fit.kind != CLOCKWISE or bool((np.abs(np.exp(1j * off) - 1.0) < LEAST[YAW]).any())

    def refined(self, kind: str, set_up: FloatArray, at: int = -1) -> Fit:
        """A set-up of a kind with a parameter at the least loss near to it.

        The other continuous ones may be off by what sonars and compasses have of their own.
        """
        best, errors, free = set_up.copy(), np.zeros(4), np.arange(4) == at
        limits = np.where(free, LIMITS, set_up[:4] + np.outer([-1.0, 1.0], LEAST))
        for wider in WIDER:
            step, errors, _ = self.step(best, at, set_up, wider)
            best[:4] = np.clip(best[:4] + step, *limits)
        return Fit(kind, best, at, float(errors @ free), self.evidence(best))

    def gain(
        self,
        fit: Fit,
        other: Fit,
        least: float = BETTER,
        places: float = PLACES,
        along: FloatArray | float = 0.0,
    ) -> bool:
        """Whether a fit is better than another: certainly, and in several places.

        So it must be of the echoes, too, that do not move along with own ship: of evidence `along`.
        """
        floor, cell = np.outer([0.0, 1.0], along), self.cells(fit.set_up)
        gain = np.maximum(fit.evidence, floor) - np.maximum(other.evidence, floor)
        of_places = np.array([np.bincount(cell, row) for row in gain])
        squares = least**2 * (gain**2).sum(axis=1), places * (of_places**2).sum(axis=1)
        return bool((gain.sum(axis=1) > np.sqrt(squares)).all())

    def fits(self) -> list[Fit]:
        """Fits of the set-up as it is, and of those under which things stand."""
        kinds = KINDS if self.way > SEEN else KINDS[:BY_TURNS]
        tried = [np.where(np.arange(7) == at, values, base) for _, base, at, values in kinds]
        as_is, *crowding = self.crowding(np.concatenate([AS_IS[None], *tried]))
        enough, ends = max(as_is, CROWDED * max(crowding)), np.cumsum([*map(len, tried)])
        found = [
            self.refined(kind, rows[gathered.argmax()] if gathered.max() > enough else base, at)
            for (kind, base, at, _), rows, gathered in zip(
                kinds, tried, np.split(crowding, ends[:-1]), strict=True
            )
        ]
        mixed = np.random.default_rng(1).permutation(np.transpose(self[1:5])).T
        by_chance = self._replace(**dict(zip(self._fields[1:5], mixed, strict=True))).evidence
        return [
            self.refined(RIGHT, AS_IS),
            *(
                fit
                for fit in found
                if fit.regular and fit.differs and fit.total > CHANCE * by_chance(fit.set_up).sum()
            ),
        ]

    def explanation(self) -> Fit:
        """The set-up that explains the echoes.

        Returns
        -------
        Fit
            Of an error of `KINDS`, or `RIGHT`; `UNKNOWN` where things stand under another set-up
            than that as it is, but no error alone explains them as a right set-up would; `UNCLEAR`
            where the echoes do not tell.
        """
        as_is, *rest = self.fits()
        better = partial(self.gain, along=self.evidence(_CONVOY))
        top = max(rest, key=lambda fit: fit.total, default=as_is)
        if top.total < MATERIAL * as_is.total or not better(top, as_is, CLEAR):
            right = as_is.regular and not self.wrong(as_is)
            return as_is if right else as_is._replace(kind=UNCLEAR)
        alike = [fit for fit in rest if self.usual(fit) and not better(top, fit)] or [top]
        best, kinds = alike[0], {fit.kind for fit in alike}
        if best.error > 0.5 * LEAST[best.parameter]:
            return as_is._replace(kind=UNCLEAR)
        single = len(kinds) == 1 or kinds == {"mirrored", CLOCKWISE}  # the first says both
        clear = better(best, as_is, CLEAR) and not self.wrong(best)
        return best if single and clear else as_is._replace(kind=UNKNOWN)
