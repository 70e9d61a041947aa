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
"""Errors and detection probability of the sensor, learned from confirmed tracks."""

import math
from typing import Any

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.clutter.sensor_performance import (
    DATA_SHEET_SCANS,
    DetectionProbability,
    FittedErrors,
    InnovationSamples,
)
from tsepm_ros.tracker.measurement import convert_measurements

CONFIRMED = np.array([7, 9, 11]), np.array([True, True, False])


def innovations(
    true: SensorModel,
    given: SensorModel,
    pings: int = 200,
    wild: float = 0.0,
    at_the_sensor: bool = False,
) -> InnovationSamples:
    """Innovations of two targets of constant velocity, of which some detections are wild.

    Also given, if asked for: a third, whose detections are at the sensor.
    """
    rng = np.random.default_rng(5)
    errors = InnovationSamples()
    confirmed = np.array([7, 9])
    start = np.array([[150.0, 20.0], [480.0, -200.0]])
    velocity = np.array([[0.5, 0.6], [-0.4, 0.3]])
    for ping in range(pings):
        place = start + ping * velocity
        range_, azimuth = np.hypot(*place.T), np.arctan2(place[:, 1], place[:, 0])
        range_ = range_ + np.sqrt(true.range_variance(range_)) * rng.standard_normal(2)
        azimuth = azimuth + true.azimuth_std * rng.standard_normal(2)
        range_ = range_ + 30.0 * (rng.random(2) < wild)
        detections = convert_measurements(Scan(float(ping), range_, azimuth), given, ping)
        seen = rng.random(2) < 0.9
        variance = given.range_variance(range_)
        errors.update(confirmed[seen], detections[seen], variance[seen], *CONFIRMED)
        if at_the_sensor:
            third = convert_measurements(Scan(float(ping), [1.0], [0.0]), given, ping)
            third["position"] = 0.0  # a cluster, joined of echoes around the sensor
            errors.update(np.array([11]), third, np.ones(1), *CONFIRMED)
    return errors


def fitted(true: SensorModel, given: SensorModel, **more: Any) -> FittedErrors | None:
    """The errors fitted to these innovations."""
    return innovations(true, given, **more).fitted


def model(range_std: float, fraction: float, azimuth_std: float) -> SensorModel:
    return SensorModel(
        range_std=range_std, range_std_fraction=fraction, azimuth_std=azimuth_std, max_range=600.0
    )


@pytest.mark.parametrize("wild", [0.0, 0.01])
def test_the_true_errors_are_found_whatever_is_assumed(wild):
    found = fitted(model(0.5, 0.0, 0.02), model(0.0, 0.015, 0.01), wild=wild)
    assert found is not None
    assert found.range_std == pytest.approx(0.5, rel=0.25)
    assert found.range_std_fraction == 0.0
    assert found.azimuth_std == pytest.approx(0.02, rel=0.25)
    assert found.azimuth_factor == pytest.approx(2.0, rel=0.25)
    assert found.range_factor < 0.25


def test_an_error_that_grows_with_range_is_told_from_a_constant():
    found = fitted(model(0.0, 0.01, 0.02), model(0.5, 0.0, 0.02), pings=400)
    assert found is not None
    assert found.range_std == 0.0
    assert found.range_std_fraction == pytest.approx(0.01, rel=0.25)
    assert found.azimuth_factor == pytest.approx(1.0, rel=0.2)


def test_each_track_has_its_own_detections_however_the_confirmed_ones_change():
    # A loop over the tracks, each alone, against tracks that begin, end and change places.
    rng, given = np.random.default_rng(6), model(0.5, 0.0, 0.02)
    together, alone = (
        InnovationSamples(),
        {track: InnovationSamples() for track in range(9)},
    )
    for ping in range(120):
        confirmed = rng.permutation([track for track in range(9) if ping // 10 != track])
        seen = np.sort(confirmed[rng.random(len(confirmed)) < 0.8])
        place = 100.0 * np.exp(1j * seen) + ping * (1.0 + seen) + rng.standard_normal(len(seen))
        detections = convert_measurements(
            Scan(float(ping), np.abs(place), np.angle(place)), given, ping
        )
        variance = given.range_variance(np.abs(place))
        moves = confirmed % 2 > 0
        together.update(seen, detections, variance, confirmed, moves)
        for track, errors in alone.items():
            own = seen == track
            of = confirmed == track
            errors.update(seen[own], detections[own], variance[own], confirmed[of], moves[of])
    assert together.samples.shape[1] > 300
    parts = np.concatenate([one.samples for one in alone.values()], axis=1)
    assert sorted(together.samples.T.tolist()) == sorted(parts.T.tolist())


def test_detections_at_the_sensor_have_no_direction_and_do_not_count():
    sensors = model(0.5, 0.0, 0.02), model(0.5, 0.0, 0.02)
    assert fitted(*sensors, at_the_sensor=True) == fitted(*sensors)


def test_nothing_is_said_on_few_innovations():
    assert fitted(model(0.5, 0.0, 0.02), model(0.5, 0.0, 0.02), pings=20) is None


def test_errors_in_use_follow_the_innovations_one_factor_alone_and_few_change_none():
    sensors, before = (model(2.0, 0.0, 0.02), model(0.5, 0.0, 0.02)), np.array([3, 0])
    # Four times the stated error are 8 steps; the stated one counts as some samples.
    range_steps, azimuth_steps = innovations(*sensors).followed(before).tolist()
    assert 6 <= range_steps <= 8 and azimuth_steps == 0
    few = innovations(*sensors, pings=4)
    assert few.samples.size and few.followed(before).tolist() == [0, 0]
    smaller = innovations(model(0.25, 0.0, 0.02), sensors[1])
    assert -4 <= smaller.followed(before).tolist()[0] <= -2


def test_three_detections_in_a_row_by_a_plain_formula():
    # On a line straight ahead; the middle one of 1, 2 and 4 s is 3 m too far and 0.01 rad aside.
    sensor = model(1.0, 0.0, 1e-6)
    errors = InnovationSamples()
    confirmed = np.array([1])
    for number in range(60):
        for ping, (time, far, turn) in enumerate(
            [(1.0, 101.0, 0.0), (2.0, 105.0, 0.01), (4.0, 104.0, 0.0)]
        ):
            scan = Scan(10.0 * number + time, [far], [turn])
            variance = np.ones(1)
            errors.update(
                confirmed,
                convert_measurements(scan, sensor, ping),
                variance,
                confirmed,
                confirmed > 0,
            )
        errors.update(
            confirmed[:0],
            convert_measurements(scan, sensor, ping)[:0],
            variance[:0],
            confirmed[:0],
            confirmed[:0] > 0,
        )
    found = errors.fitted
    assert found is not None
    # e = 3 over sqrt(1 + (2/3)^2 + (1/3)^2); the median of squares over that of chi-square.
    factor = 1.0 / math.sqrt(1.0 + 4.0 / 9.0 + 1.0 / 9.0)
    assert found.range_std == pytest.approx(3.0 * factor / math.sqrt(0.4549), rel=5e-3)
    assert found.azimuth_std == pytest.approx(0.01 * factor / math.sqrt(0.4549), rel=0.05)


@pytest.mark.parametrize(
    ("speed", "true", "azimuth_std"), [(0.0, 0.1, 0.05), (15.0, 0.1, 0.05), (15.0, 0.4, 0.01)]
)
def test_azimuth_errors_of_a_sonar_that_passes_its_targets_are_no_range_errors(
    speed, true, azimuth_std
):
    rng, errors, given = np.random.default_rng(8), InnovationSamples(), model(0.1, 0.0, azimuth_std)
    targets = rng.uniform([-30.0, 30.0], [3000.0, 60.0], (160, 2))
    for ping in range(160):
        pose = np.array([speed * ping, 0.0, 0.2 * ping])
        x, y = (targets - pose[:2]).T
        near = np.flatnonzero(np.hypot(x, y) < 90.0)
        azimuth = np.arctan2(y, x)[near] - pose[2] + azimuth_std * rng.standard_normal(len(near))
        range_ = np.hypot(x, y)[near] + true * rng.standard_normal(len(near))
        found = convert_measurements(
            Scan(float(ping), range_, azimuth, sensor_pose=pose), given, ping
        )
        every = np.arange(len(targets))
        errors.update(near, found, np.full(len(near), 0.1**2), every, np.ones(len(every), bool))
    assert errors.fitted is not None
    assert errors.fitted.range_factor == pytest.approx(true / 0.1, rel=0.25)
    assert errors.fitted.azimuth_factor == pytest.approx(1.0, rel=0.2)


def walked(
    given: SensorModel, cell: float = 0.0, turns: bool = False, moves: bool = True
) -> FittedErrors:
    """Errors fitted to a target whose ranges are rounded to cells, or that turns now and then."""
    rng, errors, place, course = (
        np.random.default_rng(7),
        InnovationSamples(),
        300.0 + 0j,
        0.3,
    )
    confirmed = np.array([4])
    for ping in range(600):
        course += 1.5 * (turns and ping % 12 == 0)
        place += (20.0 if turns else 0.02) * np.exp(1j * course)
        range_ = abs(place) + given.range_std * rng.standard_normal() * (cell == 0.0)
        range_ = round(range_ / cell) * cell if cell else range_
        azimuth = np.angle(place) + given.azimuth_std * rng.standard_normal()
        found = convert_measurements(Scan(float(ping), [range_], [azimuth]), given, ping)
        errors.update(
            confirmed, found, np.full(1, given.range_std**2), confirmed, np.array([moves])
        )
    assert errors.fitted is not None
    return errors.fitted


def test_ranges_rounded_to_cells_are_not_taken_for_exact_ones():
    # A slow target stays in a cell for 25 pings: nearly all innovations are 0.
    found = walked(model(0.2, 0.0, 1e-3), cell=0.5)
    assert 0.5 <= found.range_factor <= 1.0
    assert found.range_std == pytest.approx(0.2 * found.range_factor)
    assert walked(model(0.2, 0.0, 1e-3), cell=0.5, moves=False).range_factor < 0.01, "by the median"


def test_a_target_that_turns_does_not_make_errors_larger():
    still, turning = (walked(model(1.0, 0.0, 0.01), turns=turns) for turns in (False, True))
    assert turning.range_factor == pytest.approx(still.range_factor, rel=0.25)


def test_the_data_sheet_counts_until_tracks_tell_otherwise():
    known = DetectionProbability()
    assert known.estimate(0.6) == pytest.approx(0.6)
    # Two tracks: detected in the first scan after two; in the second one, certainly not.
    known.update(np.array([1.0, 0.0]), np.array([3.0, 5.0]), 0.99)
    expected = (0.6 * DATA_SHEET_SCANS + 1.0 / 0.99) / (DATA_SHEET_SCANS + 3.0)
    # The prior does not fade, and what was known before was nothing.
    assert known.estimate(0.6) == pytest.approx(expected)
    known.update(np.array([0.5]), np.array([4.0]), 0.99)
    kept = math.exp(-2.0 / 200.0)
    detected, covered = kept * 1.0 / 0.99 + 0.5 / 0.99, kept * 3.0 + 2.0
    expected = (0.6 * DATA_SHEET_SCANS + detected) / (DATA_SHEET_SCANS + covered)
    assert known.estimate(0.6) == pytest.approx(expected)


def test_a_miss_and_a_detection_stay_possible():
    known = DetectionProbability()
    for _ in range(500):
        known.update(np.ones(4), np.ones(4), 0.9)
    assert known.estimate(1.0) == 0.999
    for _ in range(500):
        known.update(np.ones(1), np.array([1000.0]), 0.9)
    assert known.estimate(0.9) == 0.05
