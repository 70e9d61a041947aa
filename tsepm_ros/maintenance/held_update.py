"""Held tracks after a scan: their modes, states, probabilities and counts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tsepm_ros.kinematics import speed_limit
from tsepm_ros.kinematics.interacting_models import InteractingModels
from tsepm_ros.maintenance import ipda
from tsepm_ros.maintenance.gated_detections import GATE_PROBABILITY
from tsepm_ros.maintenance.held_tracks import HeldTracks
from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.numerics.rows import changed

PROVING = 0.5
"""P_D by which tracks are proven: by that in use, a wrong one would never be corrected."""
DETECTED = 0.5
"""Probability of a detection from which a target counts as detected in a scan."""


class CoveredTracks(NamedTuple):
    """Samples of the detection probability: a row for each track that a scan covered.

    Attributes
    ----------
    detected : (k,) ndarray
        Probability that the target exists, by the scans since its start alone, and was detected.
    scans : (k,) ndarray
        Scans that covered the target since its last detection, this scan included.
    """

    detected: FloatArray
    scans: FloatArray


def updated(
    held: HeldTracks,
    state: FloatArray,
    covariance: FloatArray,
    mode_ratios: FloatArray,
    empty: FloatArray,
    covered: BoolArray,
    max_speed: FloatArray,
) -> tuple[HeldTracks, CoveredTracks]:
    """The predicted rows after a scan, and its samples of the detection probability.

    Parameters
    ----------
    held : HeldTracks
    state, covariance : (m, n, 4), (m, n, 4, 4) ndarray
        The modes, updated by the scan's detections.
    mode_ratios : (m, n) ndarray
        Lambda_im.
    empty : (n,) ndarray
        b_i.
    covered : (n,) ndarray of bool
        Which targets could be detected at all.
    max_speed : (n,) ndarray
        v_max, m/s: a mode whose mean is faster is conditioned on it; see `kinematics.speed_limit`.
    """
    # The tail above v_max stays: that of a turn, after which a fast target is as fast again.
    slow_state, slow_covariance = speed_limit.slowed(
        state.reshape(-1, 4),
        covariance.reshape(-1, 4, 4),
        np.concatenate([max_speed] * len(state)),
    )
    probability, scan_ratio = ipda.updated_modes(held.models.probability, mode_ratios)
    models = InteractingModels(
        probability, slow_state.reshape(state.shape), slow_covariance.reshape(covariance.shape)
    )
    existence = ipda.updated_existence(held.existence, scan_ratio)
    proof = np.ones(len(held))
    seen = 1.0 - empty[covered]
    of_detections = (scan_ratio - empty)[covered]
    proof[covered] += PROVING * GATE_PROBABILITY * (of_detections / seen - 1.0)
    proven = ipda.updated_existence(held.proven, proof)
    of_target = 1.0 - empty / scan_ratio
    detected = of_target * existence
    scans = held.covered_scans + covered
    state, covariance = models.combined()
    held = changed(
        held,
        tracks=changed(held.tracks, state=state, covariance=covariance),
        models=models,
        existence=existence,
        proven=proven,
        visible=ipda.updated_visibility(held.visible, scan_ratio),
        covered_scans=scans * (1.0 - detected),
        last_detected=np.where(detected >= DETECTED, held.tracks.stamp, held.last_detected),
    )
    return held, CoveredTracks((of_target * proven)[covered], scans[covered])
