"""Clutter zones and encounters: closest approach, and what they change in the association."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from support.builders import AS_GIVEN, assert_same_tracks, detections, scan_at

from tsepm_ros import SensorModel, available_methods, make_initiator
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tools.simulation.scenario import Scenario
from tsepm_ros.tracker.assignment import Pairs
from tsepm_ros.tracker.clutter.density import Cells, ClutterMap
from tsepm_ros.tracker.maintenance.features import (
    Environment,
    Surroundings,
    closest_approach,
    distance_at,
    histories_of,
    meeting,
)
from tsepm_ros.tracker.measurement import DetectionWindow, Histories

BIG, SMALL = np.array([60.0, 50.0, 0.02]), np.array([20.0, 10.0, 0.01])


def plots_like(features: np.ndarray, number: int, seed: int = 1) -> np.ndarray:
    return features * (1.0 + 0.1 * np.random.default_rng(seed).standard_normal((number, 3)))


TWO = Histories.of(np.stack([plots_like(BIG, 10), plots_like(SMALL, 10)]))
APART, TOGETHER = np.zeros((2, 2), bool), ~np.eye(2, dtype=bool)


def environment(in_zone: list[bool], clutter: np.ndarray | None = None) -> Environment:
    return Environment(np.array(in_zone), np.zeros((0, 3)) if clutter is None else clutter, 60.0)


def all_pairs(cost: list[list[float]]) -> Pairs:
    parent, row = np.indices(np.shape(cost)).reshape(2, -1)
    return Pairs(parent, row, np.ravel(cost).astype(float))


def test_in_a_zone_only_alike_plots_count_and_against_alike_clutter():
    # Of 9 plots of clutter 2 are like the first track's, 7 like the second's: (1 + k) / (1 + 9).
    clutter = np.concatenate([np.tile(BIG, (2, 1)), np.tile(SMALL, (7, 1))])
    factors = environment([True, False], clutter).factors(
        TWO, APART, all_pairs([[1.0, 1.0], [1.0, 1.0]]), np.stack([BIG, BIG])
    )
    assert factors.tolist() == pytest.approx([10.0 / 3.0, 1.0, 0.0, 1.0])
    factors = environment([True], clutter).factors(
        TWO, APART, all_pairs([[1.0], [1.0]]), SMALL[None]
    )
    assert factors.tolist() == pytest.approx([0.0, 10.0 / 8.0])


def test_plots_that_resemble_several_go_by_their_distance():
    same = Histories.of(np.stack([plots_like(BIG, 10), plots_like(BIG, 10)]))
    features = np.stack([BIG, BIG])
    for cost, expected in (
        ([[0.0, 4.0], [4.0, 0.0]], [1.0, 0.0, 0.0, 1.0]),
        ([[4.0, 0.0], [0.0, 4.0]], [0.0, 1.0, 1.0, 0.0]),
        ([[4.0, np.inf], [3.0, np.inf]], [0.0, 1.0, 1.0, 1.0]),  # the second is in no gate
    ):
        factors = environment([False, False]).factors(same, TOGETHER, all_pairs(cost), features)
        assert factors.tolist() == expected
        factors = environment([False, False]).factors(same, APART, all_pairs(cost), features)
        assert factors.tolist() == [1.0, 1.0, 1.0, 1.0]


def test_histories_are_those_of_the_hits_as_far_as_remembered():
    window = DetectionWindow()
    for scan in range(30):
        found = detections([[0.0, 0.0], [500.0, 0.0]], float(scan))
        found["scan"], found["index"] = scan, [0, 3]
        found["features"] = [[scan] * 3, [scan + 0.5] * 3]
        window.append(found)
    window.forget(10)
    found = histories_of(window, [((0, 0), (20, 3), (29, 0)), ((1, 0),)])
    assert found.count.tolist() == [[2.0] * 3, [0.0] * 3], "scans 0 and 1 are forgotten"
    assert found.mean[0, 0] == pytest.approx((20.5 + 29.0) / 2.0)


def test_only_plots_of_clutter_tell_of_clutter():
    surroundings = Surroundings()
    nothing = np.full((1, 3), np.nan)
    features = np.concatenate([SMALL[None], BIG[None], nothing])
    surroundings.observe(features, np.array([True, False, True]))
    assert surroundings.clutter.tolist() == [SMALL.tolist()]


def test_a_zone_is_where_clutter_is_dense_against_the_coverage():
    sensor = SensorModel(max_range=6000.0, clutter_density=1e-7)
    clutter = ClutterMap(sensor)
    rng = np.random.default_rng(5)
    for _ in range(30):
        x, y = rng.uniform(2000.0, 3500.0, (2, 20))
        more = rng.uniform(-4000.0, 4000.0, (2, 6))
        x, y = np.concatenate([[x, y], more], axis=1)
        clutter.update(clutter.grid.cells(np.hypot(x, y), np.arctan2(y, x)), np.ones(len(x)))
    inside, outside = (2750.0, 2750.0), (-2750.0, 2750.0)
    x, y = np.array([inside, outside]).T
    assert clutter.in_zone(clutter.grid.cells(np.hypot(x, y), np.arctan2(y, x))).tolist() == [
        True,
        False,
    ]


@pytest.mark.parametrize("method", available_methods())
@pytest.mark.parametrize("outside", [0, 1, 5])
def test_echoes_outside_the_coverage_change_no_track_s_features(method, outside):
    # A track of features like BIG, beside a plot like SMALL, behind echoes that do not count.
    sensor = SensorModel(range_std=10.0, range_std_fraction=0.0, azimuth_std=0.003, max_range=8e3)
    made = make_initiator(method, sensor=sensor, plot_features=True)
    own, other = plots_like(BIG, 20, seed=4), plots_like(SMALL, 20, seed=5)
    started = []
    for k in range(20):
        plots = np.concatenate([np.full((outside, 3), 1e4), own[k : k + 1], other[k : k + 1]])
        scan = scan_at(
            12.0 * k,
            [*[(20e3, 0.0)] * outside, (3000.0 + 60.0 * k, 0.0), (-5000.0, 300.0 * (k % 2))],
            features=dict(zip(("intensity", "range_width", "azimuth_width"), plots.T, strict=True)),
        )
        for track in made.process(scan):
            started.append(track)
            features = np.array([own[scan] for scan, index in track.hits if index == outside])
            if len(features) == len(track.hits):
                found = histories_of(made.window, [track.hits])
                np.testing.assert_allclose(found.mean[0], features.mean(axis=0))
    assert started, "the target is found"
    assert made.statistics.outside_coverage == outside


def overtaking() -> Scenario:
    """A ship overtakes another 20 m abeam, 100 m in bearing errors, after 99 s."""
    base = load_scenario("encounter")
    ships = [
        np.array([-2400.0 - 99.0 * speed, speed, y, 0.0]) for speed, y in ((5, -17300), (3, -17280))
    ]
    sector = replace(base.sensor, azimuth_min=-2.1, azimuth_max=-1.3)
    return replace(base, targets=tuple(ships), sensor=sector, clutter_patches=(), scans=70)


def held_through(features: bool, seed: int) -> bool:
    """Whether the tracks of both ships go on, each with its own."""
    scenario = overtaking()
    made = make_initiator("score", sensor=scenario.sensor, plot_features=features, **AS_GIVEN)
    own = []
    for scan in Simulator(scenario, seed):
        made.process(scan.scan)
        tracks = made.current
        apart = tracks.state[:, None, 0::2] - scan.truth[None, :, 0::2]
        nearest = np.square(apart).sum(axis=2).argmin(axis=0) if len(tracks) else []
        own.append([int(tracks.track_id[row]) for row in nearest])
    return own[-1] == own[15] and len(set(own[-1])) == 2


@pytest.mark.long
def test_features_keep_two_tracks_apart_that_are_one_without():
    assert [held_through(True, seed) for seed in range(12)] == [True] * 12
    # 3 of 12: the tracks are exchanged, or one of the ships gets another.
    assert sum(held_through(False, seed) for seed in range(12)) <= 4


class Zone(ClutterMap):
    """A clutter map all or nothing of which is a zone."""

    def __init__(self, sensor: SensorModel, zone: bool) -> None:
        super().__init__(sensor)
        self.zone = zone

    def in_zone(self, cells: Cells) -> np.ndarray:
        return np.full(len(cells.row), self.zone)


@pytest.mark.parametrize("method", ["sequential", "logic", "multiple_model"])
def test_a_scan_by_scan_method_leaves_out_unlike_plots_in_a_zone(method):
    # A target straight ahead; then its plot or one of clutter in its place.
    def hits(features: bool, last: np.ndarray, zone: bool) -> int:
        sensor = SensorModel(range_std=10.0, range_std_fraction=0.0, azimuth_std=0.003)
        made = make_initiator(method, sensor=sensor, min_hits=12, window=14, plot_features=features)
        learned = dataclasses.replace(made.learned, clutter_map=Zone(sensor, zone))
        made.learned = learned
        plots = plots_like(BIG, 9, seed=4)
        plots[-1] = last
        for k, (intensity, depth, width) in enumerate(plots):
            made.process(
                scan_at(
                    12.0 * k,
                    [(3000.0 + 20.0 * k, 0.0)],
                    features={
                        "intensity": [intensity],
                        "range_width": [depth],
                        "azimuth_width": [width],
                    },
                )
            )
        return max(len(track.hits) for track in made.potential_tracks())

    assert hits(True, BIG, zone=True) == 9
    assert hits(True, SMALL, zone=True) == 8
    assert hits(True, SMALL, zone=False) == hits(False, SMALL, zone=True) == 9


def test_without_features_and_encounters_the_option_changes_nothing():
    scenario = load_scenario("four_targets", {"sensor.clutter_density": 3e-7, "scans": 20})
    one = make_initiator("score", sensor=scenario.sensor)
    other = make_initiator("score", sensor=scenario.sensor, plot_features=True)
    started = 0
    for scan in Simulator(scenario, 4):
        assert_same_tracks(one.process(scan.scan), other.process(scan.scan))
        np.testing.assert_array_equal(one.current.state, other.current.state)
        started += one.statistics.confirmed
    assert started >= 2


def published(axis: str) -> tuple[np.ndarray, np.ndarray]:
    """Ships A and B of Section 2.2, angles clockwise from north or counter-clockwise from east."""

    def ship(distance: float, bearing: float, speed: float, heading: float) -> np.ndarray:
        bearing, heading = np.deg2rad([bearing, heading])
        first, second = (np.sin, np.cos) if axis == "north" else (np.cos, np.sin)
        return np.array(
            [
                distance * first(bearing),
                speed * first(heading),
                distance * second(bearing),
                speed * second(heading),
            ]
        )

    return ship(18e3, 187.0, 6.0, 330.0), ship(17e3, 189.0, 4.0, 190.0)


def moved(state: np.ndarray, time: float) -> np.ndarray:
    return state + time * np.array([state[1], 0.0, state[3], 0.0])


@pytest.mark.parametrize("axis", ["north", "east"])
def test_the_published_ships_meet_whatever_the_angles_are_measured_from(axis):
    one, two = published(axis)
    found = minimize_scalar(
        lambda t: math.dist(moved(one, t)[[0, 2]], moved(two, t)[[0, 2]]), bounds=(-1e3, 1e3)
    )
    time, distance = closest_approach(one, two)
    assert time == pytest.approx(found.x, abs=0.01)
    assert distance == pytest.approx(found.fun, abs=1e-3)
    assert (time, distance) == (pytest.approx(122.7, abs=0.05), pytest.approx(188.5, abs=0.05))


def test_the_shipped_scenario_has_the_published_ships():
    targets = load_scenario("encounter").targets
    np.testing.assert_allclose(targets[:2], published("north"), atol=0.01)


def test_it_is_the_printed_equation_but_for_its_sign():
    rng = np.random.default_rng(3)
    for _ in range(100):
        one, two = rng.normal(0.0, [1e3, 5.0, 1e3, 5.0], (2, 4))
        (east, ve, north, vn) = two - one
        speeds = np.hypot(one[1], one[3]), np.hypot(two[1], two[3])
        headings = math.atan2(one[1], one[3]), math.atan2(two[1], two[3])
        relative = math.sqrt(  # Eq. 1
            speeds[1] ** 2
            + speeds[0] ** 2
            - 2.0 * speeds[1] * speeds[0] * math.cos(headings[0] - headings[1])
        )
        angle = math.hypot(east, north) * math.cos(math.atan2(ve, vn) - math.atan2(east, north))
        time, _ = closest_approach(one, two)
        assert abs(time) == pytest.approx(abs(angle) / relative)  # Eq. 9
        assert np.sign(time) == -np.sign(east * ve + north * vn), "above 0 while they approach"


def test_ships_on_one_course_are_closest_now():
    state = np.array([[0.0, 3.0, 0.0, 4.0], [30.0, 3.0, 40.0, 4.0]])
    assert closest_approach(*state) == (0.0, 50.0)


@pytest.mark.parametrize(
    ("within", "width", "met"),
    [(125.0, 188.6, True), (125.0, 188.4, False), (120.0, 190.3, True), (120.0, 190.2, False)],
)
def test_targets_meet_where_their_gates_overlap_in_time(within, width, met):
    # Two gates of half the width each, 3 standard deviations of the state's and the plot's error.
    states = np.stack(published("north"))
    spread = np.zeros((2, 4, 4))
    spread[:, [0, 2], [0, 2]] = 3.0**2
    error = math.sqrt((width / 6.0) ** 2 - 9.0)
    one, two = meeting(states, spread, np.full(2, error), 3.0, within)
    times = np.linspace(-within, within, 10_001)
    closest = distance_at(*states[:, None], times).min()
    assert (closest <= width) == met, "what the numbers above mean"
    assert (one.tolist(), two.tolist()) == (([0], [1]) if met else ([], []))
