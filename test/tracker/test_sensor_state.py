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
"""What belongs to a sensor: what it measures, what is learned of it, and what is in use."""

import dataclasses

import numpy as np
from support.builders import FIXED_RANGE_ERROR, scan_at

from tsepm_ros import Scan, make_initiator

HERE = (3000.0, 0.0)


def taken(made, scans):
    for index, positions in enumerate(scans):
        made.process(scan_at(12.0 * index, positions))


def test_what_is_estimated_is_in_use_where_it_is_not_given():
    made = make_initiator("score", sensor=FIXED_RANGE_ERROR)
    taken(made, [[(3000.0 + 50.0 * k, 0.0)] if k % 4 else [] for k in range(1, 40)])
    estimate = made.sensor.estimated_detection_probability
    assert made.sensor.detection_probability == estimate < 0.9
    assert made.sensor.covered_area == made.sensor.learned.clutter_map.seen.area
    given = make_initiator(
        "score",
        sensor=FIXED_RANGE_ERROR,
        detection_probability="given",
        clutter_density="given",
        intensity="off",
    )
    taken(given, [[HERE]] * 3)
    assert given.sensor.detection_probability == 0.9
    assert given.sensor.clutter_density == 1e-6
    assert given.sensor.covered_area == FIXED_RANGE_ERROR.coverage_area
    assert given.sensor.intensity == "not used: off"
    at = np.array([[3000.0, 0.0], [2e4, 0.0]])
    assert given.sensor.detection_probability_at(at).tolist() == [0.9, 0.0]


def test_a_sensor_that_no_other_watches_forgets_the_tracks_that_it_saw_long_ago():
    made = make_initiator("score", sensor={"only": FIXED_RANGE_ERROR})
    for index in range(8):
        made.process(dataclasses.replace(scan_at(12.0 * index, [HERE]), sensor="only"))
        made.sensor.seen |= {99: 0.0} if index < 2 else {}
    assert 99 not in made.sensor.seen


def test_after_a_sensor_of_a_single_scan_the_hits_of_the_others_are_forgotten_as_ever():
    made = make_initiator("score", sensor={"once": FIXED_RANGE_ERROR, "on": FIXED_RANGE_ERROR})
    for index in range(200):
        scan = scan_at(2.0 * index, [HERE])
        made.process(dataclasses.replace(scan, sensor="on" if index else "once"))
    assert len(made.window) <= made.options.window + 1
    again = dataclasses.replace(scan_at(400.0, [HERE]), sensor="once")
    assert len(made.process(again)) == 0 and made.sensor is made.sensors["once"]


def test_another_model_keeps_what_was_learned_and_still_holds():
    made = make_initiator("score", sensor=FIXED_RANGE_ERROR)
    taken(made, [[HERE]] * 3)
    before = made.sensor
    errors = dataclasses.replace(before.model, azimuth_std=0.5 * before.model.azimuth_std)
    after = before.under(errors, made.method)
    assert after.model is errors and after.sensor_in_use == errors
    assert after.learned.clutter_map is before.learned.clutter_map
    assert after.learned.errors is not before.learned.errors
    assert after.scans == before.scans == 3 and before.model is FIXED_RANGE_ERROR


def test_the_errors_that_tracks_show_stay_in_use_under_options_that_do_not_concern_them():
    rng, made = np.random.default_rng(2), make_initiator("score", sensor=FIXED_RANGE_ERROR)
    places = np.array([[3000.0, 0.0], [-2000.0, 1500.0], [0.0, -4000.0], [-1000.0, -1000.0]])
    taken(made, places + rng.normal(0.0, 90.0, (40, *places.shape)))
    in_use = made.sensor.sensor_in_use
    assert in_use.range_std > made.sensor.model.range_std
    for options, kept in (({}, True), ({"sensor_errors": "given"}, False)):
        other = make_initiator("score", sensor=FIXED_RANGE_ERROR, hold_time=500.0, **options)
        made, _ = made.with_settings(other.method)
        assert made.sensor.sensor_in_use == (in_use if kept else FIXED_RANGE_ERROR)


def test_the_interval_of_a_sensor_is_that_of_its_own_scans():
    made = make_initiator("score", sensor=FIXED_RANGE_ERROR)
    state = made.sensor
    for index, stamp in enumerate([100.0, 112.0, 124.0]):
        scan = Scan(stamp, *(np.zeros(0) for _ in range(2)))
        assert len(state.measure(scan, 7 * index, None)) == 0
    assert (state.scans, state.interval) == (3, 12.0)
    assert state.reach == 12.0 * made.common.max_speed
