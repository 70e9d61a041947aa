"""The logic-based method on scenes by hand, and the polynomials that it predicts with."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2
from support.builders import detections, scan_at

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.studies.logic import Polynomials

SENSOR = SensorModel(range_std=20.0, range_std_fraction=0.0, azimuth_std=1e-3)


def run(scans, **options):
    made = make_initiator("logic", sensor=SENSOR, **options)
    return [t for k, where in enumerate(scans) for t in made.process(scan_at(12.0 * k, where))]


def along_x(*steps: float):
    """Scans of one detection each that moves by the steps, m; the range's error is along x."""
    return [[(3000.0 + x, 0.0)] for x in np.cumsum([0.0, *steps])]


GAMMA = np.sqrt(chi2.ppf(0.99, 2))


@pytest.mark.parametrize(
    ("steps", "reach"),
    [((), 120.0 + GAMMA * np.sqrt(2) * 20.0), ((60.0,), 60.0 + GAMMA * np.sqrt(6) * 20.0)],
    ids=["second hit", "third hit"],
)
@pytest.mark.parametrize("inside", [True, False])
def test_the_region_is_that_of_the_speeds_and_then_of_the_line(steps, reach, inside):
    # The straight line through z_1, z_2 predicts 2 z_2 - z_1: the variance is 4 + 1, and R_j.
    scans = along_x(*steps, reach + (-0.5 if inside else 0.5))
    hits = len(scans)
    assert len(run(scans, min_hits=hits, window=hits)) == inside


@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.parametrize(("degree", "middle", "variance"), [(2, 60.0, 20.0), (1, 60.0, 10.0 / 3)])
def test_the_fourth_hit_is_predicted_by_a_polynomial(degree, middle, variance, inside):
    # Three points one step apart: z_1 - 3 z_2 + 3 z_3 of degree 2; of degree 1 the weights are
    # -2/3, 1/3, 4/3, whose squares add up to 7/3.
    reach = middle + GAMMA * np.sqrt(variance) * 20.0
    scans = along_x(60.0, 60.0, reach + (-0.5 if inside else 0.5))
    options = {"min_hits": 4, "window": 4, "degree": degree, "max_speed": 1000.0}
    assert len(run(scans, **options)) == inside


def test_a_parabola_is_followed_by_the_second_order_only():
    scans = along_x(*(10.0 + 40.0 * k for k in range(6)))
    options = {"min_hits": 7, "window": 7, "gate_probability": 0.9}
    assert len(run(scans, **options)) == 1
    assert run(scans, degree=1, **options) == []


def test_the_closest_continues_a_track_and_the_others_start():
    made = make_initiator("logic", sensor=SENSOR)
    scans = along_x(60.0)
    scans.append([(3125.0, 0.0), (3118.0, 0.0)])
    for k, where in enumerate(scans):
        made.process(scan_at(12.0 * k, where))
    assert [track.hits for track in made.potential_tracks()] == [((0, 0), (1, 0), (2, 1))]
    assert made.statistics.started == 1


def test_every_second_detection_in_the_region_makes_a_track():
    made = make_initiator("logic", sensor=SENSOR)
    made.process(scan_at(0.0, [(3000.0, 0.0)]))
    made.process(scan_at(12.0, [(3050.0, 0.0), (2950.0, 50.0)]))
    assert len(made.potential_tracks()) == 2
    assert made.statistics.started == 0


@pytest.mark.parametrize(("missed", "found"), [("waits", 1), ("ends", 0)])
def test_a_scan_without_a_detection_ends_a_track_or_not(missed, found):
    scans = along_x(60.0, 60.0, 60.0, 60.0)
    scans[2] = []
    assert len(run(scans, missed=missed)) == found


def test_detections_of_other_times_in_a_scan_are_predicted_for_their_times():
    made = make_initiator("logic", sensor=SENSOR, min_hits=3, window=3)
    tracks = []
    for k, offset in enumerate((0.0, 4.0, -3.0)):
        where = [(3000.0 + 9.0 * (12.0 * k + offset), 0.0), (-3000.0, 0.0)]
        tracks += made.process(scan_at(12.0 * k, where, time_offset=[offset, 0.0]))
    moving = next(track for track in tracks if track.hits[0] == (0, 0))
    np.testing.assert_allclose(moving.velocity, [9.0, 0.0], atol=0.01)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_polynomial_is_that_of_numpy_with_its_covariance(degree):
    rng = np.random.default_rng(degree)
    times = np.array([100.0, 112.0, 130.0, 141.0, 155.0])
    hits = detections(rng.normal(0, 100, (3, 5, 2)), times)
    roots = rng.normal(0, 5, (3, 5, 2, 2))
    hits["covariance"] = roots @ np.swapaxes(roots, -1, -2)
    at = np.array([160.0, 170.0, 150.0])
    fitted = Polynomials.fitted(hits, 165.0, degree)
    position, covariance = fitted.at(np.arange(3), at)
    for row, time in enumerate(at):
        unit = [np.polyval(np.polyfit(times - time, one, degree), 0.0) for one in np.eye(5)]
        np.testing.assert_allclose(position[row], unit @ hits["position"][row], atol=1e-8)
        expected = np.einsum("i,iuv->uv", np.square(unit), hits["covariance"][row])
        np.testing.assert_allclose(covariance[row], expected, atol=1e-8)
    drift, sigma = fitted.reach(15.0)
    apart = np.hypot(*(position - fitted.coefficients[:, 0]).T)
    assert (apart <= drift * (1 + 1e-9) + 1e-9).all()
    assert (np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]) <= sigma * (1 + 1e-9)).all()
