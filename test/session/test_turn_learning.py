"""What is a sweep, and what is not."""

import math

import numpy as np
import pytest
from support.sweeps import beam

from tsepm_ros import Scan
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.turn import TurnLearner
from tsepm_ros.tools.simulation import Simulator, load_scenario, shipped_scenarios
from tsepm_ros.tracker.scan import Arc, arc_of


def learned(messages):
    """Number of messages until a sweep is seen, and its seconds; None if it is never."""
    learner = TurnLearner()
    for number, message in enumerate(messages):
        turning = learner.take(message.scan.stamp, message.beams, message.scan.range)
        if turning is not None:
            return number, turning.seconds
    return None


def echoes(stamp: float, azimuth, range) -> SensorScan:
    """A message that lists its detections only."""
    scan = Scan(stamp, range, azimuth)
    return SensorScan(scan, "sonar", beams=arc_of(scan.azimuth))


def turning(steps: float, direction: int = 1, *, whole: bool = True, seed: int = 0, share=1.0):
    rng = np.random.default_rng(seed)
    for number in range(int(4 * steps)):
        azimuth = math.remainder(direction * number * 2 * math.pi / steps, 2 * math.pi)
        if whole:
            yield beam(2.5 * number / steps, azimuth)
        elif rng.random() < share:
            yield beam(2.5 * number / steps, azimuth, rng.uniform(10.0, 900.0), whole=False)
        else:
            yield beam(2.5 * number / steps, None)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("steps", [8, 36, 400, 4096])
def test_a_turning_beam_is_a_sweep_after_a_turn(steps, direction):
    number, seconds = learned(turning(steps, direction))
    assert number <= steps + 1
    assert seconds == pytest.approx(2.5)


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_detections_at_different_ranges_show_it_too(share):
    number, seconds = learned(turning(180, whole=False, share=share))
    assert number <= 1.1 * 180 + 10
    assert seconds == pytest.approx(2.5, rel=0.02)


@pytest.mark.parametrize("back", [True, False])
def test_a_sector_is_a_sweep_after_two_passes(back):
    there = np.linspace(-1.0, 1.0, 41)
    azimuths = np.concatenate([there, there[::-1] if back else there] * 3)[17:]
    number, seconds = learned([beam(0.1 * n, float(a)) for n, a in enumerate(azimuths)])
    assert number <= 2.7 * 41
    assert seconds == pytest.approx(4.1, rel=0.05)


@pytest.mark.parametrize("name", shipped_scenarios())
def test_no_shipped_scenario_is_one(name):
    simulator = Simulator(load_scenario(name), 3)
    assert (
        learned(echoes(one.scan.stamp, one.scan.azimuth, one.scan.range) for one in simulator)
        is None
    )


def test_a_fan_that_stays_is_none():
    fans = [
        SensorScan(Scan(float(n), [], []), "sonar", beams=Arc(-0.5, 1.0, True)) for n in range(500)
    ]
    assert learned(fans) is None


@pytest.mark.long
def test_few_detections_here_and_there_are_none():
    rng = np.random.default_rng(1)
    for number in (0.5, 1.0, 3.0):
        pings = (
            echoes(float(n), rng.uniform(-np.pi, np.pi, m), rng.uniform(1.0, 900.0, m))
            for n, m in enumerate(rng.poisson(number, 8_000))
        )
        assert learned(pings) is None


def test_a_buoy_seen_from_a_turning_vessel_is_none():
    rng = np.random.default_rng(1)
    for noise in (0.0, 0.01):
        pings = [
            echoes(
                float(n),
                [math.remainder(-0.1 * n + noise * rng.standard_normal(), 2 * math.pi)],
                [200.0 + rng.standard_normal()],
            )
            for n in range(400)
        ]
        assert learned(pings) is None


def test_a_target_that_passes_to_and_fro_is_none():
    pings = [echoes(float(n), [math.sin(0.05 * n)], [200.0]) for n in range(2000)]
    assert learned(pings) is None


def test_a_fan_that_is_panned_slowly_is_none():
    """It sees every target many times a turn: a message is a scan of its own."""
    fans = [
        SensorScan(Scan(float(n), [], []), "sonar", beams=Arc(0.05 * n, 1.0, True))
        for n in range(1000)
    ]
    assert learned(fans) is None
