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
"""OSPA, GOSPA and CLEAR-MOT: closed cases, every assignment that there is, and the axioms."""

import itertools
import math

import numpy as np
import pytest

from tsepm_ros.tools.evaluation.tracking_metrics import ClearMot, ClearMotCounts, gospa, ospa

NOBODY = np.zeros((0, 2))
SEEDS = pytest.mark.parametrize("seed", range(20))


def points(rng: np.random.Generator) -> np.ndarray:
    """Up to four random positions in a square of 100 m."""
    return rng.uniform(0.0, 100.0, (rng.integers(0, 5), 2))


def every_ospa(tracks: np.ndarray, targets: np.ndarray, cutoff: float, order: float) -> float:
    few, many = sorted((tracks.tolist(), targets.tolist()), key=len)
    if not many:
        return 0.0
    least = min(
        sum(min(math.dist(a, b), cutoff) ** order for a, b in zip(few, chosen, strict=True))
        for chosen in itertools.permutations(many, len(few))
    )
    return ((least + cutoff**order * (len(many) - len(few))) / len(many)) ** (1.0 / order)


def every_gospa(tracks: np.ndarray, targets: np.ndarray, cutoff: float) -> float:
    n, m = len(tracks), len(targets)
    return math.sqrt(
        min(
            sum(math.dist(tracks[i], targets[j]) ** 2 for i, j in zip(mine, yours, strict=True))
            + cutoff**2 / 2 * (n + m - 2 * size)
            for size in range(min(n, m) + 1)
            for mine in itertools.combinations(range(n), size)
            for yours in itertools.permutations(range(m), size)
        )
    )


@SEEDS
def test_both_metrics_are_the_least_over_every_assignment(seed):
    rng = np.random.default_rng([63, seed])
    tracks, targets, cutoff = points(rng), points(rng), float(rng.uniform(10.0, 80.0))
    order = float(rng.choice([1.0, 2.0, 3.0]))
    expected = every_ospa(tracks, targets, cutoff, order)
    assert ospa(tracks, targets, cutoff, order) == pytest.approx(expected)
    expected = every_gospa(tracks, targets, cutoff)
    assert gospa(tracks, targets, cutoff).distance == pytest.approx(expected)


@SEEDS
def test_both_metrics_are_symmetric_and_hold_the_triangle_inequality(seed):
    rng = np.random.default_rng([64, seed])
    a, b, c = points(rng), points(rng), points(rng)
    cutoff = float(rng.uniform(10.0, 80.0))

    def distance_of_gospa(a, b, cutoff):
        return gospa(a, b, cutoff).distance

    for metric in (ospa, distance_of_gospa):
        assert metric(a, b, cutoff) == pytest.approx(metric(b, a, cutoff))
        assert metric(a, c, cutoff) <= metric(a, b, cutoff) + metric(b, c, cutoff) + 1e-9
        assert metric(a, rng.permutation(a), cutoff) == 0.0


def test_empty_sets_are_equal_and_a_set_is_the_cutoff_from_an_empty_one():
    two = np.ones((2, 2))
    assert ospa(NOBODY, NOBODY, 10.0) == gospa(NOBODY, NOBODY, 10.0).distance == 0.0
    assert ospa(NOBODY, two, 10.0) == ospa(two, NOBODY, 10.0) == 10.0
    assert vars(gospa(NOBODY, two, 10.0)) == {"localisation": 0.0, "missed": 100.0, "false": 0.0}
    assert vars(gospa(two, NOBODY, 10.0)) == {"localisation": 0.0, "missed": 0.0, "false": 100.0}


@pytest.mark.parametrize("apart", [0.0, 3.0, 9.9, 10.0, 30.0])
def test_one_track_at_a_distance_of_one_target(apart):
    track, target = np.array([[apart, 0.0]]), np.zeros((1, 2))
    assert ospa(track, target, 10.0) == min(apart, 10.0)
    parts = gospa(track, target, 10.0)
    assert parts.distance == pytest.approx(min(apart, 10.0))
    within = apart < 10.0
    assert vars(parts) == pytest.approx(
        {
            "localisation": apart**2 if within else 0.0,
            "missed": 0.0 if within else 50.0,
            "false": 0.0 if within else 50.0,
        }
    )


def test_the_parts_by_hand():
    tracks = np.array([[0.0, 3.0], [50.0, 50.0], [90.0, 0.0], [91.0, 0.0]])
    targets = np.array([[0.0, 0.0], [54.0, 50.0], [0.0, 99.0]])
    parts = gospa(tracks, targets, 10.0)
    assert vars(parts) == pytest.approx({"localisation": 25.0, "missed": 50.0, "false": 100.0})
    assert parts.distance == pytest.approx(math.sqrt(175.0))
    assert ospa(tracks, targets, 10.0) == pytest.approx(math.sqrt((25.0 + 100.0 + 100.0) / 4))


def test_a_track_without_a_position_is_of_no_target():
    nowhere = np.full((1, 2), np.nan)
    assert ospa(nowhere, np.zeros((1, 2)), 10.0) == 10.0
    assert gospa(nowhere, np.zeros((1, 2)), 10.0).false == 50.0


def at(**places: float) -> dict[int, np.ndarray]:
    """Positions on the x axis by id: ``n3=1.0`` is track 3 at 1 m."""
    return {int(name[1:]): np.array([place, 0.0]) for name, place in places.items()}


def test_counts_of_clear_mot_by_hand():
    clear = ClearMot(10.0)
    counts = [
        clear.take(at(n1=0.0, n2=50.0), at(n7=3.0)),  # a match and a miss
        clear.take(at(n1=0.0, n2=50.0), at(n7=4.0, n8=51.0, n9=90.0)),  # and a false track
        clear.take(at(n1=0.0, n2=50.0), at(n8=2.0, n7=48.0)),  # both tracks on the other target
        clear.take(at(n1=0.0), at()),
        clear.take(at(n1=0.0), at(n6=1.0)),  # another track after a pause
    ]
    total = ClearMotCounts.total(counts)
    assert vars(total) == {
        **{"targets": 8, "matches": 6, "misses": 2, "false": 1, "switches": 3},
        "distance": pytest.approx(3.0 + 4.0 + 1.0 + 2.0 + 2.0 + 1.0),
    }
    assert total.mota == pytest.approx(1.0 - (2 + 1 + 3) / 8)
    assert total.motp == pytest.approx(13.0 / 6)


def test_a_target_keeps_its_track_while_another_is_nearer():
    clear = ClearMot(10.0)
    clear.take(at(n1=0.0), at(n7=1.0))
    counts = clear.take(at(n1=0.0), at(n8=0.0, n7=9.0))
    assert (clear.now, counts.switches, counts.false, counts.distance) == ({1: 7}, 0, 1, 9.0)


def test_as_many_targets_as_the_gate_allows_get_a_track_before_the_distance_counts():
    counts = ClearMot(10.0).take(at(n1=0.0, n2=9.0), at(n7=8.0, n8=18.0))
    assert (counts.matches, counts.distance) == (2, 8.0 + 9.0)


def test_nothing_has_no_accuracy_and_no_precision():
    nothing = ClearMot(10.0).take({}, {})
    assert math.isnan(nothing.mota) and math.isnan(nothing.motp)
    assert ClearMot(10.0).take({}, at(n1=0.0)).false == 1
