"""Hulls: learned from detections along a line, told from targets side by side, joined to a plot."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from tsepm_ros.tracker.clustering import PlotExtent
from tsepm_ros.tracker.maintenance import shape as module
from tsepm_ros.tracker.maintenance.shape import (
    GATE,
    PLACE,
    START_STD,
    Hull,
    Hulls,
    area_outside,
    beside_earlier,
    in_two_places,
)
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

CLUTTER = 2e-4
LONGEST_PLOT = 16.0
AZIMUTH_STD = 0.01
EXTENT = PlotExtent(LONGEST_PLOT, LONGEST_PLOT)


def tracks(*places: tuple[float, float], age: float = 5.0) -> TrackArrays:
    return TrackArrays.of(
        [
            ConfirmedTrack(
                track_id=number,
                stamp=0.0,
                state=np.array([x, 0.0, y, 0.0]),
                covariance=np.eye(4),
                hits=((0, 0),),
                evaluation=0.0,
                age=age,
            )
            for number, (x, y) in enumerate(places)
        ]
    )


def scan_of(position: np.ndarray) -> Scan:
    return Scan(0.0, np.hypot(*position.T), np.arctan2(position[:, 1], position[:, 0]))


def along_a_hull(rng: np.random.Generator, length: float) -> np.ndarray:
    place = np.stack([np.full(5, 150.0), length * (rng.random(5) - 0.5)], axis=1)
    return place + 0.5 * rng.standard_normal(place.shape)


def side_by_side(rng: np.random.Generator, apart: float) -> np.ndarray:
    place = np.array([[150.0, 0.0]] * 3 + [[150.0, apart]] * 3)
    return place + rng.standard_normal(place.shape)


def learned(draw, length: float, seed: int, pings: int = 12) -> Hulls:
    rng, hulls, held = np.random.default_rng([seed, 3]), Hulls(), tracks((150.0, 0.0))
    for _ in range(pings):
        position = draw(rng, length)
        stray = np.array([150.0, 0.0]) + rng.uniform(-60.0, 60.0, (rng.poisson(2), 2))
        position = np.concatenate([position, stray])
        clutter = np.full(len(position), CLUTTER)
        learn(hulls, position, clutter, held)
    return hulls


def learn(hulls: Hulls, position: np.ndarray, clutter: np.ndarray, held: TrackArrays) -> None:
    around, alone = np.full(len(held), CLUTTER), np.arange(len(position))
    hulls.learn(scan_of(position), alone, clutter, held, around, EXTENT, AZIMUTH_STD)


@pytest.mark.parametrize("length", [40.0, 60.0])
def test_highlights_along_a_hull_become_one_plot(length):
    for seed in range(5):
        hulls, held = learned(along_a_hull, length, seed), tracks((150.0, 0.0))
        place = np.array([[150.0, -0.4 * length], [60.0, 0.0], [150.0, 0.4 * length]])
        label, wander = hulls.joined(scan_of(place), np.arange(3), held)
        assert label.tolist() == [0, 1, 0]
        # The hull lies across the line of sight.
        assert wander[0, 1] > 0.5 * length**2 / 12.0
        assert wander[0, 0] < 0.3 * wander[0, 1]
        assert not wander[1].any()


@pytest.mark.parametrize("apart", [20.0, 40.0])
def test_targets_side_by_side_are_no_hull(apart):
    for seed in range(5):
        hulls, held = learned(side_by_side, apart, seed), tracks((150.0, 0.0))
        place = np.array([[150.0, 0.0], [150.0, apart]])
        label, wander = hulls.joined(scan_of(place), np.arange(2), held)
        assert label.tolist() == [0, 1]
        assert not wander.any()
        assert not hulls.waiting(tracks((150.0, apart)), held, 64.0, 1.0).any()


def test_a_group_that_a_hull_cuts_keeps_its_rest_together():
    hulls, held = learned(along_a_hull, 40.0, 0), tracks((150.0, 0.0))
    place = np.array([[150.0, 5.0], [190.0, 0.0], [190.0, 1.0], [150.0, -5.0]])
    label, _ = hulls.joined(scan_of(place), np.zeros(4, np.int64), held)
    assert label.tolist() == [0, 1, 1, 0]


def test_the_scatter_is_the_lines():
    rng, hull = np.random.default_rng(1), Hull.unknown()
    for _ in range(200):
        apart = along_a_hull(rng, 40.0) - [150.0, 0.0]
        hull = hull.after(apart, np.arange(5), np.full(5, 1e-9), 1e-9, LONGEST_PLOT / 2.0)
    assert hull.length == pytest.approx(40.0, rel=0.15)
    assert hull.covariance[0, 0] < 1.0


def test_detections_in_one_spot_for_ever_leave_a_covariance():
    hull = Hull.unknown()
    for _ in range(3000):
        hull = hull.after(
            np.zeros((4, 2)), np.arange(4), np.full(4, CLUTTER), CLUTTER, LONGEST_PLOT / 2.0
        )
    assert np.linalg.eigvalsh(hull.covariance)[0] > 0.1
    assert not hull.found(LONGEST_PLOT, PLACE)


@pytest.mark.parametrize(
    ("beyond", "expected", "more"),
    [(30.0, 19.9, True), (30.0, 20.1, False), (2.0, 0.0, True), (1.9, 0.0, False)],
)
def test_a_hull_has_more_plots_than_half_again_as_dense_clutter_explains(beyond, expected, more):
    assert replace(Hull.unknown(), beyond=beyond, expected=expected).beyond_clutter == more


@pytest.mark.parametrize(("minor", "major"), [(2.0, 30.0), (10.0, 12.0), (5.0, 8.0)])
@pytest.mark.parametrize("radius", [1.0, 9.0, 40.0])
def test_the_area_beside_the_plot_is_about_that_of_points(minor, major, radius):
    x, y = np.random.default_rng(8).uniform(-major, major, (2, 400_000))
    outside = ((x / major) ** 2 + (y / minor) ** 2 <= 1.0) & (np.hypot(x, y) > radius)
    expected = 4.0 * major**2 * outside.mean()
    whole = np.pi * minor * major
    assert area_outside(minor, major, radius) == pytest.approx(expected, abs=0.08 * whole)


def test_detections_and_clutter_beside_the_plot_are_counted_and_fade():
    apart = np.array([[1.0, 0.0], [0.0, 12.0], [-20.0, 0.0], [0.0, 70.0]])
    label, clutter, radius = np.arange(4), np.full(4, CLUTTER), LONGEST_PLOT / 2.0
    hull = Hull.unknown().after(apart, label, clutter, CLUTTER, radius)
    assert hull.beyond == 2.0, "neither what is in the plot nor what is beyond the hull's gate"
    as_one = Hull.unknown().after(apart, np.array([0, 1, 1, 2]), clutter, CLUTTER, radius)
    assert as_one.beyond == 1.0, "two detections of a plot are one"
    scatter = START_STD**2 + 0.25
    expected = CLUTTER * np.pi * (GATE * scatter - (LONGEST_PLOT / 2.0) ** 2)
    assert hull.expected == pytest.approx(expected)
    later = hull.after(np.zeros((0, 2)), label[:0], clutter[:0], 0.0, radius)
    assert (later.beyond, later.expected) == pytest.approx((0.95 * 2.0, 0.95 * expected))
    unknown = hull.after(apart, label, clutter, np.nan, radius)
    assert (unknown.beyond, unknown.expected) == (hull.beyond, hull.expected)


@pytest.mark.parametrize("density", [5e-4, 2e-3])
def test_clutter_around_a_track_is_no_hull_however_dense(density):
    rng, held = np.random.default_rng(5), tracks((150.0, 0.0))
    found = 0
    for _ in range(10):
        hulls = Hulls()
        for _ in range(40):
            # In plots of two detections.
            number = rng.poisson(density * 200.0**2)
            stray = np.repeat(rng.uniform(-100.0, 100.0, (number, 2)), 2, axis=0)
            stray += 0.2 * rng.standard_normal(stray.shape)
            position = np.array([150.0, 0.0]) + np.concatenate([np.zeros((2, 2)), stray])
            label, clutter = np.arange(len(position)) // 2, np.full(len(position), density)
            scan, around = scan_of(position), np.array([density])
            hulls.learn(scan, label, clutter, held, around, EXTENT, AZIMUTH_STD)
            beside = tracks((150.0, 15.0), age=40.0)
            found += int(hulls.waiting(beside, tracks((150.0, 0.0), age=40.0), 0.0, 1.0).any())
    assert found == 0


def test_the_detections_of_three_held_targets_are_no_hull():
    rng, held = np.random.default_rng(6), tracks((150.0, 0.0), (150.0, 30.0), (150.0, -25.0))
    hulls = Hulls()
    for _ in range(20):
        position = np.repeat(held.state[:, 0::2], 3, axis=0) + rng.standard_normal((9, 2))
        learn(hulls, position, np.full(9, CLUTTER), held)
    label, wander = hulls.joined(scan_of(held.state[:, 0::2]), np.arange(3), held)
    assert label.tolist() == [0, 1, 2]
    assert not wander.any()


def test_the_share_in_two_places_is_that_of_all_pairs_of_intervals():
    rng = np.random.default_rng(4)
    for n in (1, 2, 7, 12):
        along, weight = rng.uniform(0.0, 40.0, n), rng.random(n)
        inside = [(along >= start) & (along <= start + 6.0) for start in along]
        best = max(weight[one].sum() for one in inside)
        for one, other in combinations(inside, 2):
            best = max(best, weight[one | other].sum())
        assert in_two_places(along, weight, 6.0) == pytest.approx(best / weight.sum())


def test_starts_beside_a_young_track_wait_until_its_hull_is_learned():
    hulls, new = Hulls(), tracks((150.0, 30.0), (150.0, 100.0))
    assert hulls.waiting(new, tracks((150.0, 0.0)), 64.0, 1.0).tolist() == [True, False]
    old = tracks((150.0, 0.0), age=17.0)
    assert not hulls.waiting(new, old, 64.0, 1.0).any()
    near = tracks((150.0, 70.0), (150.0, 100.0))
    assert hulls.waiting(near, old, 64.0, 1.0).tolist() == [False, True], "the first of two starts"
    hull = learned(along_a_hull, 60.0, 2)
    beside = tracks((150.0, 25.0), (200.0, 0.0))
    assert hull.waiting(beside, old, 0.0, 1.0).tolist() == [True, False]


@pytest.mark.parametrize("number", [0, 1, 2, 30, 200])
def test_what_waits_is_beside_an_earlier_one_that_does_not(number):
    rng = np.random.default_rng(number)
    places = rng.uniform(0.0, 300.0, (number, 2))
    places[: number // 4] = places[0] if number else 0.0  # many in one place
    kept: list[np.ndarray] = []
    expected = []
    for place in places:
        beside = any(np.hypot(*(place - one)) < 20.0 for one in kept)
        expected.append(beside)
        if not beside:
            kept.append(place)
    assert beside_earlier(places, 20.0).tolist() == expected


def test_of_very_many_tracks_the_oldest_learn_their_hulls(monkeypatch):
    monkeypatch.setattr(module, "MOST_TRACKS", 1)
    held = tracks((150.0, 0.0), (0.0, 150.0))
    hulls, rng = Hulls(), np.random.default_rng(2)
    for _ in range(20):
        both = [along_a_hull(rng, 60.0), along_a_hull(rng, 60.0)[:, ::-1]]
        learn(hulls, np.concatenate(both), np.full(10, CLUTTER), held)
    beside = tracks((150.0, 25.0), (25.0, 150.0))
    old = tracks((150.0, 0.0), (0.0, 150.0), age=40.0)
    assert hulls.waiting(beside, old, 0.0, 1.0).tolist() == [True, False]
