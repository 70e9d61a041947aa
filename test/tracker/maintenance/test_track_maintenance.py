"""Confirmed tracks are carried, updated by their own detections, and ended."""

import math

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, detections
from support.held import CLUTTER, MAX_SPEED, NOTHING, P_D, UNSEEN, holding, ids, step, tracks

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import convert


def test_a_changed_hold_time_counts_at_the_next_scan():
    hold = holding(1, hold_time=100.0)
    hold.hold_time = 5.0
    assert ids(hold) == [1]
    step(hold, 6.0)
    assert list(hold.ended) == [1]


@pytest.mark.parametrize("interval", [0.1, 12.0])
def test_without_a_hold_time_the_longest_coast_is_fifty_scans(interval):
    hold = TrackMaintenance()
    hold.add(tracks(1), 0.9)
    for scan in range(1, 52):
        hold.step(
            interval * scan,
            NOTHING,
            np.zeros(0),
            lambda positions: np.full(len(positions), UNSEEN),
            FIXED_RANGE_ERROR,
            MAX_SPEED,
            interval,
        )
        assert hold.ended == ({} if scan < 51 else {1: "not_detected"})


def follow(velocity_at, *, misses: frozenset[int] = frozenset(), scans: int = 60):
    """Hold a target in clutter; returns the hold and the target's state at the end."""
    rng = np.random.default_rng(1)
    sensor = FIXED_RANGE_ERROR
    hold = holding(1)
    truth = np.array([2000.0, 1000.0])
    for scan in range(1, scans):
        time = 12.0 * scan
        truth = truth + 12.0 * np.asarray(velocity_at(time))
        seen = rng.uniform([1000.0, -1.0], [8000.0, 1.0], (40, 2))
        if scan not in misses:
            polar = np.hypot(*truth), math.atan2(truth[1], truth[0])
            seen[0] = rng.normal(polar, [sensor.range_std, sensor.azimuth_std])
        found = convert(Scan(time, seen[:, 0], seen[:, 1]), sensor, scan)
        step(hold, time, found, P_D)
    return hold, truth, velocity_at(time)


@pytest.mark.parametrize(
    "velocity_at",
    [lambda time: (5.0, 0.0), lambda time: (5.0, 0.0) if time < 400 else (-2.0, 4.0)],
    ids=["straight", "turning"],
)
def test_a_target_in_clutter_is_held_and_followed(velocity_at):
    hold, position, velocity = follow(velocity_at, misses=frozenset({7, 19, 20, 36, 50}))
    (track,) = hold.current
    assert np.linalg.norm(track.position - position) < 150.0
    assert np.linalg.norm(track.velocity - velocity) < 3.0
    assert hold.held.existence[0] > 0.99


def test_no_held_speed_is_above_the_maximum_however_detections_jump():
    hold = holding(1, hold_time=1e6, existence=0.99)
    rng = np.random.default_rng(4)
    x, speeds = 2000.0, []
    for scan in range(1, 60):
        x += 12.0 * 9.5 + rng.normal(0.0, 60.0)
        scan_stamp = 12.0 * scan
        step(hold, scan_stamp, detections([[x, 1000.0]], scan_stamp, variance=900.0), P_D)
        speeds += [np.hypot(*track.velocity) for track in hold.current]
    assert max(speeds) > 8.0, "detections go by at 9.5 m/s"
    assert max(speeds) <= MAX_SPEED
    np.testing.assert_array_less(0.0, np.linalg.eigvalsh(hold.current.covariance))


@pytest.mark.long
def test_covariances_stay_positive_definite_and_numbers_finite():
    hold = holding(1, 2, 3)
    rng = np.random.default_rng(2)
    for scan in range(1, 1000):
        time = 0.1 * scan
        points = [*rng.uniform([0, 0], [8000, 4000], (rng.integers(0, 20), 2))]
        points += [[2000.0 + 5.0 * time, 1000.0 * k] for k in (1, 2, 3)]
        explained = step(hold, time, detections(points, time), P_D)
        assert np.isfinite(explained).all()
        assert np.linalg.eigvalsh(hold.held.tracks.covariance).min() > 0
        np.testing.assert_array_equal(
            hold.held.tracks.covariance, np.swapaxes(hold.held.tracks.covariance, 1, 2)
        )
    assert ids(hold) == [1, 2, 3]
    assert np.isfinite(hold.held.existence).all()


def test_a_fast_target_seen_exactly_is_not_lost_by_the_time_of_its_echo():
    sensor = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=1e-3)
    hold = TrackMaintenance(120.0)
    hold.add(tracks(1), 0.9)
    for scan in range(1, 20):
        stamp, lag = 12.0 * scan, 3.3
        found = convert(
            Scan(
                stamp,
                [math.hypot(2000.0 + 5.0 * (stamp + lag), 1000.0)],
                [math.atan2(1000.0, 2000.0 + 5.0 * (stamp + lag))],
                time_offset=[lag],
            ),
            sensor,
            scan,
        )
        hold.step(stamp, found, np.full(1, CLUTTER), lambda x: np.full(len(x), P_D), sensor, 20.0)
        assert hold.held.existence[0] > 0.9
    (track,) = hold.current
    assert np.hypot(*(track.position - [2000.0 + 5.0 * stamp, 1000.0])) < 5.0
