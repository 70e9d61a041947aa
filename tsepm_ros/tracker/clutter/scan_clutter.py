"""Clutter where the detections of one scan are: as known before, and as learned from them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.tracker.clutter import amplitude
from tsepm_ros.tracker.clutter.amplitude import RINGS, ClutterAmplitudes
from tsepm_ros.tracker.clutter.amplitude_likelihood import ScanAmplitudes
from tsepm_ros.tracker.clutter.excess import Cells, HeldTargets, PredictiveDensity
from tsepm_ros.tracker.clutter.fixed_places import RISE, CellNumbers
from tsepm_ros.tracker.clutter.learned import Learned
from tsepm_ros.tracker.measurement import NAMES
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import SensorModel, View

INTENSITY = NAMES.index("intensity")
MIN_SHARE = 1e-3
"""Share of the coverage that a scan looked at, at least."""


class ScanClutter:
    """The models of clutter at the places of one scan's detections.

    Parameters
    ----------
    learned : Learned
    common : CommonOptions
    sensor : SensorModel
        As given.
    counts_echoes : bool
        Whether clutter behind targets counts, which the held tracks must be for it.
    range, azimuth : (d,) ndarray
        Of the detections or plots, m and rad.
    detections : (d,) ndarray of DETECTION, optional
        Converted; without them clutter that stays is left out.

    Attributes
    ----------
    predictive : PredictiveDensity or None
        What makes the density uncertain; None where it is given, and until `learn`.
    strengths : ClutterAmplitudes or None
        The law of strengths, where the method learns it.
    polar : tuple of ndarray
        Range and azimuth, as given.
    cells : Cells
        Of the clutter map.
    weight : (d,) ndarray
        Probability that each detection is clutter; 0 until `learn`.
    """

    def __init__(
        self,
        learned: Learned,
        common: CommonOptions,
        sensor: SensorModel,
        counts_echoes: bool,
        range: FloatArray,
        azimuth: FloatArray,
        detections: NDArray[np.void] | None = None,
    ) -> None:
        self._learned = learned
        self._estimated = common.clutter_density == "estimated"
        self._echoes = self._estimated and counts_echoes
        self._given = sensor.clutter_density
        self.polar = range, azimuth
        self._places: CellNumbers | None = None
        self._staying: FloatArray | None = None
        if self._echoes and detections is not None:
            places = detections["position"], detections["major_sigma"]
            self._places = learned.persistent.cells(*places)
            if learned.persistent.found:
                self._staying = learned.persistent.density(self._places)
        self.cells = learned.clutter_map.grid.cells(range, azimuth)
        self.weight = np.zeros(len(range))
        self.predictive: PredictiveDensity | None = None
        self.strengths: ClutterAmplitudes | None = None
        if common.intensity == "auto" and counts_echoes:
            self.strengths = learned.strengths

    @property
    def rings(self) -> Cells:
        """The cells, the map's rows divided into rings."""
        return self._learned.clutter_map.grid.divided(self.cells, self.polar[0], RINGS)

    @property
    def in_zone(self) -> BoolArray:
        """Whether each detection is in a clutter zone, (d,)."""
        return self._learned.clutter_map.in_zone(self.cells)

    def before(self, targets: Callable[[], HeldTargets]) -> FloatArray:
        """Density at each detection, (d,), 1/m^2, with the held targets as of the last scan."""
        density = self.density()
        if self._echoes:
            density *= self._learned.secondary_echoes.behind_targets(targets(), self.cells)
        return self._raised(density)

    def learn(
        self,
        stamp: float,
        view: View,
        weight: FloatArray,
        min_area: float,
        targets: Callable[[], HeldTargets],
        moving: Callable[[], IntArray],
    ) -> FloatArray:
        """Learn from the scan, and return the density at each detection after it, (d,), 1/m^2.

        Parameters
        ----------
        stamp : float
            Of the scan, s.
        view : View
            What the scan looked at.
        weight : (d,) ndarray
            Probability that each detection is clutter.
        min_area : float
            See `ClutterMap.update`.
        targets : callable
            The held targets as of this scan.
        moving : callable
            Rows of detections that are probably of held tracks that move.
        """
        learned, self.weight = self._learned, weight
        clutter_map, batch, echoes = learned.clutter_map, learned.batch, learned.secondary_echoes
        looked = clutter_map.grid.looked(view.swept)
        batch.take(self.cells, self.polar, weight, looked)
        whole = batch.is_whole(stamp) or clutter_map.young
        if whole:
            learned.learn_map(min_area)
        clutter_map.take_level(float(weight.sum()), max(float(looked.mean()), MIN_SHARE))
        density, area = self.density(), clutter_map.counted_area
        if self._echoes:
            held = targets()
            if whole:
                echoes.update(held, batch, clutter_map.expected)
            density *= echoes.among(self.cells, weight, clutter_map.expected)
            density *= echoes.behind_targets(held, self.cells)
            batch.densities.append(density)
            if whole:
                learned.clumps.update(batch, area)
            self.predictive = learned.clumps.predictive(self.cells, density, area)
        if whole:
            batch.end(stamp)
        if self._places is not None:
            learned.persistent.update(stamp, view, self._places, moving())
        return self._raised(density)

    def judge_strengths(
        self, detections: NDArray[np.void], scan_index: int, most_hits: int
    ) -> ScanAmplitudes | None:
        """What the strengths of a scan's detections say, by the scans before.

        Their exponents become the field `strength` of the detections.

        Parameters
        ----------
        detections : (d,) ndarray of DETECTION
        scan_index : int
        most_hits : int
            Hits that a path may have.

        Returns
        -------
        ScanAmplitudes or None
            None where they say nothing.
        """
        if self.strengths is None:
            return None
        judged = self.strengths.judge(
            detections["features"][:, INTENSITY],
            scan_index,
            detections["index"],
            lambda: self.rings,
            detections["position"],
        )
        if judged is None:
            return None
        detections["strength"] = judged.extrapolated
        return ScanAmplitudes.of(judged.exponent, judged.samples, most_hits)

    def learn_strengths(self, detections: NDArray[np.void], moved: float) -> None:
        """Learn the law of the strengths of clutter from the scan that was judged.

        Parameters
        ----------
        detections : (d,) ndarray of DETECTION
        moved : float
            Distance that a target moves at most from scan to scan, m.
        """
        if self.strengths is None:
            return
        sigma, error = np.sort(detections["major_sigma"]), 0.0
        if len(sigma):  # three times the median
            error = 1.5 * float(sigma[(len(sigma) - 1) // 2] + sigma[len(sigma) // 2])
        reach = moved * np.arange(amplitude.LAGS + 1.0) + math.sqrt(2.0) * error
        self.strengths.update(self.weight, (amplitude.LAGS + 1.0) * moved + error, reach)

    def withdraw(self, share: FloatArray) -> None:
        """Take back a share of each detection (d,): that of a target after all."""
        taken = self.weight * share
        self.weight -= taken  # in place, also in the batch
        if not self._learned.batch.weights:  # else it is learned from with its batch
            self._learned.clutter_map.withdraw(self.cells, taken)

    @property
    def is_persistent(self) -> BoolArray:
        """Whether each detection is where clutter stays and the map does not show it, (d,)."""
        if self._staying is None:
            return np.zeros(len(self.weight), bool)
        return np.asarray(self._staying > RISE * self.density())

    def _raised(self, density: FloatArray) -> FloatArray:
        """Density (d,), raised where clutter stays."""
        if self._staying is None:
            return density
        return np.where(self._staying > RISE * density, self._staying, density)

    def density(self) -> FloatArray:
        """Density of the map, (d,), 1/m^2."""
        if not self._estimated:
            return np.full(len(self.weight), self._given)
        if not len(self.weight):
            return np.zeros(0)
        return self._learned.clutter_map.at(self.cells)
