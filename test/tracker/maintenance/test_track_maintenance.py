"""Confirmed tracks are carried, updated by their own detections, and ended."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, detections
from support.held import MAX_SPEED, NOTHING, P_D, UNSEEN, holding, ids, step, tracks

from tsepm_ros import Scan
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import convert
from tsepm_ros.tracker.motion import PROCESS_NOISE


def test_a_track_is_held_for_its_time_and_ends_once_at_the_first_scan_after():
    hold = holding(1, hold_time=30.0)
    step(hold, 30.0)
    assert ids(hold) == [1]
    assert list(hold.ended) == []
    step(hold, 30.1)
    assert ids(hold) == []
    assert list(hold.ended) == [1]
    step(hold, 40.0)
    assert list(hold.ended) == []


def test_tracks_are_carried_to_the_scan_s_stamp_at_constant_velocity(straight):
    hold = holding(1)
    hold.add(tracks(2, stamp=0.0), 0.9)
    step(hold, 10.0)
    step(hold, 25.0)
    first, second = hold.current
    assert (first.stamp, first.age) == (25.0, 25.0)
    np.testing.assert_allclose(first.state, [2125.0, 5.0, 1000.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(second.state, [2125.0, 5.0, 2000.0, 0.0], atol=1e-12)
    # White acceleration over 25 s: q t, and position q t^3 / 3 beside the velocity's own part.
    np.testing.assert_allclose(first.covariance[1, 1], 4.0 + PROCESS_NOISE * 25.0)
    np.testing.assert_allclose(
        first.covariance[0, 0], 2500.0 + 4.0 * 25.0**2 + PROCESS_NOISE * 25.0**3 / 3.0
    )


def test_a_detection_of_its_own_lets_a_track_live_on():
    hold = holding(1, hold_time=30.0)
    step(hold, 24.0, detections([[2120.0, 1000.0]], 24.0), P_D)
    step(hold, 50.0)
    assert ids(hold) == [1]
    step(hold, 54.1)
    assert list(hold.ended) == [1]


def test_a_detection_far_off_is_not_its_own():
    hold = holding(1, hold_time=30.0)
    step(hold, 24.0, detections([[9000.0, 1000.0]], 24.0), P_D)
    step(hold, 30.1)
    assert list(hold.ended) == [1]


def test_a_track_that_is_over_its_time_takes_nothing_any_more():
    hold = holding(1, hold_time=30.0)
    explained = step(hold, 30.1, detections([[2150.5, 1000.0]], 30.1), P_D)
    assert explained.tolist() == [0.0]
    assert list(hold.ended) == [1]


def test_clearing_ends_every_track_and_the_next_step_names_it_once():
    hold = holding(1, 5)
    hold.clear()
    assert ids(hold) == []
    step(hold, 10.0)
    assert list(hold.ended) == [1, 5]
    step(hold, 20.0)
    assert list(hold.ended) == []


def test_ended_tracks_are_not_remembered_for_ever():
    hold = TrackMaintenance(5.0)
    for scan in range(100):
        hold.add(tracks(scan, stamp=12.0 * scan), 0.9)
        step(hold, 12.0 * scan + 12.0)
        assert list(hold.ended) == [scan]


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


def test_claims_are_those_of_the_last_scan():
    hold = holding(1)
    step(hold, 12.0, detections([[2060.0, 1000.0]], 12.0), P_D)
    assert [one.tolist() for one in hold.held_association] == [[0], pytest.approx([1.0], abs=0.01)]
    step(hold, 24.0, detections([[9000.0, 1000.0]], 24.0), P_D)
    assert [len(one) for one in hold.held_association] == [0, 0]
    step(hold, 36.0, detections([[2180.0, 1000.0]], 36.0), P_D)
    hold.clear()
    assert [len(one) for one in hold.held_association] == [0, 0]


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
