"""A target that falls silent is withheld; detected again it is the same track, at any ping rate."""

import math

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tracker.maintenance.stationary import Status

SILENT = range(30, 42)
"""Scans in which the target is not detected."""
SONARS = {
    0.1: SensorModel(
        range_std_fraction=0.005,
        azimuth_std=math.radians(0.5),
        max_range=100.0,
        azimuth_min=-math.radians(65.0),
        azimuth_max=math.radians(65.0),
    ),
    12.0: SensorModel(),
}
"""By the interval of their scans, s."""


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("interval", SONARS)
def test_a_silent_target_is_withheld_and_comes_back_under_its_id(interval, seed):
    rng, sensor = np.random.default_rng([seed, 37]), SONARS[interval]
    initiator = make_initiator("score", sensor=sensor, max_speed=10.0)
    reach, published = sensor.max_range, []
    for scan in range(70):
        place = np.array([0.5 * reach, -0.1 * reach + interval * scan])
        number = rng.poisson(2.0)
        range_ = reach * np.sqrt(rng.random(number))
        azimuth = rng.uniform(sensor.azimuth_min, sensor.azimuth_max, number)
        error = rng.standard_normal(2) * [sensor.range_std_fraction, sensor.azimuth_std]
        if rng.random() < 0.9 and scan not in SILENT:
            range_ = np.append(range_, np.hypot(*place) * (1.0 + error[0]))
            azimuth = np.append(azimuth, math.atan2(place[1], place[0]) + error[1])
        initiator.process(Scan(interval * scan, range_, azimuth))
        apart = np.hypot(*(initiator.current.state[:, 0::2] - place).T)
        published.append(initiator.current.track_id[apart < 0.1 * reach].tolist())
        if scan == SILENT[-1]:
            held = initiator.maintenance.held
            assert held.status[held.tracks.track_id == published[SILENT[0] - 1]] == Status.WITHHELD
    assert len(published[SILENT[0] - 1]) == 1
    assert published[SILENT[-1]] == []
    assert published[-1] == published[SILENT[0] - 1]
    assert initiator.maintenance.ended == {}


@pytest.mark.parametrize("method", ["score", "tsepm"])
def test_a_start_that_is_recognised_revises_its_track_instead_of_a_new_one(method, monkeypatch):
    sensor = SensorModel(range_std=5.0, range_std_fraction=0.0, max_range=5000.0)
    initiator = make_initiator(method, sensor=sensor, max_speed=10.0)
    new, revised = [], []
    for scan in range(24):
        if scan == 12:
            monkeypatch.setattr(
                initiator.maintenance, "recognised", lambda starts, _: np.zeros(len(starts), int)
            )
        y = 2000.0 if scan < 12 else -2000.0
        place = np.array([1000.0 + 60.0 * scan, y])
        new += initiator.process(Scan(12.0 * scan, [np.hypot(*place)], [math.atan2(y, place[0])]))
        revised += initiator.revised
    assert new[0].track_id == 0
    if not initiator.method.most_tracks_true:
        assert [track.track_id for track in new] != [0], "its starts may well be false"
        return
    assert [track.track_id for track in new] == [0]
    again = [track for track in revised if track.position[1] < 0.0]
    assert [(track.track_id, track.revision) for track in again] == [(0, 1)]
    assert initiator.current.track_id.tolist() == [0]
    assert initiator.current.state[0, 2] < 0.0
    assert initiator.totals.confirmed == 1
