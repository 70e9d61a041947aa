"""How the benchmark of the detector counts."""

from __future__ import annotations

import detector
import numpy as np
import pytest

from tsepm_ros.tools.simulation.images import ImageModel, ImageSimulator


def test_echoes_in_more_than_half_of_the_pings_are_not_false():
    stands, once = np.array([[5.0, 0.0]]), np.array([[9.0, 0.0]])
    pings = [stands, stands, np.concatenate([stands, once]), np.zeros((0, 2))]
    assert detector.false_ones(pings, 1.0) == [0, 0, 1, 0]


def test_detections_of_targets_do_not_count_and_the_others_do():
    targets = tuple(np.array(t, float) for t in detector.TARGETS)
    images = list(ImageSimulator(detector.scenario(26, targets=targets), ImageModel(), 1))
    ratio, cells = detector.ratio(images, 20.0, (1, 1))
    assert ratio == pytest.approx(1.0, abs=0.5)
    assert cells > 1000
