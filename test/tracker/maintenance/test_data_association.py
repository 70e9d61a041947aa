"""Whether a target exists, and which detection is its: integrated data association."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from support.builders import detections
from support.held import CLUTTER, MAX_SPEED, P_D, holding, ids, step, tracks

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.maintenance import data_association
from tsepm_ros.tracker.maintenance.data_association import (
    GATE_PROBABILITY,
    SCANS_OF_FADING,
    SCANS_TO_FADE,
    SCANS_TO_VANISH,
)
from tsepm_ros.tracker.maintenance.track_maintenance import MIN_EXISTENCE, TrackMaintenance
from tsepm_ros.tracker.measurement import convert
from tsepm_ros.tracker.merging import SAME_SCANS


@pytest.mark.parametrize("existence", [0.5, 0.9])
def test_every_miss_makes_the_target_less_likely_by_bayes(straight, existence):
    hold = holding(1, existence=existence)
    for scan in itertools.count(1):
        step(hold, 12.0 * scan, detectable=P_D)
        missed = (1.0 - P_D * GATE_PROBABILITY) ** scan
        expected = existence * missed / (existence * missed + 1.0 - existence)
        if expected < MIN_EXISTENCE:
            break
        assert ids(hold) == [1]
        np.testing.assert_allclose(hold.held.existence, [expected])
    assert hold.ended == {1: "missed"}


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


def test_of_two_tracks_on_one_target_one_is_believed(straight):
    hold = holding(1)
    again = replace(tracks(1), track_id=np.array([7]))
    hold.add(again, 0.5)
    for scan in range(1, SAME_SCANS):
        found = detections([[2000.0 + 60.0 * scan, 1000.0]], 12.0 * scan)
        assert step(hold, 12.0 * scan, found, P_D)[0] > 100.0 * CLUTTER
    assert ids(hold) == [1]
    assert hold.held.existence[0] > 0.99


@pytest.mark.parametrize("interval", [0.1, 12.0])
def test_a_target_that_left_the_coverage_stays_away_or_comes_back_within_some_scans(interval):
    hold = holding(1, existence=0.9)
    for scan in itertools.count(1):
        step(hold, interval * scan, detectable=0.0)
        expected = 0.9 * (1.0 - 1.0 / SCANS_OF_FADING) ** scan
        if expected < MIN_EXISTENCE:
            break
        np.testing.assert_allclose(hold.held.existence, [expected])
    assert hold.ended == {1: "left"}


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


def test_a_detection_of_two_targets_is_shared():
    # Both targets surely exist and expect the one detection; each explains it against the other.
    ratios, row = np.full((2, 3, 1), 0.9), np.zeros((2, 2, 1), np.int64)
    modes, empty = np.array([[0.4, 0.6]] * 2), np.array([0.1, 0.1])
    found = data_association.associate(np.ones(2), empty, modes, ratios, row, np.array([1e-6]))
    factor = (0.1 + 0.9) / 0.1
    competing = 0.9 / factor
    np.testing.assert_allclose(found.ratio, competing)
    np.testing.assert_allclose(found.probability, competing / (0.1 + competing))
    np.testing.assert_allclose(found.held_density, 1e-6 * (factor**2 - 1.0))
