"""Azimuth is a circle: where a turn begins, a sector points or a part looks does not matter."""

import functools
import math

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel, make_initiator


def scans(seed: int, turn: float = 0.0) -> list[Scan]:
    """Two targets, one of which crosses the azimuth pi, a quay and false detections, turned."""
    rng, made = np.random.default_rng(seed), []
    for stamp in np.arange(0.0, 40.0, 0.5):
        targets = np.array([[-150.0, 40.0 - 2.0 * stamp], [120.0 - 1.5 * stamp, 60.0 + stamp]])
        along = rng.uniform(-100.0, 100.0, 6)
        quay = np.stack([140.0 + 0.3 * along, 0.95 * along], axis=1)
        false = rng.uniform(-290.0, 290.0, (rng.poisson(6), 2))
        echoes = np.concatenate([targets[rng.random(2) < 0.9], quay, false])
        range_ = np.hypot(*echoes.T) + rng.standard_normal(len(echoes))
        azimuth = np.arctan2(echoes[:, 1], echoes[:, 0]) + 0.01 * rng.standard_normal(len(echoes))
        made.append(Scan(stamp, range_, np.remainder(azimuth + turn + math.pi, math.tau) - math.pi))
    return made


@functools.cache
def followed(low: float, high: float, seed: int, turn: float = 0.0):
    """The initiator after these scans, with the density and the P_D learned; its current tracks."""
    sensor = SensorModel(
        range_std=1.0,
        range_std_fraction=0.0,
        azimuth_std=0.01,
        max_range=300.0,
        azimuth_min=low + turn,
        azimuth_max=high + turn,
    )
    initiator = make_initiator("score", sensor=sensor, max_speed=10.0, min_speed=0.5)
    current = []
    for scan in scans(seed, turn):
        initiator.process(scan)
        current.append(initiator.current)
    return initiator, current


@pytest.mark.parametrize(("low", "high"), [(-3.1415, 3.1415), (-3.14, 3.14), (0.0, 6.283)])
def test_a_full_turn_in_other_numbers_is_the_same_to_the_bit(low, high):
    _, expected = followed(-math.pi, math.pi, seed=3)
    _, found = followed(low, high, seed=3)
    assert sum(map(len, expected)) > 50
    for one, other in zip(found, expected, strict=True):
        assert one.track_id.tolist() == other.track_id.tolist()
        np.testing.assert_array_equal(one.state, other.state)
        np.testing.assert_array_equal(one.covariance, other.covariance)
        np.testing.assert_array_equal(one.existence_probability, other.existence_probability)


@pytest.mark.parametrize("turn", [0.7, 2.5, -3.0])
def test_data_and_sector_turned_together_give_the_tracks_turned(turn):
    first, expected = followed(-1.5, 2.6, seed=1)
    second, found = followed(-1.5, 2.6, seed=1, turn=turn)
    assert first.learned.persistent.found, "the quay"
    assert second.learned.persistent.found
    cos, sin = math.cos(turn), math.sin(turn)
    axes = np.kron(np.array([[cos, -sin], [sin, cos]]), np.eye(2))
    assert sum(map(len, expected)) > 50
    for one, other in zip(found, expected, strict=True):
        assert one.track_id.tolist() == other.track_id.tolist()
        np.testing.assert_allclose(one.state, other.state @ axes.T, rtol=0, atol=1e-9 * 300.0)
        turned = axes @ other.covariance @ axes.T
        np.testing.assert_allclose(
            one.covariance, turned, rtol=0, atol=1e-9 * np.abs(turned).max(initial=0)
        )
        np.testing.assert_allclose(
            one.existence_probability, other.existence_probability, rtol=1e-9
        )


def test_parts_of_a_turn_that_look_elsewhere_end_no_track():
    # 16 parts a turn; the target is missed in four looks at it, which are 64 scans.
    parts, rng = 16, np.random.default_rng(3)
    sensor = SensorModel(range_std=0.5, range_std_fraction=0.0, azimuth_std=0.005, max_range=100.0)
    initiator = make_initiator("score", sensor=sensor, max_speed=2.0, plots="off", window=64)
    ended = {}
    for number in range(parts * 24):
        turn, part = divmod(number, parts)
        here = int(part == 8 and turn not in range(14, 18))
        range_ = 50.0 + 0.5 * rng.standard_normal(here)
        azimuth = math.pi / parts + 0.005 * rng.standard_normal(here)
        width = 2.0 * math.pi / parts
        swept = ((part - 8) * width, width)
        initiator.process(Scan(number / 20.0, range_, azimuth, swept=swept))
        ended |= initiator.maintenance.ended
    assert not ended
    assert initiator.current.track_id.tolist() == [0]
