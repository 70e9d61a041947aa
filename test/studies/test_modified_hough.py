"""The modified Hough transform on scenes by hand."""

import numpy as np
import pytest
from support.builders import scan_at

from tsepm_ros import SensorModel, make_initiator

SENSOR = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=1e-4)


def hits_of(scans, **options):
    made = make_initiator("modified_hough", sensor=SENSOR, **options)
    return [t.hits for k, where in enumerate(scans) for t in made.process(scan_at(12.0 * k, where))]


def path(*directions: float, step: float = 60.0):
    """Scans of one detection each that goes a step in each direction, rad."""
    steps = step * np.array([[np.cos(one), np.sin(one)] for one in directions])
    return [
        [point] for point in np.vstack([[2000.0, 0.0], 2000.0 * np.eye(2)[0] + steps.cumsum(0)])
    ]


@pytest.mark.parametrize(
    ("directions", "found"),
    [
        ((0.0, 0.0, 0.0), 1),
        ((0.0, 0.49, 0.98), 1),
        ((0.0, 0.51, 0.51), 0),
        ((0.0, 0.0, np.pi), 0),
        ((3.0, -3.0, 3.0), 1),
        ((1.5, 1.7, 1.5), 1),
    ],
    ids=["straight", "bends slowly", "bends", "turns back", "across pi", "across the normal"],
)
def test_zero_crossings_that_follow_each_other_are_close_and_of_one_sign(directions, found):
    assert len(hits_of(path(*directions))) == found


def test_the_angle_is_that_between_zero_crossings():
    # theta of the zero crossing of each pair of curves, and the slope there.
    rng = np.random.default_rng(1)
    for _ in range(50):
        points = np.array([2000.0, 0.0]) + rng.uniform(-50, 50, (3, 2))
        crossings = []
        for step in np.diff(points, axis=0):
            theta = np.arctan2(-step[0], step[1])  # of step . (cos, sin) = 0
            slope = -step[0] * np.sin(theta) + step[1] * np.cos(theta)
            assert abs(slope) == pytest.approx(np.hypot(*step))
            crossings.append(theta)  # chosen where the slope is positive: one sign
        turn = abs((crossings[1] - crossings[0] + np.pi) % (2 * np.pi) - np.pi)
        found = hits_of([[one] for one in points], min_hits=3, window=3, max_turn=0.7)
        assert len(found) == (turn <= 0.7)


@pytest.mark.parametrize(("step", "found"), [(119.9, 1), (120.1, 0)])
def test_the_slope_is_within_the_limit_of_the_speed(step, found):
    assert len(hits_of(path(0.0, 0.0, 0.0, step=step))) == found


def test_every_detection_on_the_line_is_followed():
    scans = path(0.0, 0.0, 0.0)
    scans[2].insert(0, (2110.0, 5.0))  # nearer to the turn of none, but leads nowhere
    scans[3] = [(2180.0, 0.0)]
    found = hits_of(scans)
    assert len(found) == 1
    assert found[0][-1] == (3, 0)


def test_a_scan_may_be_missed():
    scans = path(0.0, 0.0, 0.0, 0.0)
    scans[1] = []
    assert hits_of(scans) == [((0, 0), (2, 0), (3, 0), (4, 0))]
