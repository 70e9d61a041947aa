"""How well the hits of new tracks fit their states, and what clutter gives of f_2."""

import numpy as np
import pytest
from scipy import stats
from scipy.stats import chi2
from support.builders import detections

from tsepm_ros import ConfirmedTrack
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.evaluation import clutter_statistic
from tsepm_ros.tracker.initial_state import figures_of_hits
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.tracks import TrackArrays


def scans(away: float, number: int = 5) -> DetectionWindow:
    """Scans of a target at 2 m/s, the last hit of which is some metres off, and of clutter."""
    recent = DetectionWindow()
    for scan in range(number):
        place = [2.0 * scan + (away if scan == number - 1 else 0.0), 0.0]
        found = detections([[500.0, 500.0], place], float(scan), 4.0)
        found["scan"], found["index"] = scan, [3, 7]
        recent.append(found)
    return recent


def figures(window: DetectionWindow, tracks: TrackArrays):
    sigma = major_sigma(tracks.covariance[:, 0::2, 0::2])
    return figures_of_hits(window, tracks.hits, tracks.stamp, tracks.state, sigma)


def track(hits: int = 5) -> TrackArrays:
    state = np.array([2.0 * (hits - 1), 2.0, 0.0, 0.0])
    pairs = tuple((scan, 7) for scan in range(hits))
    return TrackArrays.of([ConfirmedTrack(0, hits - 1.0, state, np.eye(4), pairs, 0.0)])


def test_hits_that_fit_leave_the_covariance_as_it_is():
    limit = 2.0 * np.sqrt(chi2.ppf(0.99, 6))  # of a single error, in metres
    assert figures(scans(0.0), track())[0].tolist() == [1.0]
    assert figures(scans(0.99 * limit), track())[0].tolist() == [1.0]


def test_a_hit_far_off_makes_it_larger_by_the_mean_square():
    np.testing.assert_allclose(figures(scans(30.0), track())[0], (30.0 / 2.0) ** 2 / 6.0)


def test_two_hits_fit_every_line_and_forgotten_hits_do_not_count():
    assert figures(scans(30.0, 2), track(2))[0].tolist() == [1.0]
    recent = scans(30.0)
    recent.forget(20)
    assert figures(recent, track())[0].tolist() == [1.0]
    assert figures(recent, TrackArrays.of([]))[0].shape == (0,)


def test_strengths_of_hits_are_counted_and_summed_and_unknown_ones_left_out():
    recent = DetectionWindow()
    for scan, strength in enumerate((1.5, np.nan, 4.0)):
        found = detections([[0.0, 0.0], [500.0, 500.0]], float(scan), 4.0)
        found["scan"], found["index"], found["strength"] = scan, [7, 3], [strength, 100.0]
        recent.append(found)
    both = track(3).joined(track(1))
    _, (number, total), sigma = figures(recent, both)
    assert number.tolist() == [2.0, 1.0]
    assert total.tolist() == [5.5, 1.5]
    assert sigma.tolist() == [2.0, 2.0], "of the last hit, whose variance is 4"


@pytest.mark.parametrize("hit_count", [2, 3, 5])
def test_f2_of_nearest_clutter_points_is_chi_square(hit_count):
    # Kennedy's null hypothesis: from point to nearest point of each new scan. 1000 independent
    # tracks; a Kolmogorov-Smirnov test at 0.1 %, for which a density 12 % off is found.
    rng = np.random.default_rng([12, hit_count])
    density, half = 1e-6, 6000.0
    positions = np.zeros((1000, hit_count, 2))
    for track in positions:
        for k in range(1, hit_count):
            n = rng.poisson(density * (2 * half) ** 2)
            points = track[k - 1] + rng.uniform(-half, half, (n, 2))
            track[k] = points[np.argmin(np.square(points - track[k - 1]).sum(axis=1))]
    statistic = clutter_statistic(positions, density)
    assert stats.kstest(statistic, stats.chi2(2 * hit_count - 2).cdf).pvalue > 1e-3
    wrong = stats.kstest(1.12 * statistic, stats.chi2(2 * hit_count - 2).cdf).pvalue
    assert wrong < stats.kstest(statistic, stats.chi2(2 * hit_count - 2).cdf).pvalue
