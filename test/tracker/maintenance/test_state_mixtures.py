"""States of held tracks after a scan: mixtures over the detections that may be theirs."""

from __future__ import annotations

import numpy as np
import pytest
from support.builders import detections
from support.held import P_D, holding, ids, step


@pytest.mark.long
def test_covariances_stay_positive_definite_and_numbers_finite():
    hold = holding(1, 2, 3)
    rng = np.random.default_rng(2)
    for scan in range(1, 1000):
        time = 0.1 * scan
        points = [*rng.uniform([0, 0], [8000, 4000], (rng.integers(0, 20), 2))]
        points += [[2000.0 + 5.0 * time, 1000.0 * k] for k in (1, 2, 3)]
        explained = step(hold, time, detections(points, time), P_D)
        assert np.isfinite(explained).all()
        assert np.linalg.eigvalsh(hold.held.tracks.covariance).min() > 0
        np.testing.assert_array_equal(
            hold.held.tracks.covariance, np.swapaxes(hold.held.tracks.covariance, 1, 2)
        )
    assert ids(hold) == [1, 2, 3]
    assert np.isfinite(hold.held.existence).all()
