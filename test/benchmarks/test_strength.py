"""Benchmarks of strengths: the comparison at equal false rate, and the scenes."""

from __future__ import annotations

import numpy as np
import pytest
import strength
import strength_scenes as scenes

from tsepm_ros.tools.evaluation.intervals import Estimate


def drawn(rng, share: float, wrong: float, runs: int = 4000) -> np.ndarray:
    """Runs as of `strength.counted`: the same luck of a run for all."""
    luck = rng.random((2, runs))
    return np.array([luck[0] < share, wrong * np.round(-np.log(luck[1]))])


def test_gain_is_judged_at_the_same_false_rate():
    """P_D rises by 0.1 for e times the false rate: more of both by that line gains nothing."""
    plain = np.array([drawn(np.random.default_rng(1), 0.6 + 0.1 * k, np.e**k) for k in (-1, 0, 1)])
    for k, better in ((0.0, 0.0), (0.5, 0.0), (-0.5, 0.05)):
        found = drawn(np.random.default_rng(1), 0.6 + 0.1 * k + better, np.e**k)
        gain = strength.gain_at_equal_rate(found, plain)
        assert gain.value == pytest.approx(better, abs=0.01)
        assert gain.low <= gain.value <= gain.high < gain.low + 0.03


def test_verdict_is_by_bounds():
    verdicts = [
        strength.verdict(Estimate(1.0, *ends), 2.0) for ends in ((0, 1.9), (1, 3), (2.1, 3))
    ]
    assert verdicts == ["yes", "undecided", "no"]


def test_target_appears_after_the_clutter_at_the_same_place_with_and_without_strength():
    for name in (scenes.NO_STRENGTH, "3 dB"):
        scene = scenes.with_target(scenes.TARGETS[name][0])
        assert (scene.total_scans, scene.warm_up) == (24, scenes.WARM_UP)
        found = scenes.run(scenes.Job(scene, scenes.as_drawn, [1, 4], 100.0))
        assert found.wrong < 20 and len(found.nees) == found.found


def test_changes_of_strengths_are_of_the_scan():
    scene = scenes.clutter_alone(scenes.CLUTTER["8 bits"][0])
    scan = next(iter(scenes.Simulator(scene, 1))).scan
    drawn_strength = scan.features["intensity"]
    bits = scenes.of_8_bits(drawn_strength, scan, 0)
    assert (bits == np.round(bits)).all() and len(np.unique(bits)) < len(bits)
    gained = scenes.with_a_gain(drawn_strength, scan, scenes.GAIN_AT)
    np.testing.assert_allclose(gained, 100.0 * drawn_strength)
