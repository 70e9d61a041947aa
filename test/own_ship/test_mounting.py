"""Poses and covariances of a sensor that is mounted somewhere on its vessel."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.builders import whitened

from tsepm_ros.own_ship.registration import Mounting, sensor_covariance


def test_the_lever_arm_of_a_tilted_vessel_is_that_of_the_full_rotation():
    rng = np.random.default_rng(4)
    yaw, pitch, roll = angles = rng.uniform(-1.0, 1.0, (3, 50))
    vessel = np.stack([*rng.uniform(-9e3, 9e3, (2, 50)), yaw, roll, pitch], axis=1)
    found = Mounting(x=-30.0, y=4.0).sensor_poses(vessel)
    arm = Rotation.from_euler("ZYX", angles.T).apply([-30.0, 4.0, 0.0])
    np.testing.assert_allclose(found[:, :2] - vessel[:, :2], arm[:, :2], atol=1e-11)


@pytest.mark.parametrize("name", ["x", "y", "yaw"])
@pytest.mark.parametrize("value", [math.nan, math.inf, 1e6])
def test_a_mounting_that_cannot_be_is_refused(name, value):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        Mounting(**{name: value})


def test_the_covariance_of_the_sensor_is_that_of_its_errors():
    rng = np.random.default_rng(6)
    root = np.array([[2.0, 0.0, 0.0], [0.5, 1.5, 0.0], [0.01, -0.02, 0.02]])
    covariance = root @ root.T
    vessel = np.zeros((200_000, 5))
    vessel[:, :3] = [10.0, 20.0, 0.7] + rng.standard_normal((200_000, 3)) @ root.T
    mounting = Mounting(x=100.0, y=-40.0, yaw=1.0)
    arm = mounting.sensor_poses(np.array([[0.0, 0.0, 0.7, 0.0, 0.0]]))[0, :2]
    expected = sensor_covariance(covariance, arm)
    # Entries of a whitened sample covariance of 2e5 deviate by 0.003; what is left is 2nd order.
    found = whitened(mounting.sensor_poses(vessel), expected)
    np.testing.assert_allclose(found, np.eye(3), atol=0.02)
    assert not np.allclose(whitened(vessel[:, :3], expected), np.eye(3), atol=0.3)
