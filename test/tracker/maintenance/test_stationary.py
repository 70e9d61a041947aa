"""What stands still, by the prior of speeds and the fits, and held tracks not published."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, detections
from support.held import CLUTTER, P_D, published, step, tracks

from tsepm_ros.tracker.maintenance import stationary
from tsepm_ros.tracker.maintenance.stationary import StraightFits, stationary_probability
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays


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
    fits = hold.held.fits
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
    place, spread = StraightFits.of(state[None], covariance[None]).places()
    # A measurement of the velocity, zero and without error, as a Kalman update.
    pick = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    gain = covariance @ pick.T @ np.linalg.inv(pick @ covariance @ pick.T)
    expected = state - gain @ pick @ state
    left = covariance - gain @ pick @ covariance
    np.testing.assert_allclose(place[0], expected, atol=1e-12)
    np.testing.assert_allclose(spread[0][0::2, 0::2], left[0::2, 0::2], atol=1e-12)
    np.testing.assert_allclose(spread[0][1::2, 1::2], covariance[1::2, 1::2])
    assert np.linalg.eigvalsh(spread[0]).min() > 0.0


def test_the_share_of_rest_is_that_of_the_tracks_held():
    # Of twenty tracks that surely stand still, the next start of which nothing is known is another.
    prior, number = CommonOptions(min_speed=0.3, max_speed=5.0), 20
    still, vague = np.diag([1.0, 1e-3, 1.0, 1e-3]) ** 2, np.diag([1.0, 50.0, 1.0, 50.0]) ** 2
    covariance = np.stack([still] * number + [vague])
    fits = StraightFits.of(np.zeros((number + 1, 4)), covariance)
    found = fits.stationary_probability(prior, np.ones(number + 1))
    share, weight = stationary.STATIONARY_SHARE, stationary.PRIOR_TRACKS
    even = stationary_probability(prior, np.zeros((1, 4)), vague[None], 0.5)[0]

    def posterior(share: float) -> float:
        return share * even / (share * even + (1.0 - share) * (1.0 - even))

    # The fixed point of the share, by bisection.
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        mean = (weight * share + number + posterior(middle)) / (weight + number + 1.0)
        low, high = (middle, high) if mean > middle else (low, middle)
    np.testing.assert_allclose(found[:number], 1.0, atol=1e-3)
    np.testing.assert_allclose(found[number], posterior(low), atol=0.02)
    alone = fits[np.array([number])].stationary_probability(prior, np.ones(1))
    assert alone[0] < 0.5 < found[number]


def test_one_detection_changes_the_odds_of_a_change_by_a_bounded_factor():
    hold = TrackMaintenance(CommonOptions(hold_time=1e6))
    hold.add(tracks(1), 0.99)
    before = hold.held.fits.change_odds[0]
    # Far from the fit, but within the gate of a turn.
    step(hold, 12.0, detections([[2060.0, 1400.0]], 12.0), P_D)
    begun = -math.expm1(-12.0 / stationary.TIME_TO_CHANGE)
    after = hold.held.fits.change_odds[0]
    assert after <= (before + begun) / stationary.GLITCH


def follow(hold: TrackMaintenance, path, stamps, rng) -> None:
    """Detections of a target on a path, without clutter."""
    for stamp in stamps:
        seen = np.asarray(path(stamp)) + rng.normal(0.0, 3.0, 2)
        found = detections(seen[None], stamp, 9.0)
        found["range_std"], found["azimuth_std"] = 3.0, 0.001
        hold.step(
            stamp,
            found,
            np.full(1, CLUTTER),
            lambda at: np.full(len(at), P_D),
            FIXED_RANGE_ERROR,
            10.0,
        )


def test_a_track_that_stops_becomes_a_fixed_echo_and_comes_back_under_its_id():
    rng = np.random.default_rng(4)
    hold = TrackMaintenance(CommonOptions(hold_time=1e6, min_speed=0.5))
    state = np.array([[2000.0, 5.0, 1000.0, 0.0]])
    covariance = np.diag([3.0, 0.3, 3.0, 0.3])[None] ** 2
    hold.add(replace(tracks(1), state=state, covariance=covariance), 0.99)
    follow(hold, lambda t: (2000.0 + 5.0 * min(t, 60.0), 1000.0), np.arange(1.0, 60.0), rng)
    assert hold.current.track_id.tolist() == [1]
    assert hold.current.stationary_probability[0] < 0.01
    follow(hold, lambda t: (2300.0, 1000.0), np.arange(61.0, 200.0), rng)
    assert len(hold.current) == 0
    (echo,) = hold.fixed_echoes
    assert (echo.track_id, echo.since, echo.stamp) == (1, 0.0, 199.0)
    np.testing.assert_allclose(echo.position, [2300.0, 1000.0], atol=3.0)
    assert echo.velocity.tolist() == [0.0, 0.0]
    follow(hold, lambda t: (2300.0 + 3.0 * (t - 200.0), 1000.0), np.arange(200.0, 240.0), rng)
    assert (hold.current.track_id.tolist(), len(hold.fixed_echoes)) == ([1], 0)
    assert len(hold.released) == 0, "it is no new track"


LONG = CommonOptions(hold_time=1e6)
SLOW = replace(LONG, min_speed=8.0)
"""Under these options the tracks of `support.held`, at 5 m/s, count as standing still."""


def holding(*track_ids: int, options: CommonOptions = SLOW) -> TrackMaintenance:
    hold = TrackMaintenance(options)
    hold.add(tracks(*track_ids), 0.9)
    return hold


def echoes(hold: TrackMaintenance) -> list[int]:
    return [echo.track_id for echo in hold.fixed_echoes]


def test_the_end_of_what_was_never_published_is_not_told():
    hold = holding(1, 2, options=replace(SLOW, hold_time=30.0))
    for scan in range(1, 60):
        step(hold, 12.0 * scan, detectable=P_D)
        assert hold.ended == {}
    assert len(hold.held) == 0
    hold = holding(1)
    hold.clear()
    step(hold, 1.0)
    assert hold.ended == {}


def test_min_speed_does_not_take_back_what_was_published():
    hold = holding(1, options=LONG)
    hold.options = SLOW
    step(hold, 12.0)
    assert (published(hold), echoes(hold)) == ([1], [])
    assert hold.current.stationary_probability[0] > 0.5


def test_a_downstream_tracker_does_not_decline_what_it_never_heard_of():
    hold = holding(1)
    for stamp in np.arange(10.0, 160.0, 10.0):
        step(hold, stamp, detections([[2000.0 + 5.0 * stamp, 1000.0]], stamp, 400.0), P_D)
        if stamp in (10.0, 80.0, 150.0):
            hold.follow(stamp, TrackArrays.of([]))
    assert len(hold.held) == 1
    # Its time begins when the track is published.
    hold.options = LONG
    step(hold, 160.0, detections([[2800.0, 1000.0]], 160.0, 400.0), P_D)
    assert published(hold) == [1]
    hold.follow(200.0, TrackArrays.of([]))
    assert published(hold) == [1]
    hold.follow(230.0, TrackArrays.of([]))
    assert published(hold) == []


def test_a_fixed_echo_outside_the_coverage_is_remembered_as_it_is_and_never_published():
    hold = holding(1)
    for stamp in range(12, 61, 12):
        step(hold, stamp, detections([[2000.0, 1000.0]], stamp, 400.0), P_D)
    before = hold.fixed_echoes
    for stamp in range(72, 6000, 12):
        step(hold, stamp, detectable=0.0)
    after = hold.fixed_echoes
    assert after.track_id.tolist() == [1]
    np.testing.assert_allclose(after.state, before.state, rtol=1e-9)
    np.testing.assert_allclose(after.covariance, before.covariance, rtol=1e-6)
    hold.options = LONG
    step(hold, 6012.0, detectable=0.0)
    assert len(hold.released) == len(hold.current) == len(hold.held) == 0


def test_an_existence_that_is_not_known_leaves_the_others_their_probability_to_stand_still():
    fits = holding(1, 2, 3).held.fits
    alone = fits[np.array([0, 1])].stationary_probability(SLOW, np.array([0.9, 0.8]))
    found = fits.stationary_probability(SLOW, np.array([0.9, 0.8, np.nan]))
    np.testing.assert_allclose(found[:2], alone)


def test_what_is_held_back_claims_its_detections_as_every_held_track_does():
    back, shown = holding(1), holding(1, options=LONG)
    assert (published(back), published(shown)) == ([], [1])
    scan = detections([[2060.0, 1000.0], [2000.0, 9000.0]], 12.0)
    np.testing.assert_array_equal(step(back, 12.0, scan, P_D), step(shown, 12.0, scan, P_D))
    for one, other in zip(back.held_association, shown.held_association, strict=True):
        np.testing.assert_array_equal(one, other)
    assert back.held_association[1][0] > 0.9
    assert (published(back), echoes(back)) == ([], [1])


def test_what_exists_hardly_is_neither_published_nor_a_fixed_echo():
    hold = TrackMaintenance(SLOW)
    hold.add(tracks(1), 0.3)
    assert echoes(hold) == []
    hold.options = LONG
    step(hold, 1.0)
    assert (published(hold), len(hold.held)) == ([], 1)


def test_what_a_downstream_tracker_lists_is_published():
    hold = holding(1)
    hold.follow(5.0, tracks(1, 7, stamp=5.0))
    assert published(hold) == [1, 7]
    step(hold, 6.0)
    assert len(hold.released) == 0
