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
"""Range rates: against general solvers, the Cramer-Rao bound, and what clutter makes of them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from tsepm_ros import Scan, SensorModel
from tsepm_ros.numerics import gaussian
from tsepm_ros.tools.evaluation.measures import cramer_rao_measure
from tsepm_ros.tracker import motion, range_rates
from tsepm_ros.tracker.initial_state import ESTIMATORS, fit_states
from tsepm_ros.tracker.measurement import DETECTION, convert_measurements, covariance_at

SENSOR = SensorModel(
    range_std=10.0, range_std_fraction=0.0, azimuth_std=math.radians(1.0), range_rate_std=0.25
)

SHIP = np.array([5.0, -3.0])

TIMES = 10.0 * np.arange(5)

NOW = TIMES[-1]

TRUTH = np.array([4700.0, 3.0, 2200.0, 4.0])  # at NOW

RUNS = 10_000


def truth_at(time: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of the target."""
    return TRUTH[0::2] + (time - NOW) * TRUTH[1::2], TRUTH[1::2]


def moving_hits(sensor: SensorModel, runs: int, seed: int = 1) -> np.ndarray:
    """Hits (runs, 5) from a moving sensor, with range rates."""
    rng = np.random.default_rng(seed)
    hits = np.zeros((runs, len(TIMES)), DETECTION)
    for k, time in enumerate(TIMES):
        position, velocity = truth_at(time)
        offset = position - SHIP * time
        rate = (velocity - SHIP) @ offset / np.hypot(*offset)
        scan = Scan(
            time,
            np.hypot(*offset) + sensor.range_std * rng.standard_normal(runs),
            math.atan2(offset[1], offset[0]) + sensor.azimuth_std * rng.standard_normal(runs),
            features={"range_rate": rate + sensor.range_rate_std * rng.standard_normal(runs)},
            sensor_pose=(*SHIP * time, 0.0),
            sensor_velocity=SHIP,
        )
        hits[:, k] = convert_measurements(scan, sensor, k)
    return hits


def bound(sensor: SensorModel) -> np.ndarray:
    positions = np.array([truth_at(time)[0] for time in TIMES])
    sensors = SHIP * TIMES[:, None]
    moving = np.tile(TRUTH[1::2] - SHIP, (len(TIMES), 1))
    return cramer_rao_measure(positions, TIMES, sensors, sensor, NOW, moving)


def along_sight() -> np.ndarray:
    offset = TRUTH[0::2] - SHIP * NOW
    return offset / np.hypot(*offset)


@pytest.mark.parametrize("missing", [(), (1, 3)], ids=["all", "some"])
def test_a_fit_is_the_joint_least_squares_solution(missing):
    # With errors small enough that nothing is curved; R as the fit used it.
    sensor = replace(SENSOR, range_std=1.0, azimuth_std=1e-4, range_rate_std=0.02)
    hits = moving_hits(sensor, 20)
    hits["range_rate_std"][:, list(missing)] = 0.0
    fitted = fit_states(hits, NOW, sensor, "weighted")
    for i in range(20):
        whitening = [np.linalg.inv(np.linalg.cholesky(r)) for r in fitted.hit_covariance[i]]

        def misfit(state: np.ndarray, i: int = i, whitening: list = whitening) -> np.ndarray:
            parts = []
            for k, time in enumerate(TIMES):
                hit = hits[i, k]
                position = state[0::2] + (time - NOW) * state[1::2]
                parts.append(whitening[k] @ (hit["position"] - position))
                if k not in missing:
                    offset = position - SHIP * time
                    rate = (state[1::2] - SHIP) @ offset / np.hypot(*offset)
                    parts.append([(hit["range_rate"] - rate) / 0.02])
            return np.concatenate(parts)

        best = least_squares(misfit, TRUTH, x_scale=[10, 1, 10, 1], xtol=1e-14, ftol=1e-14)
        spread = np.linalg.inv(best.jac.T @ best.jac)
        sigma = np.sqrt(np.diag(spread))
        np.testing.assert_allclose(fitted.state[i], best.x, rtol=0, atol=0.01 * sigma.min())
        scale = np.outer(sigma, sigma)
        np.testing.assert_allclose(fitted.covariance[i] / scale, spread / scale, atol=0.01)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_a_fit_reaches_the_bound_along_the_line_of_sight_and_says_so(estimator):
    # RMS of 10 000 runs: standard error 0.7 %. What is left above the bound is curvature, 3 %.
    # Positions alone are at 2.4 times it.
    fitted = fit_states(moving_hits(SENSOR, RUNS), NOW, SENSOR, estimator)
    error = fitted.state - TRUTH
    sight = along_sight()
    along = error[:, 1::2] @ sight
    least = math.sqrt(sight @ bound(SENSOR)[1::2, 1::2] @ sight)
    assert 0.98 < math.sqrt(np.square(along).mean()) / least < 1.05
    assert abs(along.mean()) < 0.1 * least, "a moving sensor must not bias it"
    blind = replace(SENSOR, range_rate_std=0.0)
    without = math.sqrt(sight @ bound(blind)[1::2, 1::2] @ sight)
    assert without > 2.3 * least
    # NEES has mean 4 and a standard error of 0.03; positions alone have 4.03 here.
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(fitted.covariance), error)
    assert nees.mean() == pytest.approx(4.0, abs=0.2)


@pytest.mark.parametrize("probability", [0.9, 0.99])
def test_the_gate_holds_a_target_s_detection_with_its_probability(probability):
    # 40 000 draws: a standard error of 0.0015 at 0.9; linear up to 0.2 % of the pairs.
    n, rng = 40_000, np.random.default_rng(7)
    mean = np.array([6000.0, 2.0, 0.0, -3.0])
    prior = np.diag([60.0, 2.0, 80.0, 2.0]) ** 2
    truth = rng.multivariate_normal(mean, prior, n)
    found = np.zeros(n, DETECTION)
    found["azimuth_std"], found["range_std"] = SENSOR.azimuth_std, SENSOR.range_std
    found["sensor_velocity"], found["range_rate_std"] = SHIP, SENSOR.range_rate_std
    rate, *_ = range_rates.expected(found, truth[:, 0::2], truth[:, 1::2])
    found["range_rate"] = rate + SENSOR.range_rate_std * rng.standard_normal(n)
    error = covariance_at(found[:1], mean[None, 0::2], SENSOR)[0]
    found["position"] = truth[:, 0::2] + rng.multivariate_normal((0, 0), error, n)
    state, covariance = np.tile(mean, (n, 1)), np.tile(prior, (n, 1, 1))
    inside = np.isfinite(
        motion.log_likelihood(
            state,
            covariance,
            np.arange(n),
            0.0,
            found["position"] - mean[0::2],
            np.tile(prior[0::2, 0::2] + error, (n, 1, 1)),
            found,
            np.arange(n),
            probability,
        )
    )
    deviation = math.sqrt(probability * (1 - probability) / n)
    assert inside.mean() == pytest.approx(probability, abs=3 * deviation + 0.001)


def test_the_pair_gate_holds_a_target_s_hits_and_hardly_any_other_s():
    hits = moving_hits(SENSOR, RUNS)
    gate = gaussian.gate_factor(0.9) ** 2
    for later in (1, 4):
        agree = range_rates.agree(hits[:, 0], hits[:, later], 10.0, gate)
        # It allows for a velocity across that is unknown up to v_max: never too narrow.
        assert 0.89 < agree.mean() < 0.97
        other = hits[:, later].copy()
        other["range_rate"] += 5.0
        assert range_rates.agree(hits[:, 0], other, 10.0, gate).mean() < 0.01
        unknown = hits[:, later].copy()
        unknown["range_rate_std"] = 0.0
        assert range_rates.agree(hits[:, 0], unknown, 10.0, gate).all()


def test_the_clutter_s_density_is_one_and_half_of_it_within_its_parameter():
    found = np.zeros(400_001, DETECTION)
    found["position"], found["range_rate_std"] = (1000.0, 0.0), 0.2
    found["sensor_velocity"] = (4.0, 0.0)
    found["range_rate"] = np.linspace(-1000.0, 1000.0, len(found)) - 4.0
    density = range_rates.clutter_density(found, replace(SENSOR, clutter_range_rate=2.0))
    step = 2000.0 / (len(found) - 1)
    assert density.sum() * step == pytest.approx(1.0, abs=0.002)  # the tails hold 0.0013
    over_ground = found["range_rate"] + 4.0
    assert density[np.abs(over_ground) <= 2.0].sum() * step == pytest.approx(0.5, abs=1e-3)


def rated_detections(number: int, seed: int) -> np.ndarray:
    """Detections anywhere about moving sensors."""
    rng = np.random.default_rng(seed)
    found = np.zeros(number, DETECTION)
    found["sensor_pose"][:, :2] = rng.uniform(-500.0, 500.0, (number, 2))
    found["sensor_velocity"] = rng.uniform(-6.0, 6.0, (number, 2))
    found["position"] = rng.uniform(-3000.0, 3000.0, (number, 2))
    found["range_rate"] = rng.uniform(-8.0, 8.0, number)
    found["range_rate_std"], found["azimuth_std"] = 0.3, 0.02
    found["covariance"] = [[400.0, 30.0], [30.0, 900.0]]
    found["time"] = rng.uniform(10.0, 20.0, number)
    return found


def range_rate(state: np.ndarray, elapsed: float, found: np.void) -> float:
    """c of a target with a state some time before."""
    offset = state[0::2] + elapsed * state[1::2] - found["sensor_pose"][:2]
    return (state[1::2] - found["sensor_velocity"]) @ offset / np.hypot(*offset)


def test_an_update_is_that_by_numerical_gradients_and_the_curvature_across_the_sight():
    found, rng = rated_detections(6, 3), np.random.default_rng(4)
    state = np.zeros((6, 4))
    state[:, 0::2] = found["position"] + rng.normal(0.0, 50.0, (6, 2))
    state[:, 1::2] = rng.uniform(-5.0, 5.0, (6, 2))
    root, elapsed = rng.normal(size=(6, 4, 7)) * [[30.0], [2.0], [30.0], [2.0]], np.arange(6.0)
    prior = root @ np.swapaxes(root, 1, 2)
    found["range_rate_std"][5] = 0.0
    updated, after = range_rates.update(state, prior, elapsed, found)
    begun, begun_after, increment = range_rates.begun(state, prior, found, SENSOR)
    clutter = range_rates.clutter_density(found, SENSOR)
    for i in range(5):
        for time, got, covariance in ((elapsed[i], updated, after), (0.0, begun, begun_after)):
            step = np.diag([1e-2, 1e-4, 1e-2, 1e-4])
            gradient = [
                (
                    range_rate(state[i] + s, time, found[i])
                    - range_rate(state[i] - s, time, found[i])
                )
                / (2.0 * s.max())
                for s in step
            ]
            offset = state[i, 0::2] + time * state[i, 1::2] - found["sensor_pose"][i, :2]
            distance = np.hypot(*offset)
            x, y = np.array([-offset[1], offset[0]]) / distance
            at = np.array([x, time * x, y, time * y])
            turn = np.array([0.0, x, 0.0, y])
            mixed, k = at @ prior[i] @ turn / distance, prior[i] @ gradient
            curved = (at @ prior[i] @ at) * (turn @ prior[i] @ turn) / distance**2 + mixed**2
            variance = gradient @ k + 0.3**2 + curved
            error = found["range_rate"][i] - range_rate(state[i], time, found[i]) - mixed
            np.testing.assert_allclose(got[i], state[i] + k * error / variance, rtol=1e-6)
            expected = prior[i] - np.outer(k, k) / variance
            np.testing.assert_allclose(covariance[i], expected, rtol=1e-5, atol=1e-5)
        density = math.exp(-0.5 * error**2 / variance) / math.sqrt(2.0 * math.pi * variance)
        assert increment[i] == pytest.approx(math.log(density / clutter[i]), abs=1e-5)
    np.testing.assert_array_equal(updated[5], state[5])
    assert clutter[5] == 1.0 and increment[5] == 0.0


def test_pairs_agree_up_to_the_squared_distance_of_a_plain_formula():
    first, second = rated_detections(40, 5), rated_detections(40, 6)
    second["position"] = first["position"] + np.random.default_rng(7).normal(0.0, 60.0, (40, 2))
    second["time"] += 12.0
    for i in range(40):
        a, b = first[i], second[i]
        rates, sights, variance = [], [], 0.0
        for one in (a, b):
            sight = one["position"] - one["sensor_pose"][:2]
            sights.append(sight / np.hypot(*sight))
            rates.append(one["range_rate"] + sights[-1] @ one["sensor_velocity"])
            variance += 0.3**2 + 0.02**2 * (one["sensor_velocity"] @ one["sensor_velocity"])
        variance += 10.0**2 / 4.0 * np.sum((sights[1] - sights[0]) ** 2)
        middle = (sights[0] + sights[1]) / np.hypot(*(sights[0] + sights[1]))
        elapsed = b["time"] - a["time"]
        way = middle @ (b["position"] - a["position"]) - elapsed * sum(rates) / 2.0
        spread = elapsed**2 * variance / 4.0 + middle @ (a["covariance"] + b["covariance"]) @ middle
        distance = (rates[1] - rates[0]) ** 2 / variance + way**2 / spread
        for gate, agrees in ((distance * (1.0 + 1e-9), True), (distance * (1.0 - 1e-9), False)):
            pair = first[i : i + 1], second[i : i + 1]
            assert range_rates.agree(*pair, 10.0, gate).tolist() == [agrees]
