"""Confirmed tracks held: carried, updated by their own detections, and ended."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from support.builders import FIXED_RANGE_ERROR, detections

from tsepm_ros import ConfirmedTrack, Scan, SensorModel, make_initiator
from tsepm_ros.kinematics import interacting_models as motion_module
from tsepm_ros.kinematics.interacting_models import PROCESS_NOISE
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.maintenance import held_tracks as holding_module
from tsepm_ros.maintenance.held_tracks import (
    GATE_PROBABILITY,
    LEAST_EXISTENCE,
    SAME_SCANS,
    TIME_OF_FADING,
    TIME_TO_FADE,
    TIME_TO_VANISH,
    TRACKED_EXISTENCE,
    Tracker,
    TrackHold,
)
from tsepm_ros.sensing.conversion import convert, covariance_at

NOTHING = detections(np.zeros((0, 2)), 0.0)
CLUTTER = 1e-6
P_D = 0.9
MAX_SPEED = 10.0


@pytest.fixture
def straight(monkeypatch):
    """Targets neither turn nor fade nor vanish: what is left has closed forms."""
    monkeypatch.setattr(motion_module, "TIME_TO_TURN", math.inf)
    monkeypatch.setattr(holding_module, "TIME_TO_FADE", math.inf)
    monkeypatch.setattr(holding_module, "TIME_TO_VANISH", math.inf)


def tracks(*ids: int, stamp: float = 0.0, x: float = 2000.0) -> TrackArrays:
    """Tracks 1 km apart that go 5 m/s along x."""
    return TrackArrays.of(
        [
            ConfirmedTrack(
                track_id=track_id,
                stamp=stamp,
                state=np.array([x, 5.0, 1000.0 * track_id, 0.0]),
                covariance=np.diag([50.0, 2.0, 50.0, 2.0]) ** 2,
                hits=((0, 0),),
                evaluation=0.0,
            )
            for track_id in ids
        ]
    )


def step(hold: TrackHold, stamp: float, found=NOTHING, detectable: float = 0.0) -> np.ndarray:
    """Without a chance to detect, a miss says nothing: tracks live for their hold time."""
    return hold.step(
        stamp,
        found,
        np.full(len(found), CLUTTER),
        lambda positions: np.full(len(positions), detectable),
        FIXED_RANGE_ERROR,
        MAX_SPEED,
    )


def ids(hold: TrackHold) -> list[int]:
    return [track.track_id for track in hold.current]


def holding(*track_ids: int, hold_time: float = 1e6, existence: float = 0.9) -> TrackHold:
    hold = TrackHold(hold_time)
    hold.add(tracks(*track_ids), existence)
    return hold


def test_a_track_is_held_for_its_time_and_ends_once_at_the_first_scan_after():
    hold = holding(1, hold_time=30.0)
    step(hold, 30.0)
    assert ids(hold) == [1]
    assert hold.ended == []
    step(hold, 30.1)
    assert ids(hold) == []
    assert hold.ended == [1]
    step(hold, 40.0)
    assert hold.ended == []


def test_tracks_are_carried_to_the_scan_s_stamp_at_constant_velocity(straight):
    hold = holding(1)
    hold.add(tracks(2, stamp=0.0), 0.9)
    step(hold, 10.0)
    step(hold, 25.0)
    first, second = hold.current
    assert (first.stamp, first.age) == (25.0, 25.0)
    np.testing.assert_allclose(first.state, [2125.0, 5.0, 1000.0, 0.0])
    np.testing.assert_allclose(second.state, [2125.0, 5.0, 2000.0, 0.0])
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
    assert hold.ended == [1]


def test_a_detection_far_off_is_not_its_own():
    hold = holding(1, hold_time=30.0)
    step(hold, 24.0, detections([[9000.0, 1000.0]], 24.0), P_D)
    step(hold, 30.1)
    assert hold.ended == [1]


def test_a_track_that_is_over_its_time_takes_nothing_any_more():
    hold = holding(1, hold_time=30.0)
    explained = step(hold, 30.1, detections([[2150.5, 1000.0]], 30.1), P_D)
    assert explained.tolist() == [0.0]
    assert hold.ended == [1]


def test_clearing_ends_every_track_and_the_next_step_names_it_once():
    hold = holding(1, 5)
    hold.clear()
    assert ids(hold) == []
    step(hold, 10.0)
    assert hold.ended == [1, 5]
    step(hold, 20.0)
    assert hold.ended == []


def test_what_was_cleared_and_asked_for_is_not_named_again():
    hold = holding(1)
    hold.clear()
    assert hold.take_cleared() == [1]
    step(hold, 10.0)
    assert hold.ended == []


def test_ended_tracks_are_not_remembered_for_ever():
    hold = TrackHold(5.0)
    for scan in range(100):
        hold.add(tracks(scan, stamp=12.0 * scan), 0.9)
        step(hold, 12.0 * scan + 12.0)
        assert hold.ended == [scan]


def test_a_changed_hold_time_counts_at_the_next_scan():
    hold = holding(1, hold_time=100.0)
    hold.hold_time = 5.0
    assert ids(hold) == [1]
    step(hold, 6.0)
    assert hold.ended == [1]


@pytest.mark.parametrize("existence", [0.5, 0.9])
def test_every_miss_makes_the_target_less_likely_by_bayes(straight, existence):
    hold = holding(1, existence=existence)
    for scan in itertools.count(1):
        step(hold, 12.0 * scan, detectable=P_D)
        missed = (1.0 - P_D * GATE_PROBABILITY) ** scan
        expected = existence * missed / (existence * missed + 1.0 - existence)
        if expected < LEAST_EXISTENCE:
            break
        assert ids(hold) == [1]
        np.testing.assert_allclose(hold._existence, [expected])
    assert hold.ended == [1]


def test_a_target_may_fade_and_is_given_up_later(monkeypatch):
    # A target is seen, faded or gone: a hidden Markov chain, followed in plain matrices.
    monkeypatch.setattr(motion_module, "TIME_TO_TURN", math.inf)
    fade, appear, vanish = 1.0 / TIME_TO_FADE, 1.0 / TIME_OF_FADING, 1.0 / TIME_TO_VANISH
    rates = np.array([[-fade - vanish, fade, vanish], [appear, -appear - vanish, vanish], [0] * 3])
    hold, chain = holding(1), np.array([0.9, 0.0, 0.1])
    for scan in itertools.count(1):
        step(hold, 2.5 * scan, detectable=P_D)
        chain = chain @ expm(2.5 * rates) * [1.0 - P_D * GATE_PROBABILITY, 1.0, 1.0]
        chain /= chain.sum()
        if chain[:2].sum() < LEAST_EXISTENCE:
            break
        np.testing.assert_allclose(hold._existence, [chain[:2].sum()], rtol=1e-9)
        np.testing.assert_allclose(hold._seen, [chain[0] / chain[:2].sum()], rtol=1e-9)
    assert hold.ended == [1]
    assert scan > 10, "independent misses would end it after 4"


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
    aside = [np.abs(one.current.state[0] - only.current.state[0]) for one in (alone, beside)]
    assert aside[1][2] < 0.2 * aside[0][2]


def test_of_two_tracks_on_one_target_one_is_believed(straight):
    hold = holding(1)
    again = replace(tracks(1), track_id=np.array([7]))
    hold.add(again, 0.5)
    for scan in range(1, SAME_SCANS):
        found = detections([[2000.0 + 60.0 * scan, 1000.0]], 12.0 * scan)
        assert step(hold, 12.0 * scan, found, P_D)[0] > 100.0 * CLUTTER
    assert ids(hold) == [1]
    assert hold._existence[0] > 0.99


def test_nothing_is_missed_where_nothing_can_be_detected():
    hold = holding(1)
    for scan in range(1, 50):
        step(hold, 12.0 * scan, detectable=0.0)
    assert ids(hold) == [1]


def kalman(
    stamp: float, position: np.ndarray, lag: float = 0.0
) -> tuple[np.ndarray, np.ndarray, float]:
    """Kalman update of `tracks(1)` with one detection; also its density N(z; H x, S)."""
    F = np.eye(4)
    F[0, 1] = F[2, 3] = stamp
    G = np.array([[stamp**3 / 3, stamp**2 / 2], [stamp**2 / 2, stamp]])
    Q = PROCESS_NOISE * np.kron(np.eye(2), G)
    track = tracks(1)[0]
    x, P = F @ track.state, F @ track.covariance @ F.T + Q
    H = np.zeros((2, 4))
    H[0, 0] = H[1, 2] = 1.0
    H[0, 1] = H[1, 3] = lag
    R = covariance_at(detections([position], stamp), (H @ x)[None], FIXED_RANGE_ERROR)[0]
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    v = position - H @ x
    density = math.exp(-0.5 * v @ np.linalg.solve(S, v)) / (
        2 * math.pi * math.sqrt(np.linalg.det(S))
    )
    return x + K @ v, P - K @ S @ K.T, density


def test_two_detections_are_weighed_as_probabilistic_data_association_does(straight):
    stamp, found = 12.0, np.array([[2080.0, 1030.0], [2010.0, 920.0]])
    hold = holding(1, existence=0.8)
    explained = step(hold, stamp, detections(found, stamp), P_D)
    updates = [kalman(stamp, position) for position in found]
    ratios = np.array([P_D * density / CLUTTER for *_, density in updates])
    miss = 1.0 - P_D * GATE_PROBABILITY
    # How much less likely the scan is where a detection is not there for the target.
    whole = 0.2 + 0.8 * (miss + ratios.sum())
    without = 0.2 + 0.8 * (miss + ratios[::-1])
    np.testing.assert_allclose(explained, CLUTTER * (whole / without - 1.0))
    weights = np.array([miss, *ratios]) / (miss + ratios.sum())
    row, claimed = hold.claims
    odds = 0.8 * (miss + ratios.sum())
    np.testing.assert_allclose(claimed[np.argsort(row)], weights[1:] * odds / (odds + 0.2))
    # The mixture: not updated, updated with the first, updated with the second.
    predicted = holding(1)
    step(predicted, stamp)
    parts = [(predicted.current.state[0], predicted.current.covariance[0])]
    parts += [(state, covariance) for state, covariance, _ in updates]
    mean = sum(w * state for w, (state, _) in zip(weights, parts, strict=True))
    spread = sum(
        w * (covariance + np.outer(state - mean, state - mean))
        for w, (state, covariance) in zip(weights, parts, strict=True)
    )
    (track,) = hold.current
    np.testing.assert_allclose(track.state, mean, rtol=1e-9)
    np.testing.assert_allclose(track.covariance, spread, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(hold._existence, [odds / (odds + 0.2)])


def test_claims_are_those_of_the_last_scan():
    hold = holding(1)
    step(hold, 12.0, detections([[2060.0, 1000.0]], 12.0), P_D)
    assert [one.tolist() for one in hold.claims] == [[0], pytest.approx([1.0], abs=0.01)]
    step(hold, 24.0, detections([[9000.0, 1000.0]], 24.0), P_D)
    assert [len(one) for one in hold.claims] == [0, 0]
    step(hold, 36.0, detections([[2180.0, 1000.0]], 36.0), P_D)
    hold.clear()
    assert [len(one) for one in hold.claims] == [0, 0]


def test_a_late_echo_is_taken_at_its_own_time_against_the_clutter_where_it_is(straight):
    stamp, lag, clutter = 12.0, 4.0, np.array([1e-4, 3e-6])
    found = detections([[9000.0, 9000.0], [2075.0, 1020.0]], [stamp, stamp + lag])
    hold = holding(1, existence=0.8)
    explained = hold.step(
        stamp,
        found,
        clutter,
        lambda positions: np.full(len(positions), P_D),
        FIXED_RANGE_ERROR,
        MAX_SPEED,
    )
    state, _, density = kalman(stamp, found["position"][1], lag)
    miss, ratio = 1.0 - P_D * GATE_PROBABILITY, P_D * density / clutter[1]
    np.testing.assert_allclose(
        explained, [0.0, clutter[1] * 0.8 * ratio / (0.2 + 0.8 * miss)], atol=1e-20
    )
    np.testing.assert_allclose(
        hold._existence, [0.8 * (miss + ratio) / (0.8 * (miss + ratio) + 0.2)]
    )
    weight = ratio / (miss + ratio)
    coasted = holding(1)
    step(coasted, stamp)
    mean = (1 - weight) * coasted.current.state[0] + weight * state
    np.testing.assert_allclose(hold.current.state[0], mean, rtol=1e-9)


@pytest.mark.parametrize(("sigmas", "inside"), [(3.03, True), (3.04, False)])
def test_the_gate_holds_its_probability(straight, sigmas, inside):
    # sqrt(-2 ln(1 - 0.99)) = 3.035 deviations of the innovation.
    centre = np.array([2060.0, 1000.0])
    predicted = holding(1)
    step(predicted, 12.0)
    spread = predicted.current.covariance[0][0::2, 0::2]
    spread = spread + covariance_at(detections([centre], 12.0), centre[None], FIXED_RANGE_ERROR)[0]
    offset = sigmas * np.linalg.cholesky(spread) @ [0.6, 0.8]
    explained = step(holding(1), 12.0, detections([centre + offset], 12.0), P_D)
    assert (explained[0] > 1e-9 * CLUTTER) == inside


def test_a_fast_target_seen_exactly_is_not_lost_by_the_time_of_its_echo():
    sensor = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=1e-3)
    hold = TrackHold(120.0)
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
        assert hold._existence[0] > 0.9
    (track,) = hold.current
    assert np.hypot(*(track.position - [2000.0 + 5.0 * stamp, 1000.0])) < 5.0


def test_what_is_detected_beyond_the_coverage_is_taken_all_the_same():
    hold = holding(1)
    step(hold, 12.0, detections([[2060.0, 1000.0]], 12.0), detectable=0.0)
    assert hold._existence[0] > 0.9


@pytest.mark.parametrize("clutter", [1e-6, 5e-6])
def test_a_target_that_vanishes_in_clutter_is_given_up(clutter):
    rng = np.random.default_rng(3)
    sensor = SensorModel(clutter_density=clutter)
    scans_after = []
    for _ in range(12):
        hold = TrackHold(120.0)
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
            if not len(hold.current):
                break
        scans_after.append(scan - 30)
    assert np.mean(np.array(scans_after) < 0) <= 0.1, "lost while it was there"
    assert np.median(scans_after) <= 30


def test_a_target_that_is_started_again_and_again_is_held_once():
    initiator = make_initiator("tsepm", sensor=SensorModel(range_std=15.0, range_std_fraction=0.0))
    rng = np.random.default_rng(1)
    for scan in range(300):
        x, y = 3000.0 + 0.5 * scan, 2000.0
        seen = rng.random() < P_D
        polar = math.hypot(x, y), math.atan2(y, x)
        initiator.process(
            Scan(
                12.0 * scan,
                [polar[0] + 15.0 * rng.standard_normal()] * seen,
                [polar[1] + initiator.sensor.azimuth_std * rng.standard_normal()] * seen,
            )
        )
    assert initiator.totals.confirmed > 20
    assert 1 <= len(initiator.hold.current) <= 3


def test_targets_that_cross_stay_two(straight):
    hold = TrackHold(1e6)
    hold.add(tracks(1), 0.9)
    hold.add(replace(tracks(2), state=np.array([[3000.0, -5.0, 1300.0, 0.0]])), 0.9)
    for scan in range(1, 30):
        time = 12.0 * scan
        points = [[2000.0 + 5.0 * time, 1000.0], [3000.0 - 5.0 * time, 1300.0]]
        step(hold, time, detections(points, time), P_D)
    assert ids(hold) == [1, 2]


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
    assert hold._existence[0] > 0.99


def test_covariances_stay_positive_definite_and_numbers_finite():
    hold = holding(1, 2, 3)
    rng = np.random.default_rng(2)
    for scan in range(1, 3000):
        time = 0.1 * scan
        points = [*rng.uniform([0, 0], [8000, 4000], (rng.integers(0, 20), 2))]
        points += [[2000.0 + 5.0 * time, 1000.0 * k] for k in (1, 2, 3)]
        explained = step(hold, time, detections(points, time), P_D)
        assert np.isfinite(explained).all()
        assert np.linalg.eigvalsh(hold.current.covariance).min() > 0
        np.testing.assert_array_equal(
            hold.current.covariance, np.swapaxes(hold.current.covariance, 1, 2)
        )
    assert ids(hold) == [1, 2, 3]
    assert np.isfinite(hold._existence).all()


def follow_tracker(hold: TrackHold, stamp: float, *listed: int) -> None:
    """The downstream tracker lists tracks where `tracks` has them after the time."""
    hold.follow(stamp, tracks(*listed, stamp=stamp, x=2000.0 + 5.0 * stamp))


def test_the_tracker_s_state_replaces_the_held_and_what_it_alone_has_joins(straight):
    hold = holding(1, 2)
    step(hold, 12.0)
    told = tracks(3, 1, stamp=14.0)
    told.state[:, 0] = 7000.0
    hold.follow(14.0, told)
    step(hold, 24.0)
    assert hold.ended == []
    one, two, three = hold.current
    assert [one.track_id, two.track_id, three.track_id] == [1, 2, 3]
    np.testing.assert_allclose(one.state, [7050.0, 5.0, 1000.0, 0.0])
    np.testing.assert_allclose(two.state, [2120.0, 5.0, 2000.0, 0.0])
    np.testing.assert_allclose(three.state, [7050.0, 5.0, 3000.0, 0.0])
    np.testing.assert_allclose(one.covariance[1, 1], 4.0 + PROCESS_NOISE * 10.0)
    assert {track.stamp for track in hold.current} == {24.0}
    assert (one.age, one.hits) == (24.0, ((0, 0),)), "its figures go on"
    np.testing.assert_allclose(
        hold._existence, [TRACKED_EXISTENCE, 0.9, TRACKED_EXISTENCE], rtol=1e-12
    )


def test_what_the_tracker_listed_and_lists_no_more_ends_once():
    hold = holding(1, 2)
    follow_tracker(hold, 0.0, 1, 2, 7)
    step(hold, 12.0)
    follow_tracker(hold, 12.0, 2)
    step(hold, 24.0)
    assert (hold.ended, ids(hold)) == ([1, 7], [2])
    follow_tracker(hold, 24.0)
    step(hold, 36.0)
    assert (hold.ended, ids(hold)) == ([2], [])
    step(hold, 48.0)
    assert hold.ended == []


def test_a_track_that_the_tracker_has_not_listed_ends_when_it_had_time_to():
    hold = holding(1)
    for stamp in (10.0, 20.0, 30.0, 60.0):
        follow_tracker(hold, stamp, 7)
        step(hold, stamp + 2.0)
        assert ids(hold) == [1, 7]
    hold.add(tracks(2, stamp=62.0), 0.9)
    follow_tracker(hold, 70.1, 7)
    step(hold, 72.0)
    assert (hold.ended, ids(hold)) == ([1], [7, 2]), "heard since 10 s, and not of 1"


def test_the_time_to_list_a_track_counts_only_while_the_tracker_is_heard():
    hold = holding(1)
    step(hold, 500.0)
    for stamp in (500.0, 550.0, 1000.0, 1060.0):  # silent between
        follow_tracker(hold, stamp, 7)
        step(hold, stamp)
        assert 1 in ids(hold)
    follow_tracker(hold, 1060.1, 7)
    step(hold, 1061.0)
    assert hold.ended == [1]


def test_a_track_that_is_not_listed_yet_is_held_by_the_own_rules():
    hold = holding(1, hold_time=30.0)
    for stamp in (0.0, 12.0, 24.0):
        follow_tracker(hold, stamp)
        step(hold, stamp + 7.0)
    assert hold.ended == [1]


def test_what_is_tracked_is_not_ended_by_misses(straight):
    hold = holding(hold_time=30.0)
    follow_tracker(hold, 0.0, 1)
    for stamp in (12.0, 24.0, 36.0, 48.0, 60.0):
        step(hold, stamp, detectable=P_D)
    assert ids(hold) == [1], "missed five times, and over the hold time"
    assert hold._existence[0] < LEAST_EXISTENCE
    step(hold, 60.1)
    assert (hold.ended, hold.tracker) == ([1], Tracker.SILENT)


def test_what_is_tracked_is_not_ended_as_a_repetition(straight):
    hold = holding(1)
    same = replace(tracks(1), track_id=np.array([7]))
    for stamp in range(2 * SAME_SCANS):
        hold.follow(stamp, same.predicted(stamp))
        step(hold, stamp + 0.5)
    assert ids(hold) == [1, 7]
    step(hold, 100.0)
    assert (hold.tracker, ids(hold)) == (Tracker.SILENT, [1])


def test_a_silent_tracker_s_tracks_are_held_for_their_time_from_what_it_said_last():
    hold = holding(hold_time=100.0)
    follow_tracker(hold, 0.0, 1)
    assert hold.tracker is Tracker.ALIVE
    step(hold, 60.0)
    assert hold.tracker is Tracker.ALIVE
    step(hold, 61.0)
    assert (hold.tracker, ids(hold)) == (Tracker.SILENT, [1])
    step(hold, 100.0)
    assert ids(hold) == [1]
    step(hold, 100.1)
    assert hold.ended == [1]


def test_a_tracker_that_comes_back_empty_gets_time_to_list_what_is_held():
    hold = holding()
    follow_tracker(hold, 0.0, 1, 2)
    step(hold, 100.0)
    follow_tracker(hold, 100.0)
    step(hold, 112.0)
    assert (hold.tracker, ids(hold)) == (Tracker.ALIVE, [1, 2])
    follow_tracker(hold, 112.0, 2)
    follow_tracker(hold, 160.1, 2)
    step(hold, 161.0)
    assert (hold.ended, ids(hold)) == ([1], [2])


def test_a_tracker_ahead_of_the_scan_is_carried_back(straight):
    hold = holding()
    hold.follow(30.0, tracks(1, stamp=30.0))
    step(hold, 10.0)
    (track,) = hold.current
    np.testing.assert_allclose(track.state, [1900.0, 5.0, 1000.0, 0.0])
    # Uncertainty grows backward too.
    np.testing.assert_allclose(track.covariance[1, 1], 4.0 + PROCESS_NOISE * 20.0)
    np.testing.assert_allclose(
        track.covariance[0, 0], 2500.0 + 4.0 * 20.0**2 + PROCESS_NOISE * 20.0**3 / 3.0
    )
    np.testing.assert_allclose(track.covariance[0, 1], -4.0 * 20.0 - PROCESS_NOISE * 20.0**2 / 2.0)


def test_a_target_may_have_turned_on_the_way_back_too():
    forward, backward = holding(), holding()
    forward.follow(0.0, tracks(1))
    backward.follow(40.0, tracks(1, stamp=40.0))
    for hold in (forward, backward):
        step(hold, 20.0)
    one, other = forward.current[0], backward.current[0]
    np.testing.assert_allclose(one.covariance.diagonal(), other.covariance.diagonal())
    assert other.covariance[1, 1] > 4.0 + 2.0 * PROCESS_NOISE * 20.0


def test_a_tracker_ahead_of_the_scan_makes_no_target_more_probable_than_it_said():
    hold = holding()
    hold.follow(50.0, tracks(1, stamp=50.0))
    step(hold, 10.0)
    np.testing.assert_allclose(hold._existence, TRACKED_EXISTENCE)


def test_what_is_tracked_takes_detections_and_explains_them_as_what_is_held():
    found = detections([[2060.0, 1020.0], [9000.0, 1000.0]], 12.0)
    held, tracked = holding(1, existence=TRACKED_EXISTENCE), holding()
    tracked.follow(0.0, tracks(1))
    explained = step(tracked, 12.0, found, P_D)
    np.testing.assert_array_equal(explained, step(held, 12.0, found, P_D))
    assert explained[0] > 10 * CLUTTER and explained[1] == 0.0
    assert_equal_tracks(tracked, held)


def assert_equal_tracks(one: TrackHold, other: TrackHold) -> None:
    np.testing.assert_array_equal(one.current.state, other.current.state)
    np.testing.assert_array_equal(one.current.covariance, other.current.covariance)


def test_clearing_forgets_the_tracker():
    hold = holding()
    follow_tracker(hold, 0.0, 1)
    hold.clear()
    step(hold, 1.0)
    assert (hold.ended, hold.tracker) == ([1], Tracker.NONE)
    step(hold, 100.0)
    assert hold.tracker is Tracker.NONE, "it cannot fall silent"
    hold.add(tracks(2, stamp=100.0), 0.9)
    follow_tracker(hold, 101.0)
    step(hold, 112.0)
    assert ids(hold) == [2]


def test_tracked_targets_known_as_exactly_as_is_taken_do_no_harm():
    hold, rng = holding(), np.random.default_rng(4)
    axis = np.array([[1.0, 1.0 - 1e-11], [1.0 - 1e-11, 1.0]])
    for scan in range(200):
        told = tracks(*range(8), stamp=12.0 * scan)
        told.covariance[:] = np.kron(np.eye(2), axis) * 10.0 ** rng.uniform(-12, 18, (8, 1, 1))
        hold.follow(12.0 * scan + rng.uniform(-20, 20), told)
        found = detections(told.state[:, 0::2] + rng.standard_normal((8, 2)), 12.0 * scan, 1e-12)
        assert np.isfinite(step(hold, 12.0 * scan + 1e-3, found, P_D)).all()
        assert np.isfinite(hold.current.covariance).all()
        assert np.isfinite(hold._existence).all()
    assert len(ids(hold)) == 8
