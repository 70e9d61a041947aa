"""Evidence for a target at every state of a grid, without hypotheses, gates or pruning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.conversion import major_sigma, position_covariance
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.simulation import Scenario

SIGMAS = 3.0
"""Peaks closer than this are one, and a peak this close to a target is its detection."""
WINDOW = 5.0
"""A detection counts in a scan's map out to so many sigmas."""
CREST = 9
"""Cells on each side of the square in which a peak is the highest."""
PEAK = np.dtype(
    [("evidence", float), ("position", float, (2,)), ("velocity", float, (2,)), ("sigma", float)]
)
"""Log evidence, mean position (m) and velocity (m/s), larger axis of the measurement error (m)."""


@dataclass(frozen=True)
class StateGrid:
    """Positions in the clutter box of a scenario, and velocities up to a greatest speed.

    The sensor rests at the origin, echoes come at once, and the box does not cross azimuth pi.
    Velocities are whole cells a scan, so that no map needs interpolation.

    Attributes
    ----------
    scenario : Scenario
    step : float
        Side of a cell, m.
    max_speed : float
        v_max, m/s.
    """

    scenario: Scenario
    step: float
    max_speed: float

    @cached_property
    def cells(self) -> FloatArray:
        """Centres of the (n, m) cells, (n, m, 2), m."""
        x_min, x_max, y_min, y_max = self.scenario.clutter_box
        half = 0.5 * self.step
        axes = np.arange(x_min + half, x_max, self.step), np.arange(y_min + half, y_max, self.step)
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    @cached_property
    def polar(self) -> tuple[FloatArray, FloatArray]:
        """Range (m) and azimuth (rad) of the cells, (n, m) each."""
        x, y = np.moveaxis(self.cells, -1, 0)
        return np.hypot(x, y), np.arctan2(y, x)

    @cached_property
    def sigma(self) -> FloatArray:
        """Larger axis of the measurement error at the cells, (n, m), m."""
        sensor, (distance, azimuth) = self.scenario.sensor, self.polar
        variance = sensor.range_variance(distance)
        return major_sigma(position_covariance(distance, azimuth, variance, sensor.azimuth_std))

    @cached_property
    def velocities(self) -> IntArray:
        """Velocities in the disc, (v, 2), cells a scan."""
        most = int(self.max_speed * self.scenario.period / self.step)
        square = np.mgrid[-most : most + 1, -most : most + 1].reshape(2, -1).T
        return square[np.hypot(*square.T) * self.step <= self.max_speed * self.scenario.period]

    def cell_at(self, position: FloatArray) -> IntArray:
        """Cell of a position (2,), the nearest if it is outside."""
        cell = np.round((position - self.cells[0, 0]) / self.step).astype(int)
        return np.clip(cell, 0, np.array(self.sigma.shape) - 1)

    def scan_map(self, scan: Scan) -> FloatArray:
        """Likelihood ratio of a target in each cell for one scan, (n, m).

        ``1 - p_d + p_d / lambda sum_j N(r_j; |x|, s_r^2) N(a_j; arg x, s_a^2) / r_j``: the exact
        density of the polar measurement, per m^2 as lambda is.
        """
        sensor, (ranges, azimuths) = self.scenario.sensor, self.polar
        found = np.full(ranges.shape, 1.0 - sensor.detection_probability)
        gain = sensor.detection_probability / sensor.clutter_density
        for distance, azimuth in zip(scan.range, scan.azimuth, strict=True):
            place = distance * np.array([np.cos(azimuth), np.sin(azimuth)])
            near = self._square(place, WINDOW)
            deviation = np.sqrt(sensor.range_variance(ranges[near]))
            square = ((distance - ranges[near]) / deviation) ** 2
            square += ((azimuth - azimuths[near]) / sensor.azimuth_std) ** 2
            scale = 2.0 * np.pi * deviation * sensor.azimuth_std * distance
            found[near] += gain * np.exp(-0.5 * square) / scale
        return found

    def evidence_maps(self, maps: FloatArray, *, appearing: bool) -> FloatArray:
        """Likelihood ratio of a target that ends in each cell, averaged over the velocities.

        ``E_k(x) = 1/v sum_i W_k(x; v_i)`` with ``W_k(x; v) = L_k(x) W_k-1(x - v T; v)`` and
        W_0 = 1, 0 outside the box; if it may appear at any scan, summed over these as a method
        sums over starts, ``W_k(x; v) = L_k(x) (1 + W_k-1(x - v T; v))`` and W_0 = 0.

        Parameters
        ----------
        maps : (k, n, m) ndarray
            L of each scan.
        appearing : bool
            The target may appear at any scan; otherwise it is there from the first one on.

        Returns
        -------
        (k, n, m) ndarray
            After each scan.
        """
        maps = maps.astype(np.float32)
        found = np.zeros_like(maps)
        for velocity in self.velocities:
            ratio = maps[0].copy()  # by the cell at the first scan
            for scan in range(1, len(maps)):
                begin, end = _overlap(scan * velocity, ratio.shape)
                part = ratio[begin]
                if appearing:
                    part += 1.0
                part *= maps[scan][end]
                found[scan][end] += part
        found[0] = maps[0] * len(self.velocities)
        return found / len(self.velocities)

    def summed(self, evidence: FloatArray, reach: float) -> FloatArray:
        """Log of the evidence summed over a square about each cell, (n, m).

        ``ln(lambda / p_d sum E(x) step^2)`` over |x - x_0| <= reach sigma on each axis: what a
        method sums whose starts, detections, have a ratio of 1.
        """
        sensor = self.scenario.sensor
        integral = np.pad(evidence.astype(float).cumsum(0).cumsum(1), ((1, 0), (1, 0)))
        half = np.round(reach * self.sigma / self.step).astype(int)
        row, column = np.indices(half.shape)
        low, left = np.maximum(row - half, 0), np.maximum(column - half, 0)
        high = np.minimum(row + half + 1, len(half))
        right = np.minimum(column + half + 1, half.shape[1])
        total = integral[high, right] - integral[low, right]
        total += integral[low, left] - integral[high, left]
        unit = self.step**2 * sensor.clutter_density / sensor.detection_probability
        return np.log(np.maximum(unit * total, 1e-30))

    def peaks(
        self, maps: FloatArray, evidence: FloatArray, *, reach: float, least: float, appearing: bool
    ) -> NDArray[np.void]:
        """Peaks of the summed evidence, the highest first, none within 3 sigma of a higher one.

        Parameters
        ----------
        maps : (k, n, m) ndarray
            L of the scans so far.
        evidence : (n, m) ndarray
            E after them.
        reach, least : float
            See `summed`; the lowest log evidence of a peak.
        appearing : bool
            As the evidence was made.

        Returns
        -------
        (p,) ndarray of PEAK
        """
        summed = self.summed(evidence, reach)
        # Skirts of a peak reach beyond 3 sigma: only a local maximum can be another.
        highest = maximum_filter(summed, CREST)
        rows = np.flatnonzero((summed >= least) & (summed == highest))
        rows = rows[np.argsort(-summed.flat[rows], kind="stable")]
        places = self.cells.reshape(-1, 2)
        peaks = []
        while len(rows):
            best, place = rows[0], places[rows[0]]
            position = self._mean_position(evidence, place, reach)
            velocity = self._mean_velocity(maps, self.cell_at(position), appearing)
            peaks.append((summed.flat[best], position, velocity, self.sigma.flat[best]))
            apart = np.hypot(*(places[rows] - place).T)
            rows = rows[apart > SIGMAS * self.sigma.flat[best]]
        return np.array(peaks, PEAK)

    def _mean_position(self, evidence: FloatArray, place: FloatArray, reach: float) -> FloatArray:
        near = self._square(place, reach)
        return np.average(self.cells[near].reshape(-1, 2), axis=0, weights=evidence[near].ravel())

    def _mean_velocity(self, maps: FloatArray, cell: IntArray, appearing: bool) -> FloatArray:
        """Mean velocity of what ends in a cell, (2,), m/s."""
        ratio = np.full(len(self.velocities), 0.0 if appearing else 1.0)
        for scan, one in enumerate(maps):
            then = cell - (len(maps) - 1 - scan) * self.velocities
            inside = ((then >= 0) & (then < one.shape)).all(axis=1)
            row, column = np.clip(then, 0, np.array(one.shape) - 1).T
            ratio = np.where(inside, one[row, column] * (ratio + appearing), 0.0)
        mean = np.average(self.velocities, axis=0, weights=ratio + 1e-300)
        return mean * self.step / self.scenario.period

    def _square(self, place: FloatArray, sigmas: float) -> tuple[slice, slice]:
        row, column = self.cell_at(place)
        half = round(sigmas * self.sigma[row, column] / self.step)
        return (
            slice(max(row - half, 0), row + half + 1),
            slice(max(column - half, 0), column + half + 1),
        )


def _overlap(shift: IntArray, shape: Sequence[int]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Cells from which a shift stays in the box, and where it ends."""
    begin = tuple(
        slice(max(-s, 0), max(n - max(s, 0), 0)) for s, n in zip(shift, shape, strict=True)
    )
    end = tuple(slice(max(s, 0), max(n + min(s, 0), 0)) for s, n in zip(shift, shape, strict=True))
    return begin, end
