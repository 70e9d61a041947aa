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
"""What tells that targets have several detections, and how these lie."""

import math
from dataclasses import replace

import numpy as np
import pytest
from clusters_scenes import box
from support.confirmed import tracks

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.clusters import extended_targets
from tsepm_ros.tracker.clusters.extended_targets import (
    END_LOG_RATIO,
    LOG_RATIO,
    MAX_CLUTTER_RATIO,
    MOST_PAIRS,
    ExtendedTargets,
    NeighbourCounts,
    SeveralEchoesTest,
    boxes_of,
    density_of_further,
    log_ratio_of,
)
from tsepm_ros.tracker.clusters.grouping import Extent
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.options import CommonOptions

TANK = SensorModel(max_range=100.0, range_std=0.2, range_std_fraction=0.0, azimuth_std=0.004)

DENSITY = 1e-4


NONE = np.zeros(0, np.int64)


def take(test: SeveralEchoesTest, scan: Scan, own=(NONE, NONE), confirmed=NONE, apart=()) -> None:
    """Let a test take a ping by itself."""
    test.update([scan], DENSITY, [own], confirmed, np.array(apart, bool))


def largest(sensor: SensorModel, scans, density: float) -> float:
    excess, found = SeveralEchoesTest(sensor), -math.inf
    for scan in scans:
        excess.update([scan], density, [(NONE, NONE)], NONE, np.zeros(0, bool))
        found = max(found, excess.log_ratio)
    return found


@pytest.mark.parametrize("kind", ["uniform", "smooth", "rough", "blocks"])
def test_clutter_of_the_box_looks_like_clutter(kind):
    scans = box(kind, 600, seed=1, redrawn=100)
    assert largest(SensorModel(), scans, 1e-6) < LOG_RATIO


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", ["arc", "ring", "spoke", "near"])
def test_clutter_on_arcs_and_rays_and_near_the_sensor_is_no_target(kind, seed):
    """Side lobes, a sea floor, interference and reverberation, for 300 pings, in even clutter."""
    rng, scans = np.random.default_rng(seed), []
    for _ in range(300):
        number, even = rng.poisson(12), rng.poisson(5)
        range_, azimuth = {
            "arc": (100.0 + rng.standard_normal(number), rng.uniform(-1.0, 1.0, number)),
            "ring": (40.0 + 3.0 * rng.standard_normal(number), rng.uniform(-3.1, 3.1, number)),
            "spoke": (300.0 * rng.random(number), 0.5 + 0.01 * rng.standard_normal(number)),
            "near": (1.0 + rng.exponential(15.0, number), rng.uniform(-3.1, 3.1, number)),
        }[kind]
        range_ = np.append(range_, 300.0 * np.sqrt(rng.random(even)))
        azimuth = np.append(azimuth, rng.uniform(-np.pi, np.pi, even))
        scans.append(Scan(0.0, np.maximum(range_, 0.1), azimuth))
    assert largest(SensorModel(max_range=300.0), scans, 6e-5) < LOG_RATIO


def test_pairs_of_detections_may_be_two_targets():
    scans = [Scan(float(k), [50.0, 51.0], [0.0, 0.0]) for k in range(200)]
    assert largest(TANK, scans, DENSITY) == 0.0


def beside_a_track(offset) -> float:
    """Largest L after 40 pings of a track with another detection at an offset, m."""
    excess, track_id = SeveralEchoesTest(TANK), np.array([7])
    for ping in range(40):
        scan = Scan(float(ping), [50.0, 50.0 + offset(ping)], [0.0, 0.0])
        take(excess, scan, (track_id, np.array([0])), track_id, [False])
    return excess.log_ratio


def test_what_lies_now_on_one_side_of_a_track_and_now_on_the_other_is_its_own():
    assert beside_a_track(lambda ping: 3.0 * (-1.0) ** ping) > LOG_RATIO


def test_what_lies_on_one_side_of_a_track_is_a_second_targets():
    assert beside_a_track(lambda ping: 3.0) == 0.0


@pytest.mark.parametrize(("apart", "shown"), [(True, False), (False, True)])
def test_what_tracks_apart_from_each_other_explain_is_no_evidence_for_one_target(apart, shown):
    """Five targets in a row, each with a track of its own, for 60 pings."""
    test, rng, own = SeveralEchoesTest(TANK), np.random.default_rng(2), np.arange(5)
    found = []
    for ping in range(60):
        range_ = 50.0 + 3.0 * own + 0.2 * rng.standard_normal(5)
        scan = Scan(float(ping), range_, 0.004 * rng.standard_normal(5))
        take(test, scan, (own, own), own, np.full(5, apart))
        found.append(test.log_ratio >= LOG_RATIO)
    assert any(found) == shown


def test_clusters_are_made_no_longer_once_nothing_lies_beside_the_tracks():
    targets, own = ExtendedTargets(TANK, CommonOptions()), (np.array([3]), np.array([0]))
    confirmed, on = ConfirmedTracks.from_tracks(tracks(3), 0.9), []
    for ping in range(900):
        several = ping < 20
        scan = Scan(float(ping), np.full(1 + 2 * several, 50.0), 0.01 * np.arange(1 + 2 * several))
        targets.clusters_of(scan, np.zeros(len(scan), bool))
        targets.learn(own, confirmed, DENSITY, True)
        on.append(targets.seen)
    assert on[30] and not on[-1]
    assert targets.test.log_ratio < END_LOG_RATIO


def test_tracks_in_any_order_and_with_gaps_count_as_each_alone():
    """Nine tracks far apart; each is in some pings only, in an order that changes."""
    rng, number = np.random.default_rng(5), 9
    together, alone = SeveralEchoesTest(TANK), [SeveralEchoesTest(TANK) for _ in range(9)]
    ids, azimuth = 40 + rng.permutation(number), np.linspace(-2.5, 2.5, number)
    for ping in range(30):
        side = rng.choice([-1.0, 1.0], number) * (rng.random(number) < 0.7)
        seen = rng.permutation(number)[: rng.integers(0, number + 1)]
        for test, rows in ((together, seen), *((alone[row], seen[seen == row]) for row in seen)):
            range_ = np.append(np.full(len(rows), 50.0), 50.0 + 3.0 * side[rows])
            scan = Scan(float(ping), range_, np.tile(azimuth[rows], 2))
            apart = rng.random(number) < 0.5
            take(test, scan, (ids[rows], np.arange(len(rows))), ids, apart)
    assert together._tracks["pings"].max(axis=1).sum() > 60
    for row, track_id in enumerate(ids):
        (mine,), (its,) = (
            test._tracks[test._tracks["track_id"] == track_id] for test in (together, alone[row])
        )
        assert mine["offset"] == pytest.approx(its["offset"])
        assert mine["pings"].tolist() == its["pings"].tolist()


def test_pings_that_are_learned_from_together_count_as_one_by_one():
    """Two tracks with others now on one side and now on the other, in clutter of a tank."""
    rng, ids, apart = np.random.default_rng(7), np.array([4, 9]), np.zeros(2, bool)
    together, alone = SeveralEchoesTest(TANK), SeveralEchoesTest(TANK)
    for _ in range(8):
        scans, own = [], []
        for _ in range(5):
            targets = np.array([40.0, 70.0])
            beside = targets + rng.choice([-3.0, 3.0], 2)
            range_ = np.concatenate([targets, beside, rng.uniform(5, 99, 8)])
            azimuth = np.concatenate([[0.0, 1.0, 0.0, 1.0], rng.uniform(-3.0, 3.0, 8)])
            scans.append(Scan(0.0, range_, azimuth))
            seen = rng.permutation(2)[: rng.integers(0, 3)]
            own.append((ids[seen], seen))
            take(alone, scans[-1], own[-1], ids, apart)
        together.update(scans, DENSITY, own, ids, apart)
    assert alone._tracks["pings"].sum() > 50.0
    np.testing.assert_array_equal(together._tracks["pings"], alone._tracks["pings"])
    np.testing.assert_allclose(together._tracks["offset"], alone._tracks["offset"])
    np.testing.assert_allclose(together._pairs.counted, alone._pairs.counted, rtol=0.05, atol=0.1)
    np.testing.assert_allclose(together._more.expected, alone._more.expected, rtol=0.05, atol=0.1)
    assert together.log_ratio > LOG_RATIO and alone.log_ratio > LOG_RATIO


def test_a_seam_of_a_sweep_parts_no_neighbours():
    azimuth = [math.pi - 0.004, 0.004 - math.pi, 0.008 - math.pi]
    pose = [[0.0, 0.0, 0.3], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    scan = Scan(0.0, [1000.0] * 3, azimuth, sensor_pose=pose, time_offset=[12.0, 0.0, 0.01])
    number, _ = counted(scan, np.arange(3), boxes_of(SensorModel(max_range=2000.0)))
    assert number[-1].tolist() == [2.0, 2.0, 2.0]


def counted(scan: Scan, centre, extents) -> tuple[np.ndarray, np.ndarray]:
    """Numbers in boxes around some detections of a scan, and in strips."""
    ping = np.zeros(len(scan), np.int64)
    beside = NeighbourCounts(scan.range, scan.azimuth, ping, centre, extents)
    assert beside.centre.tolist() == centre.tolist()
    sums = beside.counted(ping == 0, 3)
    return sums[0], sums[1:]


@pytest.mark.parametrize(
    ("target_extent", "seen", "active"),
    [(0.0, False, False), (0.0, True, True), (4.0, False, True)],
)
def test_clusters_are_made_with_an_extent_that_is_stated_or_learned(target_extent, seen, active):
    targets = ExtendedTargets(TANK, CommonOptions(target_extent=target_extent))
    targets.seen = seen
    assert targets.active is active
    targets.seen = True
    same = targets.under(TANK, targets.common)
    assert same.seen and same.test is not targets.test
    assert not targets.under(replace(TANK, max_range=90.0), targets.common).seen


def test_counts_are_those_of_a_loop():
    rng, extents = np.random.default_rng(3), boxes_of(TANK)
    scan = Scan(0.0, rng.uniform(40.0, 60.0, 30), rng.uniform(-0.2, 0.2, 30))
    centre = np.array([4, 9, 20])
    number, strips = counted(scan, centre, extents)
    for size, extent in enumerate(Extent(*one) for one in extents[..., 0].T):
        for place, one in enumerate(centre):
            across = extent.across_at(scan.range[one])
            counts = np.zeros(3)
            for other in set(range(30)) - {one}:
                depth = abs(scan.range[other] - scan.range[one]) / extent.along
                turn = abs(scan.azimuth[other] - scan.azimuth[one])
                width = scan.range[one] * turn / across
                counts += [
                    depth <= 1.0 and width <= 1.0,
                    depth <= 1.0 and 2.0 < width <= 3.0,
                    2.0 < depth <= 3.0 and width <= 1.0,
                ]
            found = [number[size, place], *strips[:, size, place]]
            np.testing.assert_array_equal(found, counts)


def test_the_log_ratio_is_that_of_poisson_counts():
    found, expected = np.array([6.0, 1.0]), np.array([1.0, 1.0])
    log_of = 6.0 * math.log(6.0 / MAX_CLUTTER_RATIO) - (6.0 - MAX_CLUTTER_RATIO)
    np.testing.assert_allclose(log_ratio_of(found, expected), [log_of, 0.0])


@pytest.mark.parametrize("share", [0.1, 0.02])
def test_in_a_shorter_range_every_length_is_as_much_shorter(share):
    sea, tank = (boxes_of(SensorModel(max_range=100.0 * one)) for one in (1.0, share))
    np.testing.assert_allclose(tank[0], share * sea[0])


def test_boxes_have_the_resolution_of_the_sensor():
    sensor = SensorModel(range_resolution=0.5, azimuth_resolution=0.02)
    assert boxes_of(sensor)[:, 0, 0].tolist() == [1.5, 1.0, 0.02, math.inf]


@pytest.mark.parametrize(("length", "known"), [(4.0, 4.0), (0.5, 2.0), (30.0, 4.0 * 12**0.5)])
def test_the_scatter_of_tracks_tells_the_extent_within_bounds(length, known):
    """Innovations of clusters of three, on a line along either axis, without other errors."""
    rng, three = np.random.default_rng(4), np.zeros(3)
    targets = ExtendedTargets(TANK, CommonOptions(target_extent=4.0))
    assert targets.extent_variance == pytest.approx(4.0**2 / 12.0)
    for ping in range(400):
        scan = Scan(float(ping), 50.0 + three, three)
        targets.clusters_of(scan, np.zeros(3, bool))
        variance = targets.extent_variance / 3.0 + 0.1
        place = rng.uniform(-0.5, 0.5, (3, 2)).mean(axis=0) * length
        error = place + math.sqrt(0.1) * rng.standard_normal(2)
        targets.learn_scatter(error[None], variance * np.eye(2)[None], np.array([0]))
    # 50 clusters count: 10 % of the variance is a standard deviation.
    assert targets.extent_variance == pytest.approx(known**2 / 12.0, rel=0.4)


@pytest.mark.parametrize(("standing", "shown"), [(1.0, False), (0.0, True), (math.nan, True)])
def test_things_that_stand_side_by_side_alone_are_no_targets_of_several_detections(standing, shown):
    targets, none = ExtendedTargets(TANK, CommonOptions()), (NONE, NONE)
    confirmed = ConfirmedTracks.none()
    for ping in range(60):
        places = 50.0 + np.array([0.0, 1.0, 2.0, 40.0]), np.zeros(4)
        features = {"standing": np.array([standing, standing, standing, 0.0])}
        targets.clusters_of(Scan(float(ping), *places, features=features), np.zeros(4, bool))
        targets.learn(none, confirmed, DENSITY, True)
    assert targets.test.log_ratio > LOG_RATIO
    assert targets.seen == shown


LITTLE, SOME, MUCH = math.log(2.0), math.log(100.0), math.log(1e7)


@pytest.mark.parametrize(
    ("before", "of_all", "of_moving", "told", "after"),
    [
        (False, MUCH, MUCH, True, True),
        (False, MUCH, LITTLE, True, False),
        (False, MUCH, LITTLE, False, True),
        (False, SOME, MUCH, True, False),
        (True, SOME, LITTLE, True, True),
        (True, LITTLE, SOME, True, True),  # things that stand all round hide it
        (True, LITTLE, MUCH, False, False),  # it was told once
        (True, LITTLE, LITTLE, True, False),
    ],
)
def test_clusters_begin_where_both_counts_show_it_and_end_where_neither_does(
    monkeypatch, before, of_all, of_moving, told, after
):
    targets = ExtendedTargets(TANK, CommonOptions())
    ratios = {id(targets.test): of_all, id(targets.test_of_moving): of_moving}
    monkeypatch.setattr(SeveralEchoesTest, "log_ratio", property(lambda self: ratios[id(self)]))
    targets.seen = before
    features = {"standing": np.zeros(2)} if told else {}
    scan = Scan(0.0, [50.0, 51.0], [0.0, 0.0], features=features)
    targets.clusters_of(scan, np.zeros(2, bool))
    targets.learn((NONE, NONE), ConfirmedTracks.none(), DENSITY, True)
    assert targets.seen == after


def test_pairs_of_a_dense_ping_are_bounded(monkeypatch):
    pairs = []

    class Counted(NeighbourCounts):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            pairs.append(len(self.row))

    monkeypatch.setattr(extended_targets, "NeighbourCounts", Counted)
    rng, test = np.random.default_rng(1), SeveralEchoesTest(TANK)
    for number in (400, 4000, 200_000):
        take(test, Scan(0.0, rng.uniform(30.0, 40.0, number), 0.1 * rng.random(number)))
    assert min(pairs[:2]) > 1e5 and max(pairs) <= MOST_PAIRS


def test_a_target_may_have_another_cluster_within_its_extent_along_and_across():
    confirmed = ConfirmedTracks.from_tracks(tracks(3, x=2000.0), 0.8)
    at = confirmed.tracks.state[0, 0::2]
    sight = at / np.hypot(*at)
    across = np.array([-sight[1], sight[0]])
    extent = Extent(10.0, 4.0, 0.001)  # 4 m and 0.001 rad across
    wide = 4.0 + 0.001 * np.hypot(*at)
    offsets = [(9.0, 0.0), (11.0, 0.0), (0.0, wide - 0.1), (0.0, wide + 0.1), (-9.9, 1 - wide)]
    places = np.array([at + a * sight + b * across for a, b in offsets])
    origin = np.array([0.0, 0.0])
    density = density_of_further(confirmed, places, extent, origin)
    value = 0.8 / (4.0 * 10.0 * wide)
    np.testing.assert_allclose(density, [value, 0.0, value, 0.0, value])
    moved = density_of_further(confirmed, places, extent, at - 100.0 * across)
    assert (moved[:2] == 0.0).all(), "seen from elsewhere, across is along"
