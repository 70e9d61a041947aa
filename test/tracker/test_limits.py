"""Limits: what is kept, what is counted, and that the initiator stays alive."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, reconfigured, scan_at

from tsepm_ros import Scan, SensorModel, available_methods, make_initiator
from tsepm_ros.numerics.arrays import keep_best
from tsepm_ros.tracker.maintenance.track_maintenance import best_held


@pytest.mark.parametrize("limit", [1, 3, 50, 199, 200, 1000])
@pytest.mark.parametrize("values", [3, 10_000], ids=["many ties", "few ties"])
def test_keep_best_keeps_the_smallest_and_of_ties_the_first(limit, values):
    cost = np.random.default_rng(limit).integers(0, values, 200).astype(float)
    expected = np.sort(np.argsort(cost, kind="stable")[:limit])
    assert keep_best(cost, limit).tolist() == expected.tolist()


def busy_scans() -> list[Scan]:
    """Twelve scans with clutter ten times denser than the sensor model's, and two targets."""
    rng = np.random.default_rng(9)
    scans = []
    for k in range(12):
        points = rng.uniform(-3000, 3000, (360, 2)).tolist()
        points += [(1000.0 + 60.0 * k, 500.0), (-800.0, 900.0 - 50.0 * k)]
        scans.append(scan_at(12.0 * k, points))
    return scans


@pytest.mark.parametrize("evaluation", ["normalized_distance", "clutter_statistic"])
def test_what_is_cut_keeps_its_gates_so_that_no_others_start(evaluation):
    def counts(**limits: int):
        initiator = make_initiator(
            "tsepm", sensor=SensorModel(), min_hits=4, window=6, evaluation=evaluation, **limits
        )
        return [(initiator.process(scan), initiator.statistics)[1] for scan in busy_scans()]

    free, limited = counts(), counts(max_potential_tracks=150, max_raw_confirmations=40)
    assert sum(count.cut_potential_tracks for count in limited) > 1000
    assert [count.started for count in limited] == [count.started for count in free]
    # What is not confirmed is counted: each path that reached M hits, wherever it was cut before.
    assert [count.raw_confirmations + count.cut_confirmations for count in limited] == [
        count.raw_confirmations for count in free
    ]


def test_a_limit_keeps_the_tightest_tracks():
    initiator = make_initiator(
        "tsepm", sensor=FIXED_RANGE_ERROR, min_hits=2, window=2, max_raw_confirmations=1
    )
    initiator.process(scan_at(0.0, [(2000.0, 0.0)]))
    (track,) = initiator.process(scan_at(12.0, [(2000.0, 90.0), (2000.0, 5.0), (2000.0, -60.0)]))
    assert track.hits == ((0, 0), (1, 1))


def test_a_hundred_thousand_detections_in_one_scan_do_not_end_anything():
    # The scan's 100 000 potential tracks gate everything until their window ends; a target that
    # appears after that is found as if the scan had not been, and nothing is left of it.
    rng = np.random.default_rng(1)
    n = 100_000
    initiator = make_initiator("tsepm", sensor=SensorModel())
    initiator.process(
        Scan(0.0, 9000 * np.sqrt(rng.uniform(1e-6, 1, n)), rng.uniform(-math.pi, math.pi, n))
    )
    assert initiator.statistics.potential_tracks == n
    for k in range(1, 9):
        initiator.process(
            scan_at(12.0 * k, [rng.uniform(-6000, 6000, 2), (1000.0 + 50.0 * k, 3000.0)])
        )
        assert initiator.statistics.potential_tracks <= 250_000
    late = [initiator.process(scan_at(12.0 * k, [(-4000.0, 60.0 * k)])) for k in range(9, 18)]
    assert sum(map(len, late)) >= 1
    track = next(new[0] for new in late if new)
    np.testing.assert_allclose(track.position, (-4000.0, 5.0 * track.stamp), rtol=1e-3)
    assert initiator.statistics.potential_tracks < 100


def cluster(scans: int, number: int, scan_time: float = math.inf):
    """So many detections in a cluster in each scan: number^5 raw confirmations in the fifth."""
    rng = np.random.default_rng(1)
    initiator = make_initiator("tsepm", sensor=SensorModel())
    initiator.max_scan_time = scan_time
    for k in range(scans):
        range_, azimuth = rng.uniform(-100, 100, number), rng.uniform(-0.02, 0.02, number)
        tracks = initiator.process(Scan(12.0 * k, 5000 + range_, azimuth))
    return initiator, tracks


@pytest.mark.timeout(60)
def test_a_small_cluster_of_detections_in_every_scan_is_processed_in_time():
    # A wreck or a jetty: 1e5 raw confirmations, all of which merge; every pair takes minutes.
    initiator, _ = cluster(6, 10)
    assert initiator.totals.confirmed >= 1


def test_a_time_limit_cuts_what_it_must_counts_it_and_the_output_is_valid():
    initiator, tracks = cluster(5, 12, 0.05)
    statistics = initiator.statistics
    assert tracks
    assert statistics.raw_confirmations == 12**5
    assert statistics.cut_confirmations > 0
    assert statistics.raw_confirmations == sum(
        (statistics.cut_confirmations, statistics.pruned, statistics.merged, statistics.confirmed)
    )
    for track in tracks:
        assert np.linalg.eigvalsh(track.covariance).min() > 0
        assert [scan for scan, _ in track.hits] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("method", [name for name in available_methods() if name != "hough"])
def test_where_the_time_is_over_only_part_of_the_pairs_in_one_place_is_looked_at(method):
    # A thousand detections twice: a million pairs, of which none may be left out in silence.
    n = 1000
    initiator = make_initiator(method, sensor=SensorModel(), plots="off")
    initiator.max_scan_time = 1e-9
    for k in range(2):
        initiator.process(Scan(12.0 * k, np.full(n, 1000.0), np.zeros(n)))
    assert initiator.statistics.cut_potential_tracks >= n * n - 500_000
    assert initiator.statistics.potential_tracks <= 500_000


def test_new_tracks_beyond_those_that_can_be_held_in_time_are_cut_and_counted():
    made = make_initiator("clutter_test", sensor=SensorModel(), plots="off", clutter_test_size=0.9)
    made.max_scan_time = 1e-9
    rng = np.random.default_rng(1)
    for k in range(5):
        made.process(Scan(12.0 * k, 5000 + rng.uniform(-100, 100, 5), rng.uniform(-0.02, 0.02, 5)))
    assert len(made.current) == made.statistics.confirmed == 10
    assert made.statistics.raw_confirmations == sum(
        getattr(made.statistics, name)
        for name in ("cut_confirmations", "pruned", "merged", "confirmed")
    )
    assert made.statistics.cut_confirmations > 100


def test_the_new_tracks_kept_are_the_most_probable_and_then_the_best():
    existence = np.array([0.5, 0.9, 0.9, 0.9])
    assert best_held(existence, np.array([0.0, 3.0, 1.0, 2.0]), 2).tolist() == [2, 3]


@pytest.mark.parametrize(
    ("changed", "density"),
    [({"evaluation": "normalized_distance"}, 1e-5), ({"clutter_test_size": 0.6}, 1e-5), ({}, 1e-6)],
    ids=["evaluation", "test size", "density"],
)
def test_what_was_cut_under_another_threshold_starts_over(changed, density):
    rule = {"min_hits": 4, "window": 6, "evaluation": "clutter_statistic", "clutter_test_size": 0.3}
    made = make_initiator(
        "tsepm", sensor=SensorModel(clutter_density=1e-5), clutter_density="given", **rule
    )
    for scan in busy_scans()[:5]:
        made.process(scan)
    same = made.sensor, made.common, made.options
    assert reconfigured(made, *same)
    assert made.statistics.hopeless_tracks > 0
    kept = reconfigured(
        made,
        replace(made.sensor, clutter_density=density),
        made.common,
        replace(made.options, **changed),
    )
    assert not kept
    made.process(busy_scans()[5])
    assert made.statistics.potential_tracks <= len(busy_scans()[5])
