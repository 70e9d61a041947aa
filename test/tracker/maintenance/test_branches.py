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
"""Branches of confirmed tracks against plain loops over branches, modes and detections."""

import math
import time
import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal
from support import plain_confirmed_tracks as plain
from support.builders import FIXED_RANGE_ERROR, detections
from support.plain_tsepm import MEASUREMENT_MATRIX, transition_matrix

from tsepm_ros.numerics.gaussian import proper_covariance
from tsepm_ros.tracker.maintenance import branches
from tsepm_ros.tracker.maintenance.branches import Branches, best_branches, evaluate, gate, split
from tsepm_ros.tracker.maintenance.stationary import GLITCH_SHARE, StraightFits
from tsepm_ros.tracker.measurement import covariance_at
from tsepm_ros.tracker.motion import InteractingModels

P_D, P_G, FADED = 0.8, 0.99, 0.02
CLUTTER = 1e-4
SENSOR = replace(FIXED_RANGE_ERROR, detection_probability=P_D)
STAMP = 50.0
KINDS = ["alike", "times", "rates"]
"""Detections of one time, of a time each, of a time and some with a range rate each."""


def spreads(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Covariances of some 5 m and 1 m/s."""
    root = rng.normal(0.0, 1.0, (*shape, 4, 6)) * np.array([2.0, 0.4, 2.0, 0.4])[:, None]
    return root @ np.swapaxes(root, -1, -2)


def held(rng: np.random.Generator, count: int = 1, used: int = 3) -> tuple[Branches, StraightFits]:
    """Tracks on a ring of 1 km with some branches each, near each other, and straight fits."""
    angle = np.linspace(-3.0, 3.0, count)
    centre = np.zeros((count, 1, 1, 4))
    centre[:, 0, 0, 0::2] = 1000.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    state = centre + rng.normal(0.0, [5.0, 1.0, 5.0, 1.0], (count, 4, 2, 4))
    mode = rng.uniform(0.1, 0.9, (count, 4))
    weight = -np.sort(-rng.dirichlet(np.full(used, 2.0), count), axis=1)
    mode = np.stack([mode, 1 - mode], axis=-1)
    of_models = (one[:, :used] for one in (mode, state, spreads(rng, count, 4, 2)))
    models = InteractingModels(*(one.reshape(-1, *one.shape[2:]) for one in of_models))
    fits = StraightFits.from_states(state[:, 0, 0], spreads(rng, count))
    faded = rng.uniform(0.0, 0.5, (count * used, 1))
    return Branches(np.full(count, used), np.log(weight).ravel(), faded, models), fits


def of_track(tracks: Branches, track: int) -> range:
    """Rows of the branches of a track."""
    return range(tracks.first[track], np.cumsum(tracks.number)[track])


def sums(tracks: Branches, values: np.ndarray) -> np.ndarray:
    """Sum of a value of each branch over those of each track."""
    return np.array([values[of_track(tracks, track)].sum() for track in range(len(tracks))])


def found_near(rng: np.random.Generator, tracks: Branches, each: int, kind: str) -> np.ndarray:
    """Some detections near each track, in no order."""
    places = tracks.models.state[tracks.first, 0, 0::2].repeat(each, axis=0)
    rows = detections(rng.permutation(places + rng.normal(0.0, 6.0, places.shape)), STAMP, 9.0)
    rows["range_std"], rows["azimuth_std"] = 3.0, 0.004
    if kind != "alike":
        rows["time"] += rng.uniform(-0.5, 0.5, len(rows))
    if kind == "rates":
        rated = np.arange(len(rows)) % 3 > 0
        rows["range_rate"], rows["range_rate_std"] = rng.normal(0.0, 2.0, len(rows)), 0.5 * rated
    return rows


def hit(x: np.ndarray, p: np.ndarray, detection: np.ndarray):
    """Likelihood of a detection of a state, 0 outside the gate, and the state after it."""
    h = MEASUREMENT_MATRIX @ transition_matrix(detection["time"] - STAMP)
    s = h @ p @ h.T + covariance_at(detection, h @ x, SENSOR)
    v, gain = detection["position"] - h @ x, p @ h.T @ np.linalg.inv(s)
    distance, density = v @ np.linalg.inv(s) @ v, multivariate_normal(np.zeros(2), s).pdf(v)
    x, p, dimensions = x + gain @ v, p - gain @ s @ gain.T, 2
    if (std := detection["range_rate_std"]) > 0.0:
        at = SimpleNamespace(
            time=detection["time"], sensing=SimpleNamespace(position=detection["sensor_pose"][:2])
        )
        error, variance, gradient = plain.range_rate_innovation(
            x, p, at, detection["range_rate"], detection["sensor_velocity"], STAMP, std
        )
        gain = p @ gradient / variance
        x, p, dimensions = x + gain * error, p - variance * np.outer(gain, gain), 3
        distance += error**2 / variance
        density *= math.exp(-0.5 * error**2 / variance) / math.sqrt(2.0 * math.pi * variance)
    return (density if distance <= chi2.ppf(P_G, dimensions) else 0.0), x, p


def by_loops(tracks: Branches, track: int, rows: np.ndarray, may, rate: np.ndarray):
    """Children of a track, the best first: weight, detection, mode probabilities, states, faded."""
    children, models = [], tracks.models
    for place in of_track(tracks, track):
        weight, faded = math.exp(tracks.log_weight[place]), tracks.faded[place, 0]
        modes = [getattr(models, n)[place] for n in ("probability", "state", "covariance")]
        visible = 1.0 - faded + FADED * faded
        empty = 1.0 - P_D * visible * P_G
        still = faded * (1.0 - FADED * P_D * P_G) / empty
        children.append((weight * empty, -1, *modes, still))
        for row in may:
            of = [hit(x, p, rows[row]) for _, x, p in zip(*modes, strict=True)]
            ratio = visible * rate[row] * modes[0] * [one[0] for one in of]
            if ratio.sum() > 0.0:
                states = (np.stack(one) for one in list(zip(*of, strict=True))[1:])
                share = ratio / ratio.sum()
                children.append(
                    (weight * ratio.sum(), row, share, *states, FADED * faded / visible)
                )
    return sorted(children, key=lambda child: -child[0])


def taken(tracks, fits, rows, clutter=None, owner=None, limit=math.inf):
    """A scan through the gate, the evaluation and the split."""
    clutter = np.full(len(rows), CLUTTER) if clutter is None else clutter
    owner = np.full(len(rows), -1) if owner is None else owner
    gated = gate(tracks, fits, STAMP, rows, SENSOR)
    evaluated = evaluate(tracks, gated, np.full(len(tracks), P_D), P_D, clutter)
    return evaluated, *split(tracks, evaluated, owner, np.full(len(tracks), limit))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_branches_split_and_pruned_are_those_of_plain_loops(seed, kind):
    rng = np.random.default_rng([seed, 1])
    tracks, fits = held(rng)
    rows = found_near(rng, tracks, 6, kind)
    clutter, owner = rng.uniform(1e-5, 1e-4, 6), np.array([-1, 0, -1, 1, -1, -1])
    _, after, ratio, pairs = taken(tracks, fits, rows, clutter, owner)
    children = by_loops(tracks, 0, rows, [0, 1, 2, 4, 5], P_D / clutter)
    kept = [one for one in children[:4] if one[0] > math.exp(-7.0) * children[0][0]]
    assert len(kept) < len(children)
    total = sum(one[0] for one in kept)
    np.testing.assert_allclose(ratio, total)
    assert after.number.tolist() == [len(kept)]
    np.testing.assert_allclose(np.exp(after.log_weight), [one[0] / total for one in kept])
    for place, (_, _, *modes, faded) in enumerate(kept):
        for values, expected in zip(vars(after.models).values(), modes, strict=True):
            np.testing.assert_allclose(values[place], expected, rtol=1e-6, atol=1e-6)
        assert after.faded[place, 0] == pytest.approx(faded)
    taken_by = {row: 0.0 for _, row, *_ in kept if row >= 0}
    for value, row, *_ in kept:
        if row >= 0:
            taken_by[row] += value / total
    assert dict(zip(pairs.row.tolist(), pairs.ratio, strict=True)) == pytest.approx(taken_by)


@pytest.mark.parametrize("kind", KINDS)
def test_ratios_over_the_branches_are_those_of_plain_loops(kind):
    rng = np.random.default_rng(7)
    tracks, fits = held(rng, 3)
    rows = found_near(rng, tracks, 4, kind)
    evaluated, *_ = taken(tracks, fits, rows)
    empty, pairs = evaluated.of_tracks(tracks, len(rows))
    found = np.zeros((3, len(rows)))
    found[pairs.track, pairs.row] = pairs.ratio
    for track in range(3):
        children = by_loops(
            tracks, track, rows, range(len(rows)), np.full(len(rows), P_D / CLUTTER)
        )
        expected = np.zeros(1 + len(rows))
        for weight, row, *_ in children:
            expected[row] += weight
        np.testing.assert_allclose(np.append(found[track], empty[track]), expected)


def test_the_likelihood_ratio_of_a_scan_is_the_sum_over_its_branches():
    rng = np.random.default_rng(3)
    tracks, fits = held(rng, 5, used=1)
    rows = found_near(rng, tracks, 2, "alike")
    clutter = np.full(len(rows), 0.003)  # a miss and two hits of like weights: none is pruned
    evaluated, after, ratio, own = taken(tracks, fits, rows, clutter)
    empty, pairs = evaluated.of_tracks(tracks, len(rows))
    assert len(pairs.row) >= 5
    total = empty + np.bincount(pairs.track, pairs.ratio, minlength=5)
    np.testing.assert_allclose(ratio, total)
    np.testing.assert_allclose(sums(after, np.exp(after.log_weight)), 1.0)
    np.testing.assert_allclose(own.ratio, pairs.ratio / total[pairs.track])


@pytest.mark.parametrize("kind", KINDS)
def test_the_order_of_the_detections_changes_nothing(kind):
    rng = np.random.default_rng(11)
    tracks, fits = held(rng, 6)
    rows, order = found_near(rng, tracks, 4, kind), rng.permutation(24)
    clutter, owner = rng.uniform(1e-5, 1e-4, 24), rng.integers(-1, 6, 24)
    one = taken(tracks, fits, rows, clutter, owner, 1.0)
    other = taken(tracks, fits, rows[order], clutter[order], owner[order], 1.0)
    np.testing.assert_allclose(one[2], other[2])
    for before, after in ((one[1], other[1]), (one[1].models, other[1].models)):
        for name, values in vars(before).items():
            if name != "models":
                np.testing.assert_allclose(values, vars(after)[name], rtol=1e-7, atol=1e-7)
    assert set(zip(one[3].track, one[3].row, strict=True)) == set(
        zip(other[3].track, order[other[3].row], strict=True)
    )
    empty = np.full(6, 0.3)
    straight = branches.straight_fits(fits, one[0], owner, empty, one[2])
    again = branches.straight_fits(fits, other[0], owner[order], empty, one[2])
    np.testing.assert_allclose(straight.state, again.state)
    np.testing.assert_allclose(straight.change_odds, again.change_odds)


@pytest.mark.parametrize("kind", KINDS)
def test_straight_fits_take_the_detection_that_fits_best_by_its_probability(kind):
    rng = np.random.default_rng(2)
    tracks, fits = held(rng)
    rows, empty = found_near(rng, tracks, 5, kind), np.array([0.4])
    evaluated, *_ = taken(tracks, fits, rows)
    x, p = fits.state[0], fits.covariance[0]
    of = [hit(x, p, row) for row in rows]
    order = sorted(range(5), key=lambda row: -of[row][0])
    assert of[order[1]][0] > 0.0
    for best, owner in (
        (order[0], np.full(5, -1)),
        (order[1], np.where(np.arange(5) == order[0], 9, 0)),
    ):
        density, moved, narrowed = of[best]
        total = 0.4 + density * P_D / CLUTTER
        beta = 1.0 - 0.4 / total
        expected = plain.mixture(
            np.array([1.0 - beta, beta]), np.stack([x, moved]), np.stack([p, narrowed])
        )
        fits = replace(fits, change_odds=np.array([3.0]))
        after = branches.straight_fits(fits, evaluated, owner, empty, np.array([7.0]))
        odds = 3.0 * 7.0 / ((1.0 - GLITCH_SHARE) * total + GLITCH_SHARE * 7.0)
        np.testing.assert_allclose(after.change_odds, odds)
        np.testing.assert_allclose(after.state[0], expected[0], atol=1e-9)
        np.testing.assert_allclose(after.covariance[0], expected[1], atol=1e-6)


def test_prediction_and_mean_are_those_of_the_plain_version():
    rng = np.random.default_rng(5)
    tracks, _ = held(rng, 3)
    elapsed, counts = np.array([0.1, 4.0, 12.0]), np.array([True, False, True])
    after = tracks.predicted(elapsed, 8.0, 0.01).fading(counts)
    state, covariance = after.combined()
    for track, seconds in enumerate(elapsed):
        every = []
        for place in of_track(tracks, track):
            models = (values[place] for values in vars(tracks.models).values())
            weight = math.exp(tracks.log_weight[place])
            faded = tracks.faded[place, 0]
            one = plain.Branch(weight, faded, *models)
            plain.predict(one, seconds, 8.0, 0.01)
            for values, expected in zip(
                vars(after.models).values(),
                (one.probability, one.state, one.covariance),
                strict=True,
            ):
                np.testing.assert_allclose(values[place], expected, atol=1e-8)
            gone = 7.0 / 8.0 * faded + (1.0 - faded) / 25.0 if counts[track] else faded
            assert after.faded[place, 0] == pytest.approx(gone)
            every.append(one)
        mean, spread = plain.mixture(
            np.concatenate([one.weight * one.probability for one in every]),
            np.concatenate([one.state for one in every]),
            np.concatenate([one.covariance for one in every]),
        )
        np.testing.assert_allclose(state[track], mean)
        np.testing.assert_allclose(covariance[track], spread)


def test_a_new_track_is_one_branch_with_its_state():
    rng = np.random.default_rng(6)
    state, covariance = rng.normal(0.0, 100.0, (3, 4)), spreads(rng, 3)
    new = Branches.from_states(state, covariance)
    assert (new.number.tolist(), np.exp(new.log_weight).tolist()) == ([1] * 3, [1.0] * 3)
    np.testing.assert_array_equal(new.combined()[0], state)
    np.testing.assert_allclose(new.combined()[1], covariance)


@pytest.mark.parametrize("kind", KINDS)
def test_covariances_stay_proper_and_means_slow_over_many_scans(kind):
    rng = np.random.default_rng(8)
    tracks, fits = held(rng, 4)
    for _ in range(40):
        tracks = tracks.predicted(np.full(4, 1.0), 3.0, 1e-3).fading(np.ones(4, bool))
        fits = fits.predicted(np.full(4, 1.0))
        rows = found_near(rng, tracks, 3, kind)
        evaluated, tracks, ratio, _ = taken(tracks, fits, rows, limit=3.0)
        owner, empty = np.full(len(rows), -1), np.full(4, 0.3)
        fits = branches.straight_fits(fits, evaluated, owner, empty, ratio)
        made = tracks.models.covariance.reshape(-1, 4, 4)
        for one in (made, tracks.combined()[1], fits.covariance):
            np.testing.assert_allclose(proper_covariance(one), one, rtol=1e-9)
            assert (np.linalg.eigvalsh(one) > 0.0).all()
        speed = np.hypot(*tracks.models.state[..., 1::2].reshape(-1, 2).T)
        assert speed.max() <= 3.0 + 1e-9
        assert (ratio > 0.0).all()
        np.testing.assert_allclose(sums(tracks, np.exp(tracks.log_weight)), 1.0)
        falls = np.diff(tracks.log_weight) <= 0.0
        falls[tracks.first[1:] - 1] = True
        assert falls.all(), "the best first"


def test_without_detections_every_branch_misses():
    tracks, fits = held(np.random.default_rng(9), 2)
    evaluated, after, ratio, pairs = taken(tracks, fits, detections(np.zeros((0, 2)), STAMP))
    visible = 1.0 - 0.98 * tracks.faded[:, 0]
    missed = np.exp(tracks.log_weight) * (1.0 - P_D * P_G * visible)
    np.testing.assert_allclose(ratio, sums(tracks, missed))
    np.testing.assert_allclose(evaluated.of_tracks(tracks, 0)[0], ratio)
    assert len(pairs.row) == 0
    order = np.lexsort((-missed, [0, 0, 0, 1, 1, 1]))
    np.testing.assert_allclose(np.exp(after.log_weight), missed[order] / ratio.repeat(3))
    np.testing.assert_array_equal(after.models.state, tracks.models.state[order])
    fits = replace(fits, change_odds=np.array([3.0, 0.5]))
    straight = branches.straight_fits(fits, evaluated, np.zeros(0, np.int64), ratio, ratio)
    np.testing.assert_array_equal(straight.state, fits.state)
    np.testing.assert_allclose(straight.change_odds, fits.change_odds)


def test_without_tracks_nothing_is_gated():
    none = Branches.from_states(np.zeros((0, 4)), np.zeros((0, 4, 4)))
    fits = StraightFits.from_states(np.zeros((0, 4)), np.zeros((0, 4, 4)))
    evaluated, after, ratio, pairs = taken(none, fits, detections([[5.0, 5.0]], STAMP))
    assert (len(evaluated.row), len(after), len(ratio), len(pairs.row)) == (0, 0, 0, 0)


def test_a_detection_of_another_track_is_not_taken_however_well_it_fits():
    rng = np.random.default_rng(10)
    tracks, fits = held(rng, 2, used=1)
    at = tracks.models.state[0, 0, 0::2]
    rows = detections(at[None], STAMP, 9.0)
    rows["range_std"], rows["azimuth_std"] = 3.0, 0.004
    for owner, mine in ((-1, [0]), (0, [0]), (1, [])):
        _, after, ratio, pairs = taken(tracks, fits, rows, owner=np.array([owner]))
        assert pairs.track.tolist() == mine
        assert (ratio[0] > 1.0) == bool(mine)
        moved = after.models.state[0] != tracks.models.state[0]
        assert moved.any() == bool(mine)


def test_of_detections_at_equal_places_each_has_an_equal_branch():
    rng = np.random.default_rng(12)
    tracks, fits = held(rng, 1, used=1)
    rows = found_near(rng, tracks, 1, "alike").repeat(2)
    evaluated, after, ratio, pairs = taken(tracks, fits, rows)
    empty, both = evaluated.of_tracks(tracks, 2)
    assert both.ratio[0] == both.ratio[1]
    np.testing.assert_allclose(ratio, empty + 2.0 * both.ratio[0])
    assert pairs.row.tolist() == [0, 1]
    assert pairs.ratio[0] == pytest.approx(pairs.ratio[1])
    np.testing.assert_array_equal(after.models.state[0], after.models.state[1])
    mean, spread = after.combined()
    assert np.isfinite(mean).all()
    assert (np.linalg.eigvalsh(spread) > 0.0).all()


def test_branches_are_taken_and_joined_by_tracks():
    tracks, _ = held(np.random.default_rng(4), 3)
    tracks = Branches(np.array([4, 2, 3]), *list(vars(tracks).values())[1:])
    taken = tracks[np.array([2, 0])]
    rows = [6, 7, 8, 0, 1, 2, 3]
    assert (len(taken), taken.number.tolist()) == (2, [3, 4])
    np.testing.assert_array_equal(taken.log_weight, tracks.log_weight[rows])
    np.testing.assert_array_equal(taken.models.state, tracks.models.state[rows])
    np.testing.assert_array_equal(tracks[tracks.number == 2].faded, tracks.faded[4:6])
    both = Branches.joined(tracks[slice(2)], taken)
    assert both.number.tolist() == [4, 2, 3, 4]
    np.testing.assert_array_equal(both.faded[6:], taken.faded)


def test_the_best_branches_are_kept_and_those_far_below_pruned():
    track = np.array([1, 0, 1, 1, 0, 1, 1])
    score = np.array([-9.0, -3.0, 0.5, -1.0, -10.1, -2.0, -3.0])
    rows, number = best_branches(track, score)
    assert rows.tolist() == [1, 2, 3, 5, 6]  # of track 0 one is 7.1 below the best
    assert number.tolist() == [1, 4]  # of track 1 a fifth is left out
    assert best_branches(track[:0], score[:0])[0].tolist() == []


def test_pairs_of_branches_and_fits_know_their_track_and_weight():
    rng = np.random.default_rng(13)
    tracks, fits = held(rng, 3)
    rows = found_near(rng, tracks, 2, "alike")
    gated = gate(tracks, fits, STAMP, rows, SENSOR)
    weight, track = gated.weights(tracks), gated.track_of_pair
    for pair, parent in enumerate(gated.parent):
        if parent >= 18:  # 3 tracks of 3 branches of 2 modes
            assert (track[pair], weight[pair]) == (parent - 18, 1.0)
        else:
            place, mode = divmod(parent, 2)
            expected = np.exp(tracks.log_weight[place]) * tracks.models.probability[place, mode]
            assert (track[pair], weight[pair]) == (place // 3, pytest.approx(expected))
    assert gated.of_fits.tolist() == (gated.parent >= 18).tolist()
    innovation, _ = gated.innovations(np.array([2, 0]), np.array([1, 4]))
    best = tracks.models.state[[6, 0], 0, 0::2]
    np.testing.assert_allclose(innovation, rows["position"][[1, 4]] - best)


@pytest.mark.parametrize("kind", ["alike", "times"])
def test_thousands_of_tracks_and_detections_take_little_time_and_memory(kind):
    rng, count = np.random.default_rng(14), 3000
    state = np.zeros((count, 4))
    state[:, 0::2] = rng.uniform(-3000.0, 3000.0, (count, 2))
    covariance = np.broadcast_to(np.diag([25.0, 1.0, 25.0, 1.0]), (count, 4, 4)).copy()
    tracks, fits = (
        Branches.from_states(state, covariance),
        StraightFits.from_states(state, covariance),
    )
    rows = found_near(rng, tracks, 1, kind)
    tracemalloc.start()
    began = time.process_time()
    gated = gate(tracks, fits, STAMP, rows, SENSOR)
    spent, (_, most) = time.process_time() - began, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert np.count_nonzero(gated.of_fits) > 0.8 * count
    assert spent < 4.0
    assert most < 60e6
