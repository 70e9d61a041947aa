"""Strengths of simulated echoes: laws of clutter, texture, and fluctuating targets.

Strengths are powers; clutter's have the mean 1. The echo of a target of the mean power r (its
signal-to-clutter ratio) interferes with the clutter C in its cell::

    |sqrt(P) + sqrt(C) exp(i phi)|^2

In Rayleigh clutter a Swerling I target is exponential of mean 1 + r, a steady one Rician.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv, ndtr

from tsepm_ros.numerics.arrays import FloatArray

LAWS = ("rayleigh", "k", "log_normal")
FLUCTUATIONS = ("swerling_1", "swerling_3", "steady")
WAVES = 256
"""Waves of which a texture is the sum."""


@dataclass(frozen=True)
class TargetStrength:
    """Strength of a target's echoes.

    Attributes
    ----------
    ratio_db : float
        Mean signal-to-clutter ratio, dB.
    fluctuation : str
        From ping to ping: swerling_1 (exponential), swerling_3 (chi-square of four degrees of
        freedom) or steady.
    """

    ratio_db: float
    fluctuation: str = "swerling_1"

    def __post_init__(self) -> None:
        if not -100.0 <= self.ratio_db <= 100.0:
            raise ValueError(f"ratio_db must be from -100 to 100; got {self.ratio_db!r}")
        if self.fluctuation not in FLUCTUATIONS:
            raise ValueError(
                f"fluctuation must be one of {', '.join(FLUCTUATIONS)}; got {self.fluctuation!r}"
            )


@dataclass(frozen=True)
class ClutterStrength:
    """Law of the strength of clutter.

    Attributes
    ----------
    law : str
        rayleigh (exponential power), k or log_normal.
    shape : float
        Shape of the gamma texture of k; standard deviation of ln(strength) of log_normal.
    texture_length, texture_time : float
        Distance (m) and time (s) over which the texture of k, or the strength of log_normal, is
        common to detections; 0 m: each has its own. The correlation falls with the distance d and
        the time t by ``exp(-(d / length)^2 / 2 - t / time)``.
    """

    law: str = "rayleigh"
    shape: float = 1.0
    texture_length: float = 0.0
    texture_time: float = 600.0

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise ValueError(f"law must be one of {', '.join(LAWS)}; got {self.law!r}")
        if not 0.01 <= self.shape <= 100.0:
            raise ValueError(f"shape must be from 0.01 to 100; got {self.shape!r}")
        if not 0.0 <= self.texture_length <= 1e6 or not 0.0 < self.texture_time <= 1e9:
            raise ValueError(
                "texture_length must be from 0 to 1e6 m and texture_time above 0 s, to 1e9; got "
                f"{self.texture_length!r} and {self.texture_time!r}"
            )


class Strengths:
    """Draws the strengths of a run.

    Parameters
    ----------
    clutter : ClutterStrength
    targets : sequence of TargetStrength or None
        Of each target; without it a target's strength is not measured.
    rng : numpy.random.Generator
    """

    def __init__(
        self,
        clutter: ClutterStrength,
        targets: list[TargetStrength | None],
        rng: np.random.Generator,
    ) -> None:
        self._clutter = clutter
        self._targets = targets
        self._rng = rng
        # A sum of many waves is a Gaussian field; its spectrum gives the correlation.
        length = clutter.texture_length or 1.0
        self._wave_numbers = rng.standard_normal((WAVES, 2)) / length
        self._rates = rng.standard_cauchy(WAVES) / clutter.texture_time
        self._phases = rng.uniform(0.0, 2.0 * math.pi, WAVES)

    def draw(self, position: FloatArray, origin: np.ndarray, time: float) -> FloatArray:
        """Strengths of a scan's detections, (n,); nan of targets without a strength.

        Parameters
        ----------
        position : (n, 2) ndarray
            In the fixed frame, m.
        origin : (n,) ndarray of int
            Target of each; negative for clutter.
        time : float
            After the start, s.
        """
        strength = self._clutter_strength(position, time)
        n = len(strength)
        exponential = self._rng.exponential(size=(2, n))
        phase = self._rng.uniform(0.0, 2.0 * math.pi, n)
        for row in np.flatnonzero(origin >= 0):
            target = self._targets[origin[row]]
            if target is None:
                strength[row] = math.nan
                continue
            power = 10.0 ** (target.ratio_db / 10.0)
            if target.fluctuation == "swerling_1":
                power *= exponential[0, row]
            elif target.fluctuation == "swerling_3":
                power *= 0.5 * exponential[:, row].sum()
            cross = 2.0 * math.sqrt(power * strength[row]) * math.cos(phase[row])
            strength[row] += power + cross
        return strength

    def _clutter_strength(self, position: FloatArray, time: float) -> FloatArray:
        """Strength of clutter at positions (n, 2), of mean 1, (n,)."""
        clutter, n = self._clutter, len(position)
        speckle = self._rng.exponential(size=n)
        normal = self._rng.standard_normal(n)
        if clutter.texture_length:
            normal = self._field(position, time)
        if clutter.law == "k":
            share = np.clip(ndtr(normal), 1e-300, 1.0 - 1e-16)
            return np.asarray(speckle * gammaincinv(clutter.shape, share) / clutter.shape)
        if clutter.law == "log_normal":
            return np.asarray(np.exp(clutter.shape * normal - 0.5 * clutter.shape**2))
        return speckle

    def _field(self, position: FloatArray, time: float) -> FloatArray:
        """The standard Gaussian field at positions (n, 2) and a time, (n,)."""
        phase = position @ self._wave_numbers.T + self._rates * time + self._phases
        return np.asarray(math.sqrt(2.0 / WAVES) * np.cos(phase).sum(axis=1))
