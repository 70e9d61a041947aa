"""Polynomials in time fitted to the hits of tracks, and their predictions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.conversion import major_sigma


@dataclass(frozen=True, eq=False)
class Polynomials:
    """Polynomials fitted to the hits of n tracks by least squares.

    At the time t, with ``s = (t - reference) / scale`` of the track, the position is
    ``sum_k s^k c_k``; the coefficients ``c_k = sum_i A_ki z_i`` have the covariances
    ``C_kl = sum_i A_ki A_li R_i``.

    Attributes
    ----------
    reference : float
        Time, s.
    scale : (n,) ndarray
        s.
    last_time : (n,) ndarray
        Time of the last hit, s.
    coefficients : (n, k, 2) ndarray
        c, m.
    covariance : (n, k, k, 2, 2) ndarray
        C, m^2.
    """

    reference: float
    scale: FloatArray
    last_time: FloatArray
    coefficients: FloatArray
    covariance: FloatArray

    @classmethod
    def fitted(cls, hits: NDArray[np.void], reference: float, degree: int) -> Polynomials:
        """Fit hits (n, m) of DETECTION, by the minimum norm where their times leave it open."""
        interval = hits["time"] - reference
        scale = np.abs(interval).max(axis=1)
        scale[scale == 0.0] = 1.0
        powers = (interval / scale[:, None])[..., None] ** np.arange(degree + 1)
        weights = np.linalg.pinv(powers)  # (n, k, m)
        return cls(
            reference,
            scale,
            hits["time"][:, -1],
            weights @ hits["position"],
            np.einsum("nki,nli,nipq->nklpq", weights, weights, hits["covariance"], optimize=True),
        )

    def __len__(self) -> int:
        """Number of tracks."""
        return len(self.scale)

    @property
    def degree(self) -> int:
        """Order of the polynomials."""
        return self.coefficients.shape[1] - 1

    @property
    def position(self) -> FloatArray:
        """Positions at the reference time, (n, 2), m."""
        return np.ascontiguousarray(self.coefficients[:, 0])

    def at(self, track: IntArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predicted position and its covariance.

        Parameters
        ----------
        track : (p,) ndarray of int
            Rows of tracks.
        time : (p,) ndarray
            s.

        Returns
        -------
        position : (p, 2) ndarray
            m.
        covariance : (p, 2, 2) ndarray
            m^2.
        """
        count = self.coefficients.shape[1]
        powers = ((time - self.reference) / self.scale[track])[:, None] ** np.arange(count)
        position = np.einsum("pk,pkc->pc", powers, self.coefficients[track])
        covariance = np.einsum(
            "pk,pl,pkluv->puv", powers, powers, self.covariance[track], optimize=True
        )
        return position, covariance

    def reach(self, max_interval: float) -> tuple[FloatArray, FloatArray]:
        """Bounds over the times within `max_interval`, s, of the reference time.

        Returns
        -------
        drift, sigma : (n,) ndarray
            Bounds of the distance from the position at the reference time, ``sum |s|^k |c_k|`` from
            k = 1 on, and of the error along its major axis, ``sum |s|^k sigma_k`` (Minkowski), m.
        """
        count = self.coefficients.shape[1]
        powers = (max_interval / self.scale)[:, None] ** np.arange(count)
        length = np.hypot(self.coefficients[..., 0], self.coefficients[..., 1])
        diagonal = np.arange(count)
        sigma = (powers * major_sigma(self.covariance[:, diagonal, diagonal])).sum(axis=1)
        return (powers * length)[:, 1:].sum(axis=1), sigma
