"""Gates and splitting: who may extend whom."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, detections, scan_at

from tsepm_ros import make_initiator
from tsepm_ros.methods.tsepm import Tsepm, TsepmOptions
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.tracker import splitting
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.splitting import Gated, children, gate, left_out, residual, split_paths
from tsepm_ros.tracker.tracker import Tracker


def rows_of(gated: Gated) -> list[list[int]]:
    return [
        gated.detection[begin:end].tolist()
        for begin, end in zip(gated.start[:-1], gated.start[1:], strict=True)
    ]


def brute_force(last_hits, found, max_speed, probability) -> list[list[int]]:
    alpha = math.sqrt(-2 * math.log(1 - probability))
    return [
        [
            j
            for j, new in enumerate(found)
            if math.dist(new["position"], hit["position"])
            <= max_speed * abs(new["time"] - hit["time"]) + alpha * hit["major_sigma"]
        ]
        for hit in last_hits
    ]


@pytest.mark.parametrize(
    ("probability", "factor"), [(0.9, 2.146), (0.99, 3.035), (0.999999, 5.257)]
)
def test_the_gate_factor_is_eq_5(probability, factor):
    assert gate_factor(probability) == pytest.approx(factor, abs=5e-4)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("origin", [0.0, 5e6], ids=["local", "map coordinates"])
def test_gates_hold_what_a_look_at_every_pair_finds(seed, origin):
    rng = np.random.default_rng([1, seed])
    last = detections(origin + rng.uniform(0, 4000, (40, 2)), rng.choice([0.0, 12.0, 24.0], 40))
    last["major_sigma"] = rng.uniform(1, 200, 40)
    found = detections(origin + rng.uniform(0, 4000, (300, 2)), 36 + rng.uniform(0, 6, 300))
    gated = gate(last, found, 10.0, 0.9)
    expected = brute_force(last, found, 10.0, 0.9)
    assert rows_of(gated) == expected
    assert gated.count.tolist() == [len(row) for row in expected]
    assert sum(map(len, expected)) > 100, "the scene must have something to find"


@pytest.mark.parametrize("angle", [0, 1, 2, 3], ids=["+x", "+y", "-x", "-y"])
def test_a_detection_exactly_on_the_radius_is_inside(angle):
    radius = 10.0 * 12.0 + gate_factor(0.9) * 75.0
    direction = np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][angle])
    last = detections([[0.0, 0.0]], 0.0, variance=75.0**2)
    on, beyond = radius * direction, np.nextafter(radius, np.inf) * direction
    found = detections([on, beyond], 12.0)
    assert rows_of(gate(last, found, 10.0, 0.9)) == [[0]]


def test_an_oblique_detection_exactly_on_the_radius_is_inside():
    last = detections([[0.0, 0.0]], 0.0, variance=0.0)
    found = detections([[60.0, 80.0], [60.0, np.nextafter(80.0, 81)]], 10.0)
    assert rows_of(gate(last, found, 10.0, 0.9)) == [[0]]


@pytest.mark.parametrize("elapsed", [3.0, 12.0, 17.5, 96.0])
def test_the_gate_grows_with_the_seconds_that_passed(elapsed):
    margin = gate_factor(0.9) * 50.0
    last = detections([[0.0, 0.0]], 100.0, variance=50.0**2)
    reach = 10.0 * elapsed + margin
    found = detections([[reach - 1e-6, 0.0], [reach + 1e-6, 0.0]], 100.0 + elapsed)
    assert rows_of(gate(last, found, 10.0, 0.9)) == [[0]]


def test_each_detection_s_own_time_counts():
    last = detections([[0.0, 0.0]], 0.0, variance=0.0)
    found = detections([[105.0, 0.0], [105.0, 0.0]], [10.0, 11.0])
    assert rows_of(gate(last, found, 10.0, 0.9)) == [[1]]


def test_the_last_hit_s_error_widens_its_gate_and_no_other():
    last = detections([[0.0, 0.0], [0.0, 0.0]], 0.0)
    last["major_sigma"] = [1.0, 100.0]
    found = detections([[200.0, 0.0]], 12.0)
    assert rows_of(gate(last, found, 10.0, 0.9)) == [[], [0]]


@pytest.mark.parametrize(("n_last", "n_new"), [(0, 3), (3, 0), (0, 0)])
def test_no_gates_or_no_detections_give_no_candidates(n_last, n_new):
    gated = gate(
        detections(np.zeros((n_last, 2)), 0.0), detections(np.zeros((n_new, 2)), 1.0), 10.0, 0.9
    )
    assert gated.count.tolist() == [0] * n_last
    assert residual(gated).tolist() == list(range(n_new))


def test_a_varying_period_is_gated_by_time_not_by_scans():
    # 100 m in one long interval fits 10 m/s; the same step in one short interval does not.
    def confirmed(stamps: list[float]) -> int:
        initiator = make_initiator(
            "tsepm", sensor=FIXED_RANGE_ERROR, min_hits=3, window=3, gate_probability=1e-9
        )
        return sum(
            len(initiator.process(scan_at(stamp, [(2000.0, 100.0 * k)])))
            for k, stamp in enumerate(stamps)
        )

    assert confirmed([0.0, 11.0, 40.0]) == 1
    assert confirmed([0.0, 11.0, 20.0]) == 0


class Counted(Tsepm):
    """The method, counting the gates that it asks for."""

    def gated(self, last_hits: np.ndarray, detections: np.ndarray) -> Gated:
        self.asked = [*getattr(self, "asked", []), len(last_hits)]
        return super().gated(last_hits, detections)


def test_tracks_that_share_their_last_hit_share_its_gate():
    method = Counted(FIXED_RANGE_ERROR, CommonOptions(), TsepmOptions())
    initiator = Tracker(method)
    initiator.process(scan_at(0.0, [(2000.0, 0.0), (2010.0, 0.0), (2020.0, 0.0)]))
    initiator.process(scan_at(12.0, [(2010.0, 5.0)]))
    initiator.process(scan_at(24.0, [(2010.0, 10.0)]))
    assert initiator.statistics.potential_tracks == 3
    assert method.asked == [0, 3, 1]


def test_every_track_has_a_child_for_every_detection_in_its_gate():
    gated = Gated(np.array([0, 2, 2, 5]), np.array([4, 7, 0, 4, 9]), np.zeros(10, bool))
    parent, detection = children(np.array([2, 0, 1, 2]), gated)
    made = list(zip(parent.tolist(), detection.tolist(), strict=True))
    assert made == [(0, 0), (0, 4), (0, 9), (1, 4), (1, 7), (3, 0), (3, 4), (3, 9)]


@pytest.mark.parametrize("max_gated", [10_000, 1], ids=["all gated", "few gated"])
@pytest.mark.parametrize("seed", range(5))
def test_residual_detections_are_those_in_no_gate(monkeypatch, seed, max_gated):
    # Also where a limit leaves most of the gated ones out: they are not free to start tracks.
    monkeypatch.setattr(splitting, "MAX_GATED", max_gated)
    rng = np.random.default_rng(seed)
    last = detections(rng.uniform(-1000, 1000, (30, 2)), 0.0, variance=1.0)
    last["major_sigma"] = rng.uniform(1.0, 60.0, 30)
    found = detections(rng.uniform(-1000, 1000, (200, 2)), 6.0)
    gated = gate(last, found, 10.0, 0.9)
    radius = 60.0 + gate_factor(0.9) * last["major_sigma"]
    distance = np.linalg.norm(found["position"][:, None] - last["position"], axis=2)
    expected = np.flatnonzero((distance > radius).all(axis=1))
    assert 20 < len(expected) < 180
    assert residual(gated).tolist() == expected.tolist()
    unused = set(range(200)) - set(expected) - set(gated.detection.tolist())
    assert left_out(gated).tolist() == sorted(unused)
    assert (len(unused) > 0) == (max_gated == 1)


def random_split(seed: int, ties: bool):
    rng = np.random.default_rng([4, seed])
    counts = rng.integers(0, 6, 30)
    start = np.concatenate([[0], np.cumsum(counts)])
    gated = Gated(start, rng.integers(0, 50, start[-1]), np.zeros(50, bool))
    gates = rng.integers(0, 30, 80)
    prices = rng.integers(0, 8, (80, 50)) if ties else rng.random((80, 50))
    return gates, gated, lambda parent, detection: prices[parent, detection].astype(float)


@pytest.mark.parametrize("block", [1, 7, 64, 1_000_000])
@pytest.mark.parametrize("ties", [False, True], ids=["distinct", "ties"])
@pytest.mark.parametrize("limit", [1, 10, 100])
def test_split_within_keeps_exactly_the_best_children(monkeypatch, block, ties, limit):
    monkeypatch.setattr(splitting, "SPLIT_BLOCK", block)
    gates, gated, cost = random_split(limit, ties)
    everyone = children(gates, gated)
    best = np.sort(np.argsort(cost(*everyone), kind="stable")[:limit])
    parent, detection, cut = split_paths(gates, gated, limit, cost)
    assert parent.tolist() == everyone[0][best].tolist()
    assert detection.tolist() == everyone[1][best].tolist()
    assert cut == len(everyone[0]) - limit


def test_split_within_asks_for_no_cost_where_nothing_is_cut():
    gates, gated, _ = random_split(0, ties=False)

    def cost(parent, detection):
        raise AssertionError("asked")

    everyone = children(gates, gated)
    parent, detection, cut = split_paths(gates, gated, len(everyone[0]), cost)
    assert (parent.tolist(), detection.tolist()) == (everyone[0].tolist(), everyone[1].tolist())
    assert cut == 0


def test_split_within_looks_at_no_further_children_once_it_is_late(monkeypatch):
    monkeypatch.setattr(splitting, "TIMED_BLOCK", 20)
    gates, gated, cost = random_split(1, ties=False)
    asked: list[bool] = []

    def late() -> bool:
        asked.append(True)
        return len(asked) > 2

    everyone = children(gates, gated)
    parent, detection, cut = split_paths(gates, gated, 100, cost, late)
    assert 20 <= len(parent) < 100
    assert cut == len(everyone[0]) - len(parent)
    assert parent.tolist() == everyone[0][: len(parent)].tolist()
    assert detection.tolist() == everyone[1][: len(parent)].tolist()
