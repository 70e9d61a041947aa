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
"""Summaries of runs and their figures, by hand and by every assignment that there is."""

import json
import math

import numpy as np
import pytest
from support.builders import fit_matrix
from support.run_summaries import performance_run, run_of, start

from tsepm_ros import ConfirmedTrack, SensorModel
from tsepm_ros.methods.registry import available_methods
from tsepm_ros.tools.evaluation.intervals import (
    mean_count_interval,
    proportion_interval,
)
from tsepm_ros.tools.evaluation.measures import (
    RunMeasures,
    cramer_rao_measure,
    measured_closest_approach,
    measured_start_bound,
    measures_of,
    summarise_measures,
)
from tsepm_ros.tools.evaluation.simulated_run import (
    Outcome,
    SimulatedOperatingPoint,
    SimulatedRun,
    simulate_run,
)
from tsepm_ros.tools.simulation import Scenario, load_scenario

TRUE, REDUNDANT, MISPLACED = Outcome.TRUE, Outcome.REDUNDANT, Outcome.MISPLACED

SCENE = Scenario("hand", scans=4, period=12.0, clutter_box=(0.0, 1000.0, 0.0, 2000.0))

RUNS = [
    run_of(start(0), start(3), false=(3, 0, 0, 0), targets=2),
    run_of(start(1), start(2, MISPLACED), *[start(3, REDUNDANT)] * 4, targets=2),
]


def test_counts_by_hand_of_all_scans_and_of_a_horizon():
    figures = measures_of(SCENE, RUNS)
    assert (figures.runs, figures.scans) == (2, 4)
    assert figures.found == proportion_interval(3, 4)
    assert figures.false_per_run == mean_count_interval([3, 1])
    assert figures.false_density.value == pytest.approx(2.0 / (4 * 2.0))
    assert figures.false_density.high == pytest.approx(figures.false_per_run.high / 8.0)
    assert figures.false_per_hour.value == pytest.approx(2.0 * 3600.0 / 48.0)
    assert figures.redundant_per_run.value == 2.0
    assert figures.confirmation_time.value == pytest.approx((0 + 36 + 12) / 3)
    assert figures.confirmation_median.value == 12.0
    figures = measures_of(SCENE, RUNS, 2)
    assert figures.scans == 2
    assert figures.found == proportion_interval(2, 4)
    assert figures.false_per_run == mean_count_interval([3, 0])
    assert figures.false_density.value == pytest.approx(1.5 / (2 * 2.0))
    assert figures.false_per_hour.value == pytest.approx(1.5 * 3600.0 / 24.0)
    assert figures.redundant_per_run.value == 0.0


def test_errors_of_true_and_of_pure_starts():
    mixed = start(1, pure=False, position_error=90.0, velocity_error=9.0, nees=30.0)
    far = start(1, MISPLACED, position_error=50.0, nees=10.0)
    again = start(2, REDUNDANT, position_error=1.0, nees=0.0)
    figures = measures_of(SCENE, [run_of(start(0), mixed, far, again, targets=2)])
    assert figures.position_error.value == pytest.approx(math.sqrt((30**2 + 90**2) / 2))
    assert figures.velocity_error.value == pytest.approx(math.sqrt((2**2 + 9**2) / 2))
    assert figures.nees.value == 17.0
    assert figures.pure_position_error.value == pytest.approx(math.sqrt((30**2 + 50**2) / 2))
    assert figures.pure_nees.value == 7.0
    assert figures.position_to_bound.value == pytest.approx(math.sqrt((30**2 + 50**2) / 1800))


def test_what_is_not_known_has_no_figure():
    figures = measures_of(SCENE, [run_of(held=-1)] * 3)
    assert figures.found.value == 0.0
    assert figures.text("found").startswith("0.0000 (")
    for name in ("held", "nees", "pure_nees", "position_to_bound", "confirmation_median"):
        assert math.isnan(getattr(figures, name).value)
        assert figures.text(name) == "-"


GROWING = SensorModel(range_std=20.0, range_std_fraction=0.1, azimuth_std=math.radians(3.0))

TIMES = np.array([0.0, 12.0, 24.0, 48.0, 60.0])


def line(state: np.ndarray, tau: np.ndarray) -> np.ndarray:
    return (fit_matrix(tau) @ state).reshape(-1, 2)


def test_a_target_at_rest_has_the_bound_of_two_straight_lines():
    # Range and azimuth separate: each is the bound of a line's value and slope.
    range_, tau = 6000.0, TIMES - 70.0
    bound = cramer_rao_measure(np.tile([range_, 0.0], (5, 1)), TIMES, (0.0, 0.0), GROWING, 70.0)
    variance = 20.0**2 + 600.0**2
    of_range = 1.0 / variance + 0.5 * (2 * 0.1**2 * range_ / variance) ** 2
    of_azimuth = 1.0 / (range_ * GROWING.azimuth_std) ** 2
    sums = np.array([[5.0, tau.sum()], [tau.sum(), np.square(tau).sum()]])
    expected = np.kron(np.diag([1.0 / of_range, 1.0 / of_azimuth]), np.linalg.inv(sums))
    np.testing.assert_allclose(bound, expected, rtol=1e-10, atol=1e-10)


def divergence(state, truth, tau, poses, sensor) -> float:
    """Kullback-Leibler divergence of the measurements at a state from those at the true one."""
    total = 0.0
    for here, there in zip(line(state, tau) - poses, line(truth, tau) - poses, strict=True):
        r, r_true = math.hypot(*here), math.hypot(*there)
        v, v_true = float(sensor.range_variance(r)), float(sensor.range_variance(r_true))
        turn = math.atan2(here[1], here[0]) - math.atan2(there[1], there[0])
        total += 0.5 * ((v_true + (r - r_true) ** 2) / v - 1.0 - math.log(v_true / v))
        total += 0.5 * (turn / sensor.azimuth_std) ** 2
    return total


@pytest.mark.parametrize("seed", range(4))
def test_the_information_is_the_curvature_of_the_divergence(seed):
    # Its Hessian at the true state is the Fisher information, whatever the distribution: nothing
    # of the formula is used. From a moving sensor.
    rng = np.random.default_rng([17, seed])
    truth = np.array([3000.0, 4.0, 2000.0, -3.0])
    tau, poses = TIMES - 60.0, rng.uniform(-900, 900, (5, 2))
    step = np.array([3.0, 0.1, 3.0, 0.1])
    hessian = np.zeros((4, 4))
    for i in range(4):
        for j in range(4):
            a, b = np.eye(4)[i] * step, np.eye(4)[j] * step
            corners = [(a + b, 1), (a - b, -1), (b - a, -1), (-a - b, 1)]
            values = [
                sign * divergence(truth + offset, truth, tau, poses, GROWING)
                for offset, sign in corners
            ]
            hessian[i, j] = sum(values) / (4.0 * step[i] * step[j])
    root = np.linalg.cholesky(cramer_rao_measure(line(truth, tau), TIMES, poses, GROWING, 60.0))
    np.testing.assert_allclose(root.T @ hessian @ root, np.eye(4), rtol=0, atol=2e-4)


def test_hits_of_several_sensors_bound_by_the_sum_of_their_information():
    rates = SensorModel(range_std=5.0, range_std_fraction=0.0, azimuth_std=0.01, range_rate_std=0.1)
    places, moving = np.tile([900.0, 300.0], (4, 1)), np.tile([2.0, -1.0], (4, 1))
    times = np.array([0.0, 10.0, 20.0, 30.0])

    def bound(rows, sensor):
        return cramer_rao_measure(places[rows], times[rows], (0.0, 0.0), sensor, 30.0, moving[rows])

    both = bound([0, 1, 2, 3], [rates, rates, GROWING, GROWING])
    apart = np.linalg.inv(bound([0, 1], rates)) + np.linalg.inv(bound([2, 3], GROWING))
    np.testing.assert_allclose(np.linalg.inv(both), apart, rtol=1e-9)


@pytest.mark.parametrize("times", [[], [5.0], [5.0, 5.0]])
def test_hits_at_one_time_bound_no_velocity(times):
    with pytest.raises(ValueError, match="times"):
        cramer_rao_measure(np.ones((len(times), 2)), times, (0.0, 0.0), GROWING, 5.0)


MANY = {
    "tsepm": {"min_hits": 3, "window": 4},
    "score": {"false_tracks_per_hour": 300.0},
    "sequential": {"min_hits": 3, "window": 4},
    "heuristic": {"gate_sigmas": 2.0, "max_acceleration": 2.0},
    "modified_hough": {"min_hits": 3, "window": 4, "gate_sigmas": 2.0},
}

MOVING = load_scenario(
    "box", {"scans": 8, "sound_speed": 1500.0, "own_ship.speed": 8.0, "own_ship.turn_rate": 0.01}
)


def point(method: str) -> SimulatedOperatingPoint:
    return SimulatedOperatingPoint(method, options=MANY.get(method, {}))


@pytest.mark.long
@pytest.mark.parametrize("method", available_methods())
def test_a_prefix_of_a_run_is_the_run_with_fewer_scans(method):
    started = np.zeros(2)
    for seed in range(3):
        long = performance_run((load_scenario("box", {"scans": 12}), [3, seed], point(method)))
        short = performance_run((load_scenario("box", {"scans": 7}), [3, seed], point(method)))
        assert long.first(7).as_json() == short.as_json()
        assert short.count(*Outcome) > 0
        started += long.count(*Outcome), short.count(*Outcome)
    assert started[0] > started[1]


def test_a_record_comes_back_from_json_to_the_bit():
    kept = performance_run((MOVING, [3, 1], point("tsepm")))
    assert any(not one.pure for one in kept.starts)  # these have nan
    text = json.dumps(kept.as_json(), allow_nan=False)
    again = RunMeasures.from_json(json.loads(text))
    assert repr(again) == repr(kept)


class Seer:
    """Starts a track at the target from all its echoes so far, and holds what it is told to."""

    def __init__(self, scenario: Scenario, held: list) -> None:
        self.scenario = scenario
        self.maintenance = self
        self.current = self
        self.state = np.array(held, float).reshape(-1, 4)

    def process(self, scan):
        return []


def held_at(*held) -> RunMeasures:
    sensor = {"sensor.clutter_density": 1e-20, "scans": 1}
    scene = load_scenario("box", sensor)
    seen = SimulatedOperatingPoint(
        "seer", options={}, factory=lambda one, *_: Seer(one, list(held))
    )
    return performance_run((scene, [1, 1], seen))


def test_what_is_held_is_compared_with_the_truth():
    # The target is 7071 m away: 3 sigma of 1 degree are 370 m.
    assert held_at().scans[0].held == 0
    assert held_at([5000.0, 0.0, 5300.0, 0.0], [0.0, 0.0, 0.0, 0.0]).scans[0].held == 1
    assert held_at([5000.0, 0.0, 5400.0, 0.0]).scans[0].held == 0


def test_distances_of_confirmed_tracks_by_hand_and_unknown_without_them():
    cutoff = 3.0 * 7071.07 * np.deg2rad(1.0)
    run = held_at([5000.0, 0.0, 5300.0, 0.0], [0.0, 0.0, 0.0, 0.0])
    distance, *parts = run.scans[0].distances
    assert distance == pytest.approx(math.sqrt((300.0**2 + cutoff**2) / 2), rel=1e-3)
    assert parts == pytest.approx([300.0**2, 0.0, cutoff**2 / 2], rel=1e-3)
    assert run.scans[0].clear == (), "the tracks have no ids"
    figures = measures_of(load_scenario("box", {"scans": 1}), [run, run])
    assert figures.gospa.value**2 == pytest.approx(
        sum(
            getattr(figures, f"gospa_{part}").value ** 2
            for part in ("localisation", "missed", "false")
        )
    )
    assert figures.ospa.value == distance
    assert math.isnan(figures.mota.value)
    unknown = measures_of(SCENE, RUNS)
    assert math.isnan(unknown.ospa.value) and math.isnan(unknown.gospa_false.value)


def test_accuracy_and_precision_are_of_all_scans_of_all_runs():
    # Values of ClearMotCounts: targets, matches, misses, false, switches, distance.
    runs = [
        run_of(false=(0,), clear=(2, 1, 1, 0, 0, 30.0), targets=2),
        run_of(false=(0,), clear=(2, 2, 0, 1, 1, 30.0), targets=2),
    ]
    figures = measures_of(SCENE, runs, 1)
    assert figures.mota.value == pytest.approx(1.0 - 3 / 4)
    assert figures.motp.value == pytest.approx(20.0)
    assert figures.switches_per_run.value == 0.5


def test_a_start_on_hits_of_others_or_of_one_scan_has_no_bound():
    made = simulate_run(MOVING, [3, 2], point("tsepm"))
    mixed = next(one for one in made.judged() if one.target == 0 and not one.pure)
    assert np.isnan(measured_start_bound(made, mixed)).all()
    scan, row = next(
        (scan, list(origin).index(0)) for scan, origin in enumerate(made.origins) if 0 in origin
    )
    truth = made.simulator.truth(made.scans[scan].stamp)[0]
    start = ConfirmedTrack(0, made.scans[scan].stamp, truth, np.eye(4), ((scan, row),), 0.0)
    made.starts = [(scan, start)]
    (alone,) = SimulatedRun.judged(made)
    assert alone.pure
    assert np.isnan(measured_start_bound(made, alone)).all()


class Corrector:
    """Starts on clutter at the target's place, and corrects the start two scans later."""

    def __init__(self, scenario: Scenario) -> None:
        self.revised: list[ConfirmedTrack] = []
        self.count = 0

    def process(self, scan):
        self.count += 1
        self.revised = [self.track(revision=1)] if self.count == 7 else []
        return [self.track()] if self.count in (2, 5) else []

    def track(self, revision: int = 0) -> ConfirmedTrack:
        state = np.array([5000.0, 5.0, 5000.0, 0.0])
        hits = ((self.count - 1, 0),) if revision else ((0, 0),)
        stamp = 12.0 * (self.count - 1)
        return ConfirmedTrack(0, stamp, state, 1e4 * np.eye(4), hits, 0.0, revision=revision)


def test_only_revision_0_counts_and_what_was_before_the_targets_does_not():
    changes = {"sensor.detection_probability": 1.0, "scans": 4, "warm_up": 3}
    made = simulate_run(
        load_scenario("box", {**changes, "sensor.clutter_density": 1e-6}),
        [3, 1],
        SimulatedOperatingPoint("corrector", options={}, factory=lambda one, *_: Corrector(one)),
    )
    # The correction's hit is the target's.
    made.origins[6][0] = 0
    kept = summarise_measures(made)
    assert [scan.false for scan in kept.scans] == [0, 1, 0, 0]
    assert [scan.at for scan in kept.scans] == [0, 1, 1, 1]
    assert [scan.corrections for scan in kept.scans] == [0, 0, 0, 1]
    assert [scan.right for scan in kept.scans] == [0, 0, 0, 1]
    assert kept.starts == ()
    measures = measures_of(made.scenario, [kept])
    assert (measures.found.value, measures.found_by_position.value) == (0.0, 1.0)
    assert (measures.found_corrected.value, measures.corrections_per_run.value) == (1.0, 1.0)
    assert measures_of(made.scenario, [kept], 1).found_by_position.value == 0.0


def test_the_closest_approach_is_where_a_fine_grid_of_times_has_it():
    relative = np.array([[100.0, -3.0, 40.0, 1.0], [50.0, 2.0, 20.0, 0.5], [5.0, 0.0, 6.0, 0.0]])
    time, distance = measured_closest_approach(relative)
    times = np.linspace(-60.0, 60.0, 120_001)
    for row in range(2):
        apart = np.hypot(
            relative[row, 0] + times * relative[row, 1], relative[row, 2] + times * relative[row, 3]
        )
        assert times[apart.argmin()] == pytest.approx(time[row], abs=1e-3)
        assert apart.min() == pytest.approx(distance[row], abs=1e-5)
    assert (time[2], distance[2]) == (0.0, np.hypot(5.0, 6.0))
