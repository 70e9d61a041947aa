"""Existence of confirmed tracks, and the limit of their number.

Integrated probabilistic data association: target existence and association probabilities.

Each track has a probability r that its target exists, which falls with every miss and rises with
every detection that fits (Musicki, Evans, Stankovic, "Integrated probabilistic data association",
IEEE Trans. Autom. Control 39(6), 1994). A target that exists may fade and become visible again
(their Markov chain two), so a few misses in a row do not end a track. The chain is one of scans,
not of seconds: a sonar looks as often as its targets and its sea require. After n misses in a row
of a P_D near 1, the odds of a faded target against none are, within a seventh, ``SCANS_TO_VANISH /
SCANS_TO_FADE ((1 - 1 / SCANS_OF_FADING) (1 - 1 / SCANS_TO_VANISH))^n``. The modes of target motion
are weighted by their likelihoods (Musicki, Suvorova, "Tracking in clutter using IMM-IPDA-based
algorithms", IEEE Trans. Aerosp. Electron. Syst. 44(1), 2008).

Symbols, of track i, detection j and mode m::

    r_i, s_i    probability that the target exists; that it is visible, if it exists
    P_D, P_G    probability of a detection; that the gate holds it
    L_ijm       likelihood ratio of the detection: s_i P_D N(z_j; H x_im, S_im) / lambda_j
    mu_im       probability of the mode; L_ij = sum_m mu_im L_ijm
    b_i         1 - s_i P_D P_G: probability that the gate of an existing target stays empty
    Lambda_i    likelihood ratio of the scan, target against none: b_i + sum_j L_ij

(Lambda_i is 1 - delta_i of the sources.) All functions are pure: of arrays, with a row for each
track (n), detection (d), or pair of both (p).

How many tracks can be held where the time of a scan is limited.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, TimeLimit, keep_best

SCANS_TO_FADE = 25.0
"""Mean number of scans after which a visible target fades: a choice."""
SCANS_OF_FADING = 8.0
"""Mean number of scans for which it then stays invisible: a choice."""
SCANS_TO_VANISH = 50.0
"""Mean number of scans after which a target is gone, so that misses end its track: a choice."""
MAX_LOG_FACTOR = 100.0
"""Logarithm of the largest factor by which detections are explained: no overflow."""


def predicted(
    existence: FloatArray, visible: FloatArray, covered: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Probabilities r and s (n,) of targets before a scan.

    ``r <- (1 - 1 / SCANS_TO_VANISH) r``,
    ``s <- (1 - 1 / SCANS_TO_FADE) s + (1 - s) / SCANS_OF_FADING``. A target outside the coverage
    (not `covered`) is as one that has faded, ``r <- (1 - 1 / SCANS_OF_FADING) r``: it stays away or
    comes back.
    """
    stays = np.where(covered, 1.0 - 1.0 / SCANS_TO_VANISH, 1.0 - 1.0 / SCANS_OF_FADING)
    visible = (1.0 - 1.0 / SCANS_TO_FADE) * visible + (1.0 - visible) / SCANS_OF_FADING
    return existence * stays, visible


@dataclass(frozen=True)
class Association:
    """Association probabilities of detections and targets.

    Attributes
    ----------
    ratio : (m, p) ndarray
        L_ijm of each pair in each mode; detections of other targets count as clutter.
    probability : (p,) ndarray
        beta_ij = L_ij / Lambda_i: that detection j is target i's, if the target exists.
    held_density : (d,) ndarray
        Density of detections of held targets at each detection, 1/m^2.
    """

    ratio: FloatArray
    probability: FloatArray
    held_density: FloatArray


def associate(
    existence: FloatArray,
    empty: FloatArray,
    mode_probability: FloatArray,
    ratios: FloatArray,
    track: IntArray,
    row: IntArray,
    clutter: FloatArray,
) -> Association:
    """Association probabilities of targets that compete for detections.

    The scan is less likely by the factor f_ij if detection j is not there for target i::

        f_ij = (1 - r_i + r_i Lambda_i) / (1 - r_i + r_i (Lambda_i - L_ij))

    For each target, the detections of the others are clutter: L_ij / prod_k!=i f_kj stands for
    L_ij, with the f_kj of targets alone, in all but the numerator of f_ij of j itself (as in
    Musicki, La Scala, "Multi-target tracking in clutter without measurement assignment", IEEE
    Trans. Aerosp. Electron. Syst. 44(3), 2008). The density of held targets' detections is
    ``lambda_j (prod_i f_ij - 1)``. Where another detection may as well be target i's, the share of
    target i in detection j is small, so a second target close to it is detectable.

    Parameters
    ----------
    existence : (n,) ndarray
        r_i.
    empty : (n,) ndarray
        b_i.
    mode_probability : (m, n) ndarray
        mu_im.
    ratios : (m, p) ndarray
        L_ijm.
    track, row : (p,) ndarray of int
        i and j of each pair.
    clutter : (d,) ndarray
        lambda_j, 1/m^2.
    """
    d = len(clutter)
    ratio = mean_over_modes(mode_probability, ratios, track)
    alone = _log_factor(existence, empty, track, ratio, ratio)
    by_others = np.bincount(row, alone, minlength=d)[row] - alone
    left = np.exp(-np.minimum(by_others, MAX_LOG_FACTOR))
    competing = left * ratio
    factor = _log_factor(existence, empty, track, ratio, competing)
    explained = np.minimum(np.bincount(row, factor, minlength=d), MAX_LOG_FACTOR)
    return Association(
        ratio=left * ratios,
        probability=competing / scan_ratio(empty, competing, track)[track],
        held_density=clutter * np.expm1(explained),
    )


def mean_over_modes(
    mode_probability: FloatArray, values: FloatArray, track: IntArray
) -> FloatArray:
    """Mean of values (m, p) of pairs over the modes (m, n) of their tracks, (p,)."""
    return np.asarray((mode_probability[:, track] * values).sum(axis=0))


def scan_ratio(empty: FloatArray, ratio: FloatArray, track: IntArray) -> FloatArray:
    """Lambda_i = b_i + sum_j L_ij, (..., n), of pairs' L_ij (..., p)."""
    return np.asarray(empty + grouped.sums(ratio, track, len(empty)))


def _log_factor(
    existence: FloatArray,
    empty: FloatArray,
    track: IntArray,
    ratio: FloatArray,
    competing: FloatArray,
) -> FloatArray:
    """Logarithm of f of each pair, (p,): of `ratio`, given the `competing` ratios of the track.

    ``ln(1 + r_i L_ij / (1 - r_i + r_i (b_i + sum_k!=j L_ik)))``
    """
    r = existence[track]
    remaining = scan_ratio(empty, competing, track)[track] - competing
    least = 1.0 - r + r * empty[track]  # the difference of the sums is rounded
    return np.log1p(r * ratio / np.maximum(1.0 - r + r * remaining, least))


def updated_modes(
    mode_probability: FloatArray, of_mode: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mode probabilities after a scan, and its likelihood ratio over all modes.

    ``Lambda_i = sum_m mu_im Lambda_im``, ``mu_im <- mu_im Lambda_im / Lambda_i``

    Parameters
    ----------
    mode_probability, of_mode : (m, n) ndarray
        mu_im and Lambda_im.

    Returns
    -------
    mode_probability : (m, n) ndarray
    scan_ratio : (n,) ndarray
    """
    weighted = mode_probability * of_mode
    total = weighted.sum(axis=0)
    return weighted / total, total


def updated_existence(existence: FloatArray, ratio: FloatArray) -> FloatArray:
    """Probability of existence (n,) after a scan: ``Lambda r / (1 - (1 - Lambda) r)``."""
    return np.asarray(ratio * existence / (1.0 - (1.0 - ratio) * existence))


def updated_visibility(visible: FloatArray, ratio: FloatArray) -> FloatArray:
    """Probability that targets are visible (n,) after a scan: ``1 - (1 - s) / Lambda``.

    Of a faded target nothing is detected: its likelihood ratio is 1.
    """
    return np.asarray(1.0 - (1.0 - visible) / ratio)


HOLDING_SHARE = 0.3
"""Share of the time of a scan for which held tracks may be carried through it."""
SECONDS_PER_TRACK = 5e-5
"""Time to carry a track through a scan, at least: measured where thousands are held."""
MANY = 1000
"""Held tracks from which on the time that they took is measured."""
LEAST_ROOM = 10
"""Tracks that a scan may start in any case."""


def room_for(limit: TimeLimit, held: int) -> int:
    """Tracks that may be added to those held, so that all can be carried in time.

    Parameters
    ----------
    limit : TimeLimit
        Of the scan, through which the held tracks were just carried.
    held : int
        Their number.
    """
    if not limit.finite:
        return sys.maxsize
    each = max(limit.elapsed / held if held >= MANY else 0.0, SECONDS_PER_TRACK)
    return max(int(HOLDING_SHARE * limit.seconds / each) - held, LEAST_ROOM)


def best_held(existence: FloatArray, evaluation: FloatArray, number: int) -> IntArray:
    """Rows of the new tracks (n,) that are kept, ascending.

    Those that exist most probably, and of equal ones those of the smallest evaluation.
    """
    rank = np.empty(len(existence))
    rank[np.lexsort((evaluation, -existence))] = np.arange(len(existence))
    return keep_best(rank, number)
