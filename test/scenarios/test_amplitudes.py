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
"""Strengths of echoes in whole scenes: what they do to the starts."""

import dataclasses
import math

import numpy as np
import pytest
from support.builders import assert_same_tracks

from tsepm_ros import make_initiator
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tools.simulation.scenario import ClutterStrength, TargetStrength

BOX = load_scenario("box")


def scans_of(ratio_db: float | None, scans: int = 24, seed: int = 1, appears: int = 16):
    """The box after pings of clutter alone; its target's echoes are that much stronger."""
    scene = dataclasses.replace(BOX, scans=scans)
    if ratio_db is not None:
        scene = dataclasses.replace(
            scene,
            clutter_strength=ClutterStrength(),
            target_strengths=(TargetStrength(ratio_db, "steady"),),
        )
    found = []
    for index, simulated in enumerate(Simulator(scene, seed)):
        scan, kept = simulated.scan, (simulated.origin < 0) | (index >= appears)
        features = {name: values[kept] for name, values in scan.features.items()}
        found.append(
            dataclasses.replace(
                scan, range=scan.range[kept], azimuth=scan.azimuth[kept], features=features
            )
        )
    return found


def with_amplitude(scans, strength_of):
    return [
        dataclasses.replace(scan, features={"intensity": strength_of(scan)} if strength_of else {})
        for scan in scans
    ]


def started(scans, **options):
    initiator = make_initiator("score", sensor=BOX.sensor, **options)
    return [track for scan in scans for track in initiator.process(scan)], initiator


def test_strong_echoes_start_a_track_sooner_and_their_ratio_is_published():
    first = {}
    for ratio in (None, 10.0):
        found = [started(scans_of(ratio, seed=seed))[0] for seed in range(4)]
        first[ratio] = [tracks[-1].scan_count if tracks else 99 for tracks in found]
    assert np.median(first[10.0]) < np.median(first[None])
    tracks, initiator = started(scans_of(10.0))
    assert tracks[-1].signal_to_clutter_db == pytest.approx(10.0, abs=5.0)
    assert initiator.current[-1].signal_to_clutter_db == pytest.approx(10.0, abs=5.0)
    assert "above the clutter" in initiator.reason(tracks[-1])
    assert "compared with" in initiator.sensor.intensity


@pytest.mark.parametrize("value", [3.0, np.nan, 0.0], ids=["constant", "nan", "zero"])
def test_amplitudes_that_say_nothing_change_nothing(value):
    scans = scans_of(None)
    without, _ = started(scans)
    found, _ = started(with_amplitude(scans, lambda scan: np.full(len(scan), value)))
    assert_same_tracks(without, found)


def test_without_amplitudes_or_with_intensity_off_everything_is_as_before_to_the_bit():
    scans = scans_of(10.0)
    without, _ = started(with_amplitude(scans, None))
    off, initiator = started(scans, intensity="off")
    assert_same_tracks(without, off)
    assert initiator.sensor.intensity == "not used: off"
    assert all(math.isnan(track.signal_to_clutter_db) for track in off)


@pytest.mark.long
def test_a_single_strong_echo_starts_no_track_with_clutter_before_it():
    """Its target may have just appeared: the start waits until its hits are clear."""
    false = 0
    for seed in range(6):
        scans = scans_of(20.0, scans=17, seed=seed)
        tracks, _ = started(scans, false_tracks_per_hour=10.0)
        false += sum(track.stamp == scans[-1].stamp for track in tracks)
    assert false == 0
