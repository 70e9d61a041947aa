"""Whether a target exists, and which detection is its: integrated data association."""

import itertools
import math

import numpy as np
import pytest
from support.held import P_D, holding, step

from tsepm_ros.tracker import motion
from tsepm_ros.tracker.maintenance.data_association import (
    GATE_PROBABILITY,
    SCANS_OF_FADING,
    SCANS_TO_FADE,
    SCANS_TO_VANISH,
)
from tsepm_ros.tracker.maintenance.track_maintenance import MIN_EXISTENCE


@pytest.mark.parametrize("interval", [0.1, 12.0])
def test_a_target_may_fade_and_is_given_up_after_the_same_scans_at_any_rate(monkeypatch, interval):
    # A target is seen, faded or gone: a hidden Markov chain, followed in plain matrices.
    monkeypatch.setattr(motion, "SCANS_TO_TURN", math.inf)
    fade, appear, vanish = 1.0 / SCANS_TO_FADE, 1.0 / SCANS_OF_FADING, 1.0 / SCANS_TO_VANISH
    fading = np.array([[1.0 - fade, fade, 0.0], [appear, 1.0 - appear, 0.0], [0.0, 0.0, 1.0]])
    leaving = np.array([[1.0 - vanish, 0.0, vanish], [0.0, 1.0 - vanish, vanish], [0.0, 0.0, 1.0]])
    hold, chain = holding(1), np.array([0.9, 0.0, 0.1])
    for scan in itertools.count(1):
        step(hold, interval * scan, detectable=P_D)
        chain = chain @ fading @ leaving * [1.0 - P_D * GATE_PROBABILITY, 1.0, 1.0]
        chain /= chain.sum()
        if chain[:2].sum() < MIN_EXISTENCE:
            break
        np.testing.assert_allclose(hold.held.existence, [chain[:2].sum()], rtol=1e-9)
        np.testing.assert_allclose(hold.held.visible, [chain[0] / chain[:2].sum()], rtol=1e-9)
    assert hold.ended == {1: "missed"}
    assert 10 < scan < 60, "independent misses would end it after 4"
