"""Questions about angles that look like degrees."""

import math

import numpy as np
import pytest

from msg_adapters.ping import ReadingOptions
from msg_adapters.point_cloud_detections import detections_of_fields
from tsepm_ros import SensorModel
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.session.consistency_checks import questions
from tsepm_ros.session.session import Session
from tsepm_ros.settings.settings import Settings


@pytest.mark.parametrize(
    ("sensor", "mounting", "name"),
    [
        ({}, {}, ""),
        ({"azimuth_std": math.radians(10.0), "azimuth_resolution": 0.7}, {"yaw": math.pi}, ""),
        ({"azimuth_std": 1.0}, {}, "sensor.azimuth_std is 1 rad"),
        ({"azimuth_resolution": 1.0}, {}, "sensor.azimuth_resolution is 1 rad"),
        ({}, {"yaw": 5.0}, "mounting.yaw is 5 rad"),
        ({}, {"yaw": -5.0}, "mounting.yaw is -5 rad"),
    ],
)
def test_parameters_that_look_like_degrees_are_asked_about(sensor, mounting, name):
    asked = questions(SensorModel(**sensor), Mounting(**mounting))
    assert len(asked) == bool(name)
    assert all(
        sentence.startswith(name) and "degrees are meant, set" in sentence for sentence in asked
    )


def asked_of(field: str, pings: list[np.ndarray], **options: str) -> list[str]:
    """The questions of a session about the angles of some pings."""
    sentences: list[str] = []

    def report(reason: str, sentence: str) -> None:
        if reason == "degrees":
            sentences.append(sentence)

    session = Session(Settings(), report)
    for index, angles in enumerate(pings):
        values = {"range": np.full(len(angles), 500.0), field: angles}
        ping = detections_of_fields(index * 10**9, "sonar", values, ReadingOptions(**options))
        assert np.abs(ping.scan.azimuth).max(initial=0.0) <= math.pi
        session.add_scan(ping.sensor_scan, now=0.0)
    return sentences


@pytest.mark.parametrize("field", ["azimuth", "bearing"])
@pytest.mark.parametrize("low, high", [(-60.0, 60.0), (0.0, 360.0)])
def test_angles_in_degrees_are_asked_about_once(field, low, high):
    rng = np.random.default_rng(1)
    pings = [rng.uniform(low, high, 3) for _ in range(50)]
    [sentence] = asked_of(field, pings)
    assert "beyond 2 pi" in sentence and "radians" in sentence


@pytest.mark.parametrize("low, high", [(-math.pi, math.pi), (0.0, 2 * math.pi), (-0.5, 6.5)])
@pytest.mark.parametrize("reference", ["bow", "north"])
def test_radians_are_not_asked_about(low, high, reference):
    rng = np.random.default_rng(1)
    pings = [rng.uniform(low, high, 20) for _ in range(20)]
    assert asked_of("bearing", pings, bearing_reference=reference) == []
    assert asked_of("azimuth", pings) == []


def test_a_few_odd_angles_are_not_asked_about():
    assert asked_of("azimuth", [np.array([100.0, 0.1, 0.2])] * 30) == []
