"""Confirmed tracks are carried, updated by their own detections, and ended."""

import itertools
import math
from collections.abc import Collection

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR
from support.held import MAX_SPEED, NOTHING, P_D, UNSEEN, holding, ids, step, tracks

from tsepm_ros import Scan
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.maintenance.data_association import (
    GATE_PROBABILITY,
    SCANS_OF_FADING,
    SCANS_TO_FADE,
    SCANS_TO_VANISH,
)
from tsepm_ros.tracker.maintenance.track_maintenance import MIN_EXISTENCE, TrackMaintenance
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


def follow(velocity_at, misses: Collection[int], scans: int = 60, seed: int = 1):
    """Hold a target in clutter; returns the hold and the target's state at the end."""
    rng = np.random.default_rng(seed)
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


def test_a_target_that_turns_in_clutter_is_held_and_followed():
    def velocity_at(time):
        return (5.0, 0.0) if time < 400 else (-2.0, 4.0)

    hold, position, velocity = follow(velocity_at, misses={7, 19, 20, 36, 50})
    (track,) = hold.current
    assert np.linalg.norm(track.position - position) < 150.0
    assert np.linalg.norm(track.velocity - velocity) < 3.0
    assert hold.held.existence[0] > 0.99


def test_a_target_that_vanishes_in_clutter_is_given_up():
    runs = [follow(lambda _: (5.0, 0.0), range(31, 43), scans=43, seed=seed) for seed in range(12)]
    assert np.median([len(hold.current) for hold, *_ in runs]) == 0


@pytest.mark.parametrize("interval", [0.1, 12.0])
def test_a_target_may_fade_and_is_given_up_after_the_same_scans_at_any_rate(monkeypatch, interval):
    # A target is seen, faded or gone: a hidden Markov chain, followed in plain matrices.
    monkeypatch.setattr(motion, "SCANS_TO_TURN", math.inf)
    fade, appear, vanish = 1.0 / SCANS_TO_FADE, 1.0 / SCANS_OF_FADING, 1.0 / SCANS_TO_VANISH
    fading = np.array([[1.0 - fade, fade, 0.0], [appear, 1.0 - appear, 0.0], [0.0, 0.0, 1.0]])
    leaving = np.array([[1.0 - vanish, 0.0, vanish], [0.0, 1.0 - vanish, vanish], [0.0, 0.0, 1.0]])
    hold, chain = holding(1), np.array([0.9, 0.0, 0.1])
    for scan in itertools.count(1):
        step(hold, interval * scan, detectable=P_D)
        chain = chain @ fading @ leaving * [1.0 - P_D * GATE_PROBABILITY, 1.0, 1.0]
        chain /= chain.sum()
        if chain[:2].sum() < MIN_EXISTENCE:
            break
        np.testing.assert_allclose(hold.held.existence, [chain[:2].sum()], rtol=1e-9)
        np.testing.assert_allclose(hold.held.visible, [chain[0] / chain[:2].sum()], rtol=1e-9)
    assert hold.ended == {1: "missed"}
    assert 10 < scan < 60, "independent misses would end it after 4"
