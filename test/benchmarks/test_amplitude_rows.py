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
"""Benchmarks of amplitudes and of the detector: how they compare and count."""

import amplitude
import amplitude_scenes as scenes
import detector
import numpy as np
import pytest

from tsepm_ros.tools.evaluation.intervals import IntervalEstimate
from tsepm_ros.tools.simulation.images import ImageModel, ImageSimulator


def drawn(rng, share: float, wrong: float, runs: int = 4000) -> np.ndarray:
    """Runs as of `amplitude.counted`: the same luck of a run for all."""
    luck = rng.random((2, runs))
    return np.array([luck[0] < share, wrong * np.round(-np.log(luck[1]))])


def test_gain_is_judged_at_the_same_false_rate_and_the_verdict_by_bounds():
    """P_DT rises by 0.1 for e times the false rate: more of both by that line gains nothing."""
    plain = np.array([drawn(np.random.default_rng(1), 0.6 + 0.1 * k, np.e**k) for k in (-1, 0, 1)])
    for k, better in ((0.0, 0.0), (0.5, 0.0), (-0.5, 0.05)):
        found = drawn(np.random.default_rng(1), 0.6 + 0.1 * k + better, np.e**k)
        gain = amplitude.gain_at_equal_rate(found, plain)
        assert gain.value == pytest.approx(better, abs=0.01)
        assert gain.low <= gain.value <= gain.high < gain.low + 0.03
    verdicts = [
        amplitude.verdict(IntervalEstimate(1.0, *ends), 2.0)
        for ends in ((0, 1.9), (1, 3), (2.1, 3))
    ]
    assert verdicts == ["yes", "undecided", "no"]


def test_target_appears_after_the_clutter_at_the_same_place_with_and_without_amplitude():
    for name in (scenes.NO_AMPLITUDE, "3 dB"):
        scene = scenes.with_target(scenes.TARGETS[name][0])
        assert (scene.total_scans, scene.warm_up) == (24, scenes.WARM_UP)
        found = scenes.run(scenes.Job(scene, scenes.as_drawn, [1, 4], 100.0))
        assert found.wrong < 20 and len(found.nees) == found.found


def test_changes_of_amplitudes_are_of_the_scan():
    scene = scenes.clutter_alone(scenes.CLUTTER["8 bits"][0])
    scan = next(iter(scenes.Simulator(scene, 1))).scan
    drawn_amplitude = scan.features["intensity"]
    bits = scenes.of_8_bits(drawn_amplitude, scan, 0)
    assert (bits == np.round(bits)).all() and len(np.unique(bits)) < len(bits)
    gained = scenes.with_a_gain(drawn_amplitude, scan, scenes.GAIN_AT)
    np.testing.assert_allclose(gained, 100.0 * drawn_amplitude)


def test_echoes_in_more_than_half_of_the_pings_are_not_false():
    stands, once = np.array([[5.0, 0.0]]), np.array([[9.0, 0.0]])
    pings = [stands, stands, np.concatenate([stands, once]), np.zeros((0, 2))]
    assert detector.false_ones(pings, 1.0) == [0, 0, 1, 0]


def test_detections_of_targets_do_not_count_and_the_others_do():
    targets = tuple(np.array(t, float) for t in detector.TARGETS)
    scenario = detector.scenario(detector.SETTLED + 10, targets=targets)
    images = list(ImageSimulator(scenario, ImageModel(), 1))
    ratio, cells = detector.ratio(images, 20.0, (1, 1))
    assert ratio == pytest.approx(1.0, abs=0.5)
    assert cells > 1000
