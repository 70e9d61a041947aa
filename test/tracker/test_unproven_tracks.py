"""P_D is not learned from false tracks."""

from __future__ import annotations

import numpy as np
import pytest
from support.score_scenes import clutter, score

from tsepm_ros import Scan, SensorModel


@pytest.mark.long
def test_a_sea_without_targets_leaves_the_detection_probability_as_given():
    # Five false tracks a minute are allowed; each is missed most of the time.
    sensor = SensorModel(max_range=4000.0, clutter_density=2e-6, detection_probability=0.8)
    initiator = score(sensor, false_tracks_per_hour=300.0)
    rng = np.random.default_rng(4)
    for k in range(60):
        range_, azimuth = clutter(rng, 2e-6)
        near = range_ < 4000.0
        initiator.process(Scan(12.0 * k, range_[near], azimuth[near]))
    assert initiator.totals.confirmed > 15
    assert initiator.detection_probability > 0.65
