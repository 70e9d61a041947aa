"""A sonar that runs round a square finds what one that stays finds, and as well."""

import dataclasses
import functools

import numpy as np
import pytest

from tsepm_ros.tools.evaluation.performance import study
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint, Outcome, make_method
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tools.simulation.scenario import OwnShipMotion

RUNS = 40
Z = 3.3
"""Standard errors of a difference: 99.9 %, two-sided."""

SQUARE = load_scenario("square_path", {"sensor.clutter_density": 2e-7})
FIXED = dataclasses.replace(SQUARE, own_ship=OwnShipMotion())


class PlacedByTheStamp:
    """A track starter that is given every scan with the sensor's pose at its stamp alone."""

    def __init__(self, scenario, method, options):
        self._own_ship = scenario.own_ship
        self._starter = make_method(scenario, method, options)

    @property
    def hold(self):
        return self._starter.maintenance

    def process(self, scan):
        pose = self._own_ship.pose(scan.stamp)
        return self._starter.process(dataclasses.replace(scan, sensor_pose=pose))


@functools.cache
def figures(moving, method, factory=make_method, pure=False):
    """Share of the targets found in each run; errors, NEES and time of true (or pure) starts."""
    found, starts = [], []
    point = OperatingPoint(method, factory=factory)
    for run in study(SQUARE if moving else FIXED, point, range(RUNS), 1):
        true = [start for start in run.starts if start.outcome is Outcome.TRUE]
        found.append(len(true) / run.targets)
        starts += [
            (s.position_error**2, s.velocity_error**2, s.nees, s.time)
            for s in true
            if s.pure or not pure
        ]
    return np.array(found), np.array(starts)


def assert_equal(one, other, largest):
    """Equal means at 99.9 %, of samples large enough to see a difference of `largest`."""
    error = np.sqrt(one.var(ddof=1) / len(one) + other.var(ddof=1) / len(other))
    assert Z * error < largest
    assert abs(one.mean() - other.mean()) <= Z * error


@pytest.mark.long
@pytest.mark.parametrize("method", ["score", "tsepm"])
def test_detections_and_errors_are_those_of_a_sonar_that_stays(method):
    # 160 targets; the same scenes, 40 runs, seed 1. A difference of 0.08 in P_D would be seen, or
    # of the whole of a mean square (1.4 times the error), of the NEES or of 15 s. Starts with a
    # wrong hit are left out: their errors are of any size, whether the sonar moves or not.
    (found_moving, moving), (found_fixed, fixed) = (
        figures(moving, method, pure=True) for moving in (True, False)
    )
    assert found_fixed.mean() > 0.9
    assert_equal(found_moving, found_fixed, 0.08)
    for one, other, largest in zip(moving.T, fixed.T, [*fixed.mean(axis=0)[:3], 15.0], strict=True):
        assert_equal(one, other, largest)


@pytest.mark.long
def test_placed_by_the_pose_of_the_stamp_the_same_pings_find_less_later_and_worse():
    found, starts = figures(True, "score")
    found_badly, bad = figures(True, "score", PlacedByTheStamp)
    assert found_badly.mean() < 0.8 * found.mean()
    assert bad[:, 3].mean() > 1.3 * starts[:, 3].mean()
    # The NEES is larger with a confidence of 95 % (one-sided).
    nees, bad_nees = starts[:, 2], bad[:, 2]
    error = np.sqrt(nees.var(ddof=1) / len(nees) + bad_nees.var(ddof=1) / len(bad_nees))
    assert bad_nees.mean() - nees.mean() > 1.645 * error


def test_the_platform_turns_while_targets_are_started():
    heading = [SQUARE.own_ship.pose(12.0 * k)[2] for k in range(SQUARE.scans)]
    assert np.ptp(np.unwrap(heading)) == pytest.approx(np.pi, abs=0.1), "two turns of the square"
    rates = [SQUARE.own_ship.rates(12.0 * k)[2] for k in range(SQUARE.scans)]
    assert np.count_nonzero(rates) >= 4
    assert np.count_nonzero(rates) <= SQUARE.scans / 2, "and straight on in between"
