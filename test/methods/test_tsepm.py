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
"""The published method equals its plain-loop version, track for track."""

import math
from pathlib import Path

import numpy as np
import pytest
from support.batches import batches
from support.builders import AS_GIVEN
from support.plain_tsepm import plain_tsepm_with_counts
from support.scenes import Scene, random_scene

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.commands.given_parameters import given_parameters_for
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tracker.tracker import Tracker

PAPER = Path(__file__).parents[2] / "config" / "paper.yaml"
SCENES = 300
BATCH = 15
ALWAYS = 15
"""Scenes without the marker; a fault of the method shows in nearly every scene."""
TOLERANCE = 1e-9


def run_plain(scene: Scene):
    options = dict(scene.options)
    options["reading"] = options.pop("pruning_reading")
    return plain_tsepm_with_counts(scene.scans, **scene.sensor, **options)


def compare(scene: Scene) -> int:
    """Compare one scene; returns the number of tracks compared."""
    expected, counts = run_plain(scene)
    initiator = make_initiator(
        "tsepm", sensor=SensorModel(**scene.sensor), limit_speed="off", **AS_GIVEN, **scene.options
    )
    return compare_scans(initiator, scene.as_scans(), expected, counts)


def compare_scans(initiator: Tracker, scans, expected, counts) -> int:
    """Compare the tracks and counts of each scan; returns the number of tracks compared."""
    compared = 0
    for scan, tracks, count in zip(scans, expected, counts, strict=True):
        found = {track.hits: track for track in initiator.process(scan)}
        statistics = initiator.statistics
        assert statistics.potential_tracks == count.potential
        assert statistics.raw_confirmations == count.confirmed
        assert statistics.raw_confirmations - statistics.pruned == count.retained
        assert set(found) == {track.hits for track in tracks}
        for track in tracks:
            same = found[track.hits]
            assert same.stamp == track.stamp
            np.testing.assert_allclose(
                same.state, track.state, rtol=0, atol=TOLERANCE * np.linalg.norm(track.state)
            )
            np.testing.assert_allclose(
                same.covariance,
                track.covariance,
                rtol=0,
                atol=TOLERANCE * np.linalg.norm(track.covariance),
            )
            assert same.evaluation == pytest.approx(track.evaluation, rel=1e-7, abs=1e-9)
        compared += len(tracks)
    return compared


@pytest.mark.parametrize("first", batches(SCENES, ALWAYS, BATCH))
def test_equals_the_plain_version(first: int) -> None:
    compared = sum(compare(random_scene(seed)) for seed in range(first, first + BATCH))
    assert compared > 0, "the scenes must confirm tracks, or nothing was compared"


def test_the_parameter_file_of_the_paper_runs_the_method_as_the_paper_has_it():
    values = given_parameters_for(PAPER, "/track_initiator")
    initiator = settings_from(make_groups(TRACK_INITIATOR, values)).make_tracker()
    scenario = load_scenario("box", {"scans": 10, "sensor.clutter_density": 5e-7})
    scans = [one.scan for one in Simulator(scenario, 1)]
    columns = ("range", "azimuth", "time_offset")
    plain = []
    for scan in scans:
        near = scan.range <= initiator.sensor.model.max_range
        values = {name: getattr(scan, name) for name in columns}
        given = {name: value[near] for name, value in values.items() if value is not None}
        plain.append({"stamp": scan.stamp, **given})
    expected, counts = plain_tsepm_with_counts(
        plain,
        range_std=0.0,
        range_std_fraction=0.015,
        azimuth_std=math.radians(1.0),
        clutter_density=1e-6,
        max_speed=10.0,
        min_hits=5,
        window=8,
    )
    assert compare_scans(initiator, [Scan(**one) for one in plain], expected, counts) > 1
