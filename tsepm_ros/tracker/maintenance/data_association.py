"""Association of a scan's detections with confirmed tracks, and their update by these.

Each confirmed track has a filter with two modes of motion, and a straight fit (see `stationary`).
Each of the two seeks its own detections, the `MAX_NEIGHBOURS` nearest, at its own place: n tracks
have pairs (n, 2, k), and for the modes of both, the fit as the last, pairs (n, 3, k). If more
detections than that are in a gate, those farther away count as clutter.

The association is integrated probabilistic: each track has a probability r that its target exists,
which falls with every miss and rises with every detection that fits (Musicki, Evans, Stankovic,
"Integrated probabilistic data association", IEEE Trans. Autom. Control 39(6), 1994). A target that
exists may fade and become visible again (their Markov chain two), so a few misses in a row do not
end a track. The chain is one of scans, not of seconds: a sonar looks as often as its targets and
its sea require. After n misses in a row of a P_D near 1, the odds of a faded target against none
are, within a seventh, ``SCANS_TO_VANISH / SCANS_TO_FADE ((1 - 1 / SCANS_OF_FADING) (1 - 1 /
SCANS_TO_VANISH))^n``. The modes of target motion are weighted by their likelihoods (Musicki,
Suvorova, "Tracking in clutter using IMM-IPDA-based algorithms", IEEE Trans. Aerosp. Electron. Syst.
44(1), 2008).

Symbols, of track i, detection j and mode m::

    r_i, s_i    probability that the target exists; that it is visible, if it exists
    P_D, P_G    probability of a detection; that the gate holds it
    L_ijm       likelihood ratio of the detection: s_i P_D N(z_j; H x_im, S_im) / lambda_j
    mu_im       probability of the mode; L_ij = sum_m mu_im L_ijm
    b_i         1 - s_i P_D P_G: probability that the gate of an existing target stays empty
    Lambda_i    likelihood ratio of the scan, target against none: b_i + sum_j L_ij

(Lambda_i is 1 - delta_i of the sources.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import FloatArray, IntArray, taken
from tsepm_ros.numerics.discs import squared_distances_of_discs
from tsepm_ros.tracker import motion, range_rates
from tsepm_ros.tracker.measurement import measurement_covariance_at
from tsepm_ros.tracker.options import GATE_PROBABILITY
from tsepm_ros.tracker.sensor import SensorModel

MAX_NEIGHBOURS = 8
"""Detections considered for each filter and each fit: the nearest."""
MANY = 16_000
"""Coordinates of tracks times detections from which on the nearest are sought in a tree."""
SEEKER = np.array([0, 0, 1])
"""Which of the two, filter or fit, each mode is of."""
SCANS_TO_FADE = 25.0
"""Mean number of scans after which a visible target fades: a choice."""
SCANS_OF_FADING = 8.0
"""Mean number of scans for which it then stays invisible: a choice."""
SCANS_TO_VANISH = 50.0
"""Mean number of scans after which a target is gone, so that misses end its track: a choice."""
MAX_LOG_FACTOR = 100.0
"""Logarithm of the largest factor by which detections are explained: no overflow."""
_BEYOND_ROUNDING = 1.0 + 1e-12 * np.eye(4)
"""More than the relative rounding error of a covariance."""


@dataclass(frozen=True, eq=False)
class GatedDetections:
    """The detections in the gates of n tracks, and how well they fit.

    Attributes
    ----------
    row : (n, 2, k) ndarray of int
        Detections nearest to each filter and each fit, the nearest first.
    likelihood : (n, 3, k) ndarray
        N(z; H x, S), 1/m^2, times that of a range rate, s/m, in each mode; 0 outside the gate.
    pairs : tuple of (q,) ndarray of int
        Track, mode and place of those inside the gate.
    updated : tuple of (q, 4) and (q, 4, 4) ndarray
        State and covariance of each of these pairs if the detection is the target's.
    """

    row: IntArray
    likelihood: FloatArray
    pairs: tuple[IntArray, ...]
    updated: tuple[FloatArray, FloatArray]


def gate(
    state: FloatArray,
    covariance: FloatArray,
    mean: FloatArray,
    stamp: float,
    detections: NDArray[np.void],
    sensor: SensorModel,
) -> GatedDetections:
    """Detections in the gates of tracks, and how well they fit in each mode.

    Each detection is compared at its own time. One innovation covariance serves all detections of
    a track, ``S = H P H' + R`` at the time and with the error of the nearest. In a scan with range
    rates each pair has its own: the update by its position must leave a proper covariance, against
    which the range rate is compared.

    Parameters
    ----------
    state, covariance : (n, 3, 4), (n, 3, 4, 4) ndarray
        The modes, predicted to the stamp.
    mean : (n, 2, 4) ndarray
        Means of the filter over its modes, and of the fit.
    stamp : float
        The scan's, s.
    detections : (d,) ndarray of DETECTION
    sensor : SensorModel
    """
    number = min(MAX_NEIGHBOURS, len(detections))
    if not number:
        row, likelihood = np.zeros((len(mean), 2, 0), np.int64), np.zeros((len(mean), 3, 0))
        none = np.zeros((0, 4)), np.zeros((0, 4, 4))
        return GatedDetections(row, likelihood, likelihood.nonzero(), none)
    after = detections["time"] - stamp
    centre = motion.position_after(mean, 0.5 * (after.min() + after.max()))
    if centre.size * len(detections) > MANY:
        row = cKDTree(detections["position"]).query(centre, k=range(1, number + 1))[1]
    else:
        square = squared_distances_of_discs(centre.reshape(-1, 2), detections["position"])
        row = square.argsort(axis=1)[:, :number].reshape(*centre.shape[:2], number)
    of_modes = row[:, SEEKER]
    rated = range_rates.measured(detections).any()
    near = taken(detections, of_modes if rated else of_modes[..., :1])
    time = near["time"] - stamp
    spread = motion.position_covariance_after(covariance[:, :, None], time)
    spread = spread + measurement_covariance_at(
        near, motion.position_after(state[:, :, None], time), sensor
    )
    expected = motion.position_after(state[:, :, None], after[of_modes])
    innovation = detections["position"][of_modes] - expected
    density = motion.log_likelihood(
        state.reshape(-1, 4),
        covariance.reshape(-1, 4, 4),
        np.broadcast_to(np.arange(3 * len(mean)).reshape(-1, 3, 1), of_modes.shape),
        stamp,
        innovation,
        spread,
        detections,
        of_modes,
        GATE_PROBABILITY,
    )
    pairs = (density > -np.inf).nonzero()
    own = (*pairs[:2], pairs[2] if rated else 0)
    updated = motion.update(
        state[pairs[:2]], covariance[pairs[:2]], time[own], innovation[pairs], spread[own]
    )
    if rated:
        updated = range_rates.update(*updated, time[own], taken(detections, of_modes[pairs]))
    number = int(pairs[2].max(initial=0)) + 1
    likelihood = np.zeros((*of_modes.shape[:2], number))
    likelihood[pairs] = np.exp(density[pairs])
    return GatedDetections(row[..., :number], likelihood, pairs, updated)


def associate(
    existence: FloatArray,
    empty: FloatArray,
    mode_probability: FloatArray,
    ratios: FloatArray,
    row: IntArray,
    clutter: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Association probabilities of targets that compete for detections.

    The scan is less likely by the factor f_ij if detection j is not there for target i::

        f_ij = (1 - r_i + r_i Lambda_i) / (1 - r_i + r_i (Lambda_i - L_ij))

    For each target, the detections of the others are clutter: L_ij / prod_k!=i f_kj stands for
    L_ij, with the f_kj of targets alone, in all but the numerator of f_ij of j itself (as in
    Musicki, La Scala, "Multi-target tracking in clutter without measurement assignment", IEEE
    Trans. Aerosp. Electron. Syst. 44(3), 2008). The density of confirmed targets' detections is
    ``lambda_j (prod_i f_ij - 1)``. Where another detection may as well be target i's, the share of
    target i in detection j is small, so a second target close to it is detectable.

    Parameters
    ----------
    existence, empty : (n,) ndarray
        r_i and b_i.
    mode_probability : (n, 2) ndarray
        mu_im of the filter.
    ratios : (n, 3, k) ndarray
        L_ijm.
    row : (n, 2, k) ndarray of int
        j of each pair.
    clutter : (d,) ndarray
        lambda_j, 1/m^2.

    Returns
    -------
    ratio : (n, 3, k) ndarray
        L_ijm of each pair in each mode; detections of other targets count as clutter.
    probability : (n, 2, k) ndarray
        beta_ij = L_ij / Lambda_i: that detection j is target i's, if the target exists.
    confirmed_density : (d,) ndarray
        Density of detections of confirmed targets at each detection, 1/m^2.
    """
    ratio, r, b = over_modes(mode_probability, ratios), existence[:, None], empty[:, None]

    def log_factor(competing: FloatArray) -> FloatArray:
        """``ln(1 + r_i L_ij / (1 - r_i + r_i (b_i + sum_k!=j L_ik)))``."""
        remaining = b[..., None] + competing.sum(axis=-1, keepdims=True) - competing
        least = 1.0 - r + r * b  # the difference of the sums is rounded
        others = 1.0 - r[..., None] + r[..., None] * remaining
        return np.log1p(r[..., None] * ratio / np.maximum(others, least[..., None]))

    alone, index = log_factor(ratio), row + len(clutter) * np.arange(2)[:, None]
    explained = np.bincount(index.ravel(), alone.ravel(), minlength=2 * len(clutter))
    left = np.exp(-np.minimum(explained[index] - alone, MAX_LOG_FACTOR))
    competing = left * ratio
    factor = log_factor(competing)[:, 0]
    explained = np.bincount(row[:, 0].ravel(), factor.ravel(), minlength=len(clutter))
    return (
        left[:, SEEKER] * ratios,
        competing / (b[..., None] + competing.sum(axis=-1, keepdims=True)),
        clutter * np.expm1(np.minimum(explained, MAX_LOG_FACTOR)),
    )


def over_modes(mode_probability: FloatArray, values: FloatArray) -> FloatArray:
    """Values (n, 3, k) of pairs as means (n, 2, k) of the filter over its modes, and of the fit."""
    of_filter = (mode_probability[..., None] * values[:, :-1]).sum(axis=1)
    return np.stack([of_filter, values[:, -1]], axis=1)


def updated_states(
    state: FloatArray, covariance: FloatArray, gated: GatedDetections, probability: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mixtures of each predicted track and its updates by each of its detections, in each mode.

    ``x + m``, ``beta_0 P + sum_j beta_j (P_j + d_j d_j') - m m'`` with ``d_j = x_j - x`` and
    ``m = sum_j beta_j d_j``.

    Parameters
    ----------
    state, covariance : (n, 3, 4), (n, 3, 4, 4) ndarray
        As predicted.
    gated : GatedDetections
    probability : (n, 3, k) ndarray
        beta_j of each pair; with what is left to 1, beta_0, no detection is the target's.

    Returns
    -------
    state, covariance : (n, 3, 4), (n, 3, 4, 4) ndarray
    """
    track, mode, _ = gated.pairs
    moved = gated.updated[0] - state[track, mode]
    second_moment = gated.updated[1] - covariance[track, mode] + moved[:, :, None] * moved[:, None]
    moments = np.concatenate([moved, second_moment.reshape(-1, 16)], axis=1)
    moments *= probability[gated.pairs][:, None]
    index = 20 * (state.shape[1] * track + mode)[:, None] + np.arange(20)
    sums = np.bincount(index.ravel(), moments.ravel(), minlength=5 * state.size)
    sums = sums.reshape(*state.shape[:-1], 20)
    mean, change = sums[..., :4], sums[..., 4:].reshape(covariance.shape)
    covariance = covariance + change - mean[..., :, None] * mean[..., None, :]
    # Rounding must not make it asymmetric, a part that would grow from scan to scan, or indefinite.
    return state + mean, 0.5 * (covariance + np.swapaxes(covariance, -1, -2)) * _BEYOND_ROUNDING


def updated_existence(existence: FloatArray, ratio: FloatArray) -> FloatArray:
    """Probability of existence (n,) after a scan: ``Lambda r / (1 - (1 - Lambda) r)``."""
    return np.asarray(ratio * existence / (1.0 - (1.0 - ratio) * existence))


OwnDetections = tuple[IntArray, IntArray]
"""Detections of a scan that are confirmed tracks', with more than some probability: id of the
track, and detection, (k,) each."""
