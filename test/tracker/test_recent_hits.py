"""How well the hits of new tracks fit their states."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2
from support.builders import detections

from tsepm_ros import ConfirmedTrack
from tsepm_ros.tracker.recent_hits import RecentHits
from tsepm_ros.tracker.tracks import TrackArrays


def scans(away: float, number: int = 5) -> RecentHits:
    """Scans of a target at 2 m/s, the last hit of which is some metres off, and of clutter."""
    recent = RecentHits()
    for scan in range(number):
        place = [2.0 * scan + (away if scan == number - 1 else 0.0), 0.0]
        found = detections([[500.0, 500.0], place], float(scan), 4.0)
        found["index"] = [3, 7]
        recent.append(scan, found, 16)
    return recent


def track(hits: int = 5) -> TrackArrays:
    state = np.array([2.0 * (hits - 1), 2.0, 0.0, 0.0])
    pairs = tuple((scan, 7) for scan in range(hits))
    return TrackArrays.of([ConfirmedTrack(0, hits - 1.0, state, np.eye(4), pairs, 0.0)])


def test_hits_that_fit_leave_the_covariance_as_it_is():
    limit = 2.0 * np.sqrt(chi2.ppf(0.99, 6))  # of a single error, in metres
    assert scans(0.0).of(track())[0].tolist() == [1.0]
    assert scans(0.99 * limit).of(track())[0].tolist() == [1.0]


def test_a_hit_far_off_makes_it_larger_by_the_mean_square():
    np.testing.assert_allclose(scans(30.0).of(track())[0], (30.0 / 2.0) ** 2 / 6.0)


def test_two_hits_fit_every_line_and_forgotten_hits_do_not_count():
    assert scans(30.0, 2).of(track(2))[0].tolist() == [1.0]
    recent = scans(30.0)
    recent.append(20, detections(np.zeros((0, 2)), 20.0), 16)
    assert recent.of(track())[0].tolist() == [1.0]
    assert recent.of(TrackArrays.of([]))[0].shape == (0,)


def test_strengths_of_hits_are_counted_and_summed_and_unknown_ones_left_out():
    recent = RecentHits()
    for scan, strength in enumerate((1.5, np.nan, 4.0)):
        found = detections([[0.0, 0.0], [500.0, 500.0]], float(scan), 4.0)
        found["index"], found["strength"] = [7, 3], [strength, 100.0]
        recent.append(scan, found, 16)
    both = track(3).joined(track(1))
    _, (number, total), sigma = recent.of(both)
    assert number.tolist() == [2.0, 1.0]
    assert total.tolist() == [5.5, 1.5]
    assert sigma.tolist() == [2.0, 2.0], "of the last hit, whose variance is 4"
