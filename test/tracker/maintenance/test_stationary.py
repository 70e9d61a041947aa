# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""What stands still, by the prior of speeds and the fits, and confirmed tracks not published."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import betaln
from support.builders import FIXED_RANGE_ERROR, detections
from support.confirmed import P_D, step, tracks

from tsepm_ros.tracker.maintenance import stationary
from tsepm_ros.tracker.maintenance.stationary import StraightFits, stationary_probability
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.options import CommonOptions


def plain_probability(velocity, spread, prior: CommonOptions, share: float) -> float:
    """The same by sums over a fine grid of velocities, part by part of the prior."""
    step_size = prior.max_speed / 600.0
    axis = np.arange(-prior.max_speed, prior.max_speed + step_size, step_size)
    vx, vy = np.meshgrid(axis, axis)
    speed = np.hypot(vx, vy)
    inverse = np.linalg.inv(spread)
    scale = 2.0 * math.pi * math.sqrt(np.linalg.det(spread))

    def likelihood(x, y):
        x, y = x - velocity[0], y - velocity[1]
        square = inverse[0, 0] * x * x + 2.0 * inverse[0, 1] * x * y + inverse[1, 1] * y * y
        return np.exp(-0.5 * square) / scale

    everywhere = likelihood(vx, vy)
    still = likelihood(0.0, 0.0)
    if prior.min_speed:
        still = 0.5 * (still + everywhere[speed < prior.min_speed].mean())
    shares, limits = [], []
    for number, part in enumerate((0.5, 0.25, 0.125, 0.125)):
        limit = prior.max_speed / 2**number
        if number == 0 or limit >= 2.0 * prior.min_speed:
            shares.append(part)
            limits.append(limit)
    fast = sum(
        part / sum(shares) * everywhere[(speed >= prior.min_speed) & (speed <= limit)].mean()
        for part, limit in zip(shares, limits, strict=True)
    )
    return share * still / (share * still + (1.0 - share) * fast)


@pytest.mark.parametrize("min_speed", [0.0, 0.4, 1.5])
@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.6, -0.2), (-1.0, 2.0), (4.9, 0.0)])
def test_the_probability_is_that_of_sums_over_velocities(min_speed, velocity):
    prior = CommonOptions(min_speed=min_speed, max_speed=5.0)
    spread = np.array([[0.3, 0.1], [0.1, 0.15]])
    state = np.array([[100.0, velocity[0], -50.0, velocity[1]]])
    covariance = np.diag([9.0, 0.0, 9.0, 0.0])[None].copy()
    covariance[0, 1::2, 1::2] = spread
    found = stationary_probability(prior, state, covariance, 0.7)
    expected = plain_probability(velocity, spread, prior, 0.7)
    np.testing.assert_allclose(found, expected, rtol=0.01, atol=1e-6)


def test_far_beyond_every_speed_nothing_stands_still_and_nothing_known_is_the_share():
    prior = CommonOptions(min_speed=0.5, max_speed=5.0)
    state = np.array([[0.0, 300.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, np.nan, 0.0, 0.0]])
    covariance = np.stack([np.eye(4), 1e8 * np.eye(4), np.eye(4)])
    first, second, third = stationary_probability(prior, state, covariance, 0.9)
    assert first < 1e-12
    np.testing.assert_allclose(second, 0.9, rtol=1e-4)
    assert 0.9 < third < 1.0


def moving(speed, deviation, long=1.0):
    """States and covariances (1, ...) with a speed along x and its deviation, `long` along y."""
    state = np.array([[100.0, speed, -50.0, 0.0]])
    return state, np.diag([9.0, deviation**2, 9.0, (long * deviation) ** 2])[None]


@pytest.mark.parametrize("min_speed", [0.0, 0.4])
@pytest.mark.parametrize("speed", [1.0, 4.99])
@pytest.mark.parametrize("long", [1e-3, 1.0])
def test_velocities_certain_to_move_have_the_probability_of_the_integral(min_speed, speed, long):
    prior = CommonOptions(min_speed=min_speed, max_speed=5.0)
    deviation = (speed - min_speed) / stationary.CERTAIN_DEVIATIONS / math.sqrt(2.0)
    state, covariance = moving(speed, 0.99 * deviation, long)
    velocity, spread = state[:, 1::2], covariance[:, 1::2, 1::2]
    assert stationary_probability(prior, state, covariance, 0.9) == 0.0
    assert stationary._integrated(prior, velocity, spread, 0.9) < 1e-12


def batch_fit(times, positions, variance, stamp):
    """Least squares on all positions at once."""
    rows = np.vstack([np.kron(np.eye(2), [1.0, time - stamp]) for time in times])
    covariance = variance * np.linalg.inv(rows.T @ rows)
    return covariance @ rows.T @ np.ravel(positions) / variance, covariance


@pytest.mark.parametrize(("size", "interval"), [(1.0, 1.0), (0.01, 1.0), (1.0, 10.0), (40.0, 30.0)])
@pytest.mark.parametrize(("speed", "fixed"), [(0.0, True), (0.75, False)])
def test_what_stands_shows_at_any_scale_of_lengths_and_times(size, interval, speed, fixed):
    rng, unit = np.random.default_rng(7), size / interval
    sensor = replace(FIXED_RANGE_ERROR, range_std=5.0 * size, azimuth_std=0.01)
    hold = TrackMaintenance(
        CommonOptions(hold_time=1e6, min_speed=0.5 * unit, max_speed=10.0 * unit)
    )
    scale = np.array([size, unit, size, unit])
    state = np.array([[500.0, speed, 0.0, 0.0]]) * scale
    covariance = np.diag(np.square([5.0, 2.0, 5.0, 2.0] * scale))[None]
    start = replace(tracks(1), state=state, covariance=covariance, stamp=np.zeros(1))
    hold.add(start, 0.999)
    for scan in range(1, 120):
        place = size * (np.array([500.0 + scan * speed, 0.0]) + rng.normal(0.0, 5.0, 2))
        found = detections(place[None], scan * interval)
        found["azimuth_std"] = sensor.azimuth_std
        empty = np.array([1e-12 / size**2])
        hold.step(
            *(scan * interval, found, empty, lambda at: np.full(len(at), 0.9)),
            *(sensor, 10.0 * unit, interval),
        )
    assert (len(hold.fixed_echoes), len(hold.current)) == (fixed, not fixed)


def test_over_scans_the_fit_is_least_squares_on_all_detections(monkeypatch):
    monkeypatch.setattr(stationary, "PROCESS_NOISE", 0.0)
    rng = np.random.default_rng(5)
    sensor = FIXED_RANGE_ERROR
    times = np.arange(12.0)
    places = np.array([3000.0, 0.0]) + rng.normal(0.0, sensor.range_std, (12, 2))
    # Azimuth errors of the sensor at that range are as large as its range errors.
    sensor = replace(sensor, azimuth_std=sensor.range_std / 3000.0)
    state, covariance = batch_fit(times[:4], places[:4], sensor.range_std**2, times[3])
    track = replace(tracks(1), state=state[None], covariance=covariance[None])
    hold = TrackMaintenance(CommonOptions(hold_time=1e6))
    hold.add(replace(track, stamp=times[3:4]), 0.999)
    for time, place in zip(times[4:], places[4:], strict=True):
        found = detections(place[None], time)
        found["azimuth_std"] = sensor.azimuth_std
        hold.step(time, found, np.array([1e-12]), lambda at: np.full(len(at), 0.9), sensor, 10.0)
    expected, spread = batch_fit(times, places, sensor.range_std**2, times[-1])
    fits = hold.confirmed.fits
    sigma = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(fits.state[0] / sigma, expected / sigma, atol=0.05)
    np.testing.assert_allclose(np.sqrt(np.diag(fits.covariance[0])), sigma, rtol=0.02)
    probability = stationary_probability(CommonOptions(), expected[None], spread[None], 0.9)
    found = fits.stationary_probability(CommonOptions(), np.zeros(1))
    share = stationary.STATIONARY_SHARE
    odds = probability / (1.0 - probability) / 9.0 * share / (1.0 - share)
    np.testing.assert_allclose(found, odds / (1.0 + odds), rtol=0.05)


def test_places_are_the_fits_given_that_the_targets_stand_still():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(4, 4))
    covariance = root @ root.T + np.eye(4)
    state = rng.normal(size=4)
    place, spread = StraightFits.from_states(state[None], covariance[None]).places()
    # A measurement of the velocity, zero and without error, as a Kalman update.
    pick = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    gain = covariance @ pick.T @ np.linalg.inv(pick @ covariance @ pick.T)
    expected = state - gain @ pick @ state
    left = covariance - gain @ pick @ covariance
    np.testing.assert_allclose(place[0], expected, atol=1e-12)
    np.testing.assert_allclose(spread[0][0::2, 0::2], left[0::2, 0::2], atol=1e-12)
    np.testing.assert_allclose(spread[0][1::2, 1::2], covariance[1::2, 1::2])
    assert np.linalg.eigvalsh(spread[0]).min() > 0.0


def test_the_share_of_rest_is_learned_from_the_tracks_held_by_bayes():
    # By the sum over all ways to be at rest, with the moments of the Beta density of the share.
    prior = CommonOptions(min_speed=0.3, max_speed=5.0)
    spread = np.diag([1.0, 1.0, 1.0, 1.0])[None] * np.array([1.0, 0.5, 0.2, 4.0])[:, None, None]
    fits = StraightFits.from_states(np.array([[0.0, v, 0.0, 0.0] for v in (0, 1, 2, 0)]), spread)
    even = stationary_probability(prior, fits.state, fits.covariance, 0.5)
    exists = np.array([1.0, 0.9, 0.5, np.nan])
    a = stationary.PRIOR_TRACKS * stationary.STATIONARY_SHARE
    b = stationary.PRIOR_TRACKS - a
    for track in range(4):
        r = np.where(np.arange(4) == track, 1.0, np.nan_to_num(exists))
        mass = np.zeros(2)
        for kinds in itertools.product(("rest", "moves", "none"), repeat=4):
            rest, moves = kinds.count("rest"), kinds.count("moves")
            weight = math.exp(betaln(a + rest, b + moves) - betaln(a, b))
            for kind, p, exist in zip(kinds, even, r, strict=True):
                weight *= {"rest": exist * p, "moves": exist * (1 - p), "none": 1 - exist}[kind]
            mass[int(kinds[track] == "rest")] += weight
        found = fits.stationary_probability(prior, exists)[track]
        np.testing.assert_allclose(found, mass[1] / mass.sum(), rtol=1e-3)
    # Of twenty tracks that surely stand still, the next start of which nothing is known is another.
    spread = np.stack([np.diag([1e-6] * 4)] * 20 + [np.diag([1.0, 2500.0, 1.0, 2500.0])])
    many = StraightFits.from_states(np.zeros((21, 4)), spread)
    assert many.stationary_probability(prior, np.ones(21))[20] > 0.5
    assert many[np.array([20])].stationary_probability(prior, np.ones(1))[0] < 0.5


def test_one_detection_changes_the_odds_of_a_change_by_a_bounded_factor():
    hold = TrackMaintenance(CommonOptions(hold_time=1e6))
    hold.add(tracks(1), 0.99)
    before = hold.confirmed.fits.change_odds[0]
    # Far from the fit, but within the gate of a turn.
    step(hold, 12.0, detections([[2060.0, 1400.0]], 12.0), P_D)
    begun = -math.expm1(-12.0 / stationary.TIME_TO_CHANGE)
    after = hold.confirmed.fits.change_odds[0]
    assert after <= (before + begun) / stationary.GLITCH_SHARE
