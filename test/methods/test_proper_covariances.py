"""Covariances stay positive definite at the ends of the errors' and times' ranges."""

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel, available_methods, make_initiator
from tsepm_ros.tracker.merging import close

CASES = {
    "azimuth_1e-9": ({"azimuth_std": 1e-9}, 12.0, None),
    "tiny": ({"range_std": 1e-5, "range_std_fraction": 0.0, "azimuth_std": 1e-9}, 12.0, None),
    "tiny_of_detections": ({}, 12.0, (1e-6, 1e-9)),
    "long_and_thin": ({}, 12.0, (100.0, 1e-9)),
    "stamps_1e-9": ({}, 1e-9, None),
    "huge": ({}, 12.0, (1e5, 3.14)),
}


def assert_proper(covariance: np.ndarray, what: str) -> None:
    if not len(covariance):
        return
    assert np.isfinite(covariance).all(), what
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    correlation = covariance / sigma[:, :, None] / sigma[:, None, :]
    assert np.abs(correlation - np.swapaxes(correlation, 1, 2)).max() < 1e-9, what
    assert (np.abs(correlation) < 1.0 + 1e-9).all(), what
    np.linalg.cholesky(covariance)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("method", available_methods())
def test_tracks_held_tracks_and_potential_tracks(method, case):
    given, period, deviations = CASES[case]
    rng = np.random.default_rng(2)
    initiator = make_initiator(method, sensor=SensorModel(**given), clutter_density="given")
    for index in range(10):
        range_ = np.append(3000.0 + 5.0 * index, 9000.0 * np.sqrt(rng.uniform(0.01, 1.0, 6)))
        azimuth = np.append(0.5, rng.uniform(-3.1, 3.1, 6))
        if not deviations:
            azimuth[0] += initiator.sensor.azimuth_std * rng.standard_normal()
        errors = {}
        if deviations:
            shape = np.full(len(range_), 1.0)
            errors = {"range_std": shape * deviations[0], "azimuth_std": shape * deviations[1]}
        new = initiator.process(Scan(100.0 + period * index, range_, azimuth, **errors))
        for tracks, name in (
            (new, "new"),
            (initiator.current, "held"),
            (initiator.potential_tracks(), "potential"),
        ):
            assert_proper(tracks.covariance, f"{name} at {index}")


def test_tracks_of_singular_covariances_can_be_compared_for_merging():
    covariances = np.stack([np.zeros((4, 4)), np.zeros((4, 4))])
    covariances[:, 0, 0] = 1e-30
    states = np.zeros((2, 4))
    one, other = np.array([0]), np.array([1])
    assert close(states, covariances, one, other, 9.0).tolist() == [True]
