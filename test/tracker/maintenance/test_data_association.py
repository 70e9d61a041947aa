"""Whether a target exists, and which detection is its: integrated data association."""

import itertools
import math

import numpy as np
import pytest
from support.builders import detections
from support.held import MAX_SPEED, P_D, holding, step, tracks

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.maintenance.data_association import (
    GATE_PROBABILITY,
    SCANS_OF_FADING,
    SCANS_TO_FADE,
    SCANS_TO_VANISH,
)
from tsepm_ros.tracker.maintenance.track_maintenance import MIN_EXISTENCE, TrackMaintenance
from tsepm_ros.tracker.measurement import convert


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


@pytest.mark.parametrize("interval", [0.1, 12.0])
def test_after_misses_that_are_sure_to_be_seen_the_odds_are_those_of_the_module(interval):
    hold = holding(1, existence=1.0)
    kept = (1.0 - 1.0 / SCANS_OF_FADING) * (1.0 - 1.0 / SCANS_TO_VANISH)
    for misses in range(1, 31):
        step(hold, interval * misses, detectable=1.0 / GATE_PROBABILITY)
        odds = hold.held.existence[0] / (1.0 - hold.held.existence[0])
        said = SCANS_TO_VANISH / SCANS_TO_FADE * kept**misses
        assert 6.0 / 7.0 < odds / said < 7.0 / 6.0


def test_what_another_target_explains_leaves_a_track_its_own(straight):
    # Two echoes, and the track of the first may take both: the other's is the other's.
    found = detections([[2060.0, 1000.0], [2060.0, 1120.0]], 12.0)
    other = tracks(2)
    other.state[:, 2] = 1120.0
    other.covariance[:] = np.diag([10.0, 0.1, 10.0, 0.1]) ** 2
    alone, beside = holding(1), holding(1)
    beside.add(other, 0.99)
    unsure, explained = step(alone, 12.0, found, P_D), step(beside, 12.0, found, P_D)
    assert explained[0] > 3.0 * unsure[0]
    only = holding(1)
    step(only, 12.0, found[:1], P_D)
    aside = [
        np.abs(one.held.tracks.state[0] - only.held.tracks.state[0]) for one in (alone, beside)
    ]
    assert aside[1][2] < 0.2 * aside[0][2]


def test_what_is_detected_beyond_the_coverage_is_taken_all_the_same():
    hold = holding(1)
    step(hold, 12.0, detections([[2060.0, 1000.0]], 12.0), detectable=0.0)
    assert hold.held.existence[0] > 0.9


@pytest.mark.parametrize("clutter", [1e-6, 5e-6])
def test_a_target_that_vanishes_in_clutter_is_given_up(clutter):
    rng = np.random.default_rng(3)
    sensor = SensorModel(clutter_density=clutter)
    scans_after = []
    for _ in range(12):
        hold = TrackMaintenance(120.0)
        hold.add(tracks(1, x=4000.0), 0.9)
        for scan in range(1, 200):
            n = rng.poisson(clutter * sensor.coverage_area)
            range_ = 9000.0 * np.sqrt(rng.uniform(1e-6, 1.0, n))
            azimuth = rng.uniform(-math.pi, math.pi, n)
            if scan <= 30:
                x = 4000.0 + 60.0 * scan
                polar = np.hypot(x, 1000.0), math.atan2(1000.0, x)
                range_ = np.append(range_, rng.normal(polar[0], 0.015 * polar[0]))
                azimuth = np.append(azimuth, rng.normal(polar[1], sensor.azimuth_std))
            found = convert(Scan(12.0 * scan, range_, azimuth), sensor, scan)
            hold.step(
                12.0 * scan,
                found,
                np.full(len(found), clutter),
                lambda positions: np.full(len(positions), P_D),
                sensor,
                MAX_SPEED,
            )
            if scan > 30 and not len(hold.current):
                break
        scans_after.append(scan - 30)
    assert np.median(scans_after) <= 12
