"""Benchmark of an option's cost: the time's ratio, and the options."""

from __future__ import annotations

import numpy as np
import option_cost
import pytest


def test_cost_is_the_ratio_of_the_mean_times():
    times = np.full((60, 2), 2e-3)
    times[:, 1] *= np.tile([1.0, 1.4], 30)
    assert option_cost.ratio_of(times).value == pytest.approx(1.2)


@pytest.mark.long
@pytest.mark.parametrize("choice", option_cost.CHOICES)
def test_both_sides_of_an_option_are_timed_after_the_warm_up(choice):
    scenario = option_cost.SEAS["4 detections, small radar"].scenario(42, 10.0)
    measured = option_cost.times_of(scenario, [1, 0], choice)
    assert measured.shape == (2, 2) and (measured > 0.0).all()
