"""Which evidence starts a track, with which hits and state."""

import math
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from support.builders import AS_GIVEN, scan_at
from support.plain_score import at_max_speed, plain_starts, strong_groups
from support.scenes import Scene, crowded_scene, random_scene
from support.score_scenes import in_plain_loops, score

from tsepm_ros import Scan, SensorModel
from tsepm_ros.methods.score import Score
from tsepm_ros.tracker import confirmation, pruning
from tsepm_ros.tracker.confirmation import min_purity_probability
from tsepm_ros.tracker.hypotheses import Tree
from tsepm_ros.tracker.initial_state import fit_initial_states
from tsepm_ros.tracker.measurement import LEAST_ACROSS, MeasurementWindow, convert_measurements
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions
from tsepm_ros.tracker.tracker import Tracker

EXACT = SensorModel(range_std=5.0, range_std_fraction=0.0, azimuth_std=0.002)


def rule_at(threshold_of: Callable[[Tree], float]) -> Any:
    """The rule as built, at a threshold of its own for each tree."""
    rule = confirmation.confirm

    def confirm(
        tree: Tree, window: MeasurementWindow, _: float, *others: Any, **figures: Any
    ) -> Any:
        return rule(tree, window, threshold_of(tree), *others, **figures)

    return patch.object(confirmation, "confirm", confirm)


def decided(scene: Scene, seed: int, threshold: float) -> tuple[int, int]:
    """Compare a scene's first starts with those of plain loops.

    Returns their number, and that of detections whose evidence was enough until then.
    """
    plain_scans, sensor, options = in_plain_loops(scene, seed)
    common = CommonOptions(limit_speed="off", **AS_GIVEN)
    initiator = Tracker(Score(sensor, common, ScoreOptions(**options)))
    strong = 0
    for index, (scan, tree) in enumerate(zip(scene.as_scans(), plain_scans, strict=False)):
        grown = at_max_speed(tree, common.max_speed)
        with rule_at(lambda _: threshold):
            tracks, expected = initiator.process(scan), plain_starts(grown, threshold, 1.0)
        strong += len(strong_groups(grown, threshold))
        assert [set(track.hits) for track in tracks] == [one.hits for one in expected]
        for track, start in zip(tracks, expected, strict=True):
            assert track.score == pytest.approx(start.evidence, abs=1e-6)
            state, covariance = mixed(start.mixed, scene.as_scans()[: index + 1], sensor)
            np.testing.assert_allclose(track.state, state, rtol=1e-5, atol=1e-3)
            scale = np.linalg.norm(covariance)
            np.testing.assert_allclose(track.covariance, covariance, rtol=0, atol=1e-5 * scale)
        if expected:
            return len(expected), strong
    return 0, strong


def mixed(members: list, scans: list[Scan], sensor: SensorModel) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance over hypotheses, each fitted to its hits; negligible ones left out."""
    converted = [
        convert_measurements(scan, sensor, index, LEAST_ACROSS * (scan.azimuth_std is None))
        for index, scan in enumerate(scans)
    ]
    most = max(one.score for one in members)
    counted = [one for one in members if one.score >= most + math.log(0.01)]
    weights = np.exp([one.score - most for one in counted])
    weights /= weights.sum()
    fits = []
    for one in counted:
        hits = np.concatenate([converted[scan][[row]] for scan, row in one.keys])[None]
        found = fit_initial_states(hits, scans[-1].stamp, sensor, "weighted")
        fits.append((found.state[0], found.covariance[0]))
    mean = sum(weight * state for weight, (state, _) in zip(weights, fits, strict=True))
    spread = sum(
        weight * (covariance + np.outer(state - mean, state - mean))
        for weight, (state, covariance) in zip(weights, fits, strict=True)
    )
    return mean, spread


@pytest.mark.parametrize(
    ("make", "threshold"),
    [(random_scene, 4.0), pytest.param(crowded_scene, 3.0, marks=pytest.mark.long)],
)
def test_what_is_confirmed_is_what_plain_loops_confirm(make, threshold, monkeypatch):
    monkeypatch.setattr(pruning, "MOST_ALIKE", 10**6)  # the plain loops have no such limit
    counts = [decided(make(seed), seed, threshold) for seed in range(12)]
    started, strong = np.sum(counts, axis=0)
    assert started >= 6
    if make is crowded_scene:
        assert strong > 2 * started, "some wait, or are a track's already"


@pytest.mark.parametrize(("rate", "waits"), [(1000.0, True), (20000.0, False)])
def test_where_false_tracks_are_many_by_choice_a_start_need_not_be_as_pure(rate, waits):
    # Of two ways, one is three times as likely: its second difference is 22 m less, of sigma 15 m.
    initiator = score(EXACT, false_tracks_per_hour=rate)
    initiator.process(scan_at(0.0, [(3000.0, 0.0)]))
    initiator.process(scan_at(12.0, [(3000.0, 84.0), (3000.0, -84.0)]))
    started = initiator.process(scan_at(24.0, [(3000.0, 168.0), (3000.0, -190.0)]))
    if waits:  # with evidence enough
        assert initiator.potential_tracks().score.max() > initiator.method.threshold + 5.0
    assert [set(track.hits) for track in started] == ([] if waits else [{(0, 0), (1, 0), (2, 0)}])


def test_the_purity_of_a_start_falls_from_3000_false_tracks_per_hour_on():
    rates = (0.1, 300.0, 3000.0, 4500.0, 1e5)
    expected = [0.9, 0.9, 0.9, 0.6, 0.5]
    np.testing.assert_allclose([min_purity_probability(rate) for rate in rates], expected)


@pytest.mark.parametrize("wish", [1.0, 1000.0])
def test_a_target_of_several_detections_a_ping_is_started_by_hits_of_one_path(wish):
    # Which of them are its own is never clear: it waits for eight hits, not for ever.
    initiator = score(EXACT, false_tracks_per_hour=wish, plots="off")
    started = []
    for index in range(12):
        y = 41.0 * index
        found = [(3000.0, y), (3001.0, y + 2.0), (2999.0, y + 3.0)]
        started += initiator.process(scan_at(12.0 * index, found))
    assert started
    assert started[0].stamp == 12.0 * 7
    for track in started:
        scans = [scan for scan, _ in track.hits]
        assert len(set(scans)) == len(scans) >= 3
        assert track.velocity[1] == pytest.approx(41.0 / 12.0, abs=0.5)


def test_no_track_on_two_hits_however_strong():
    sensor = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=1e-4)
    initiator = score(sensor, false_tracks_per_hour=1e6)
    scans = [scan_at(12.0 * k, [(3000.0 + 10.0 * k, 0.0)]) for k in range(3)]
    assert [len(initiator.process(scan)) for scan in scans] == [0, 0, 1]


@pytest.mark.parametrize(("earlier", "starts"), [(0.45, 1), (0.8, 0)])
def test_a_target_is_started_that_a_confirmed_track_explains_in_part(earlier, starts):
    # 0.45 or 0.8 of the first four hits are due to the confirmed track, 0.67 of six at least.
    probability = [earlier] * 4 + [0.4] * 2
    initiator = Tracker(Score(EXACT, CommonOptions(**AS_GIVEN), ScoreOptions()))

    def partly_confirmed(tree: Tree) -> float:
        """3 below the largest evidence: not enough for a second target."""
        confirmed = np.full(len(tree.ids), probability.pop(0))
        initiator.window.note_confirmed(tree.ids, confirmed)
        return tree.evidence.max() - 3.0

    scans = [scan_at(12.0 * k, [(3000.0, 84.0 * k)]) for k in range(6)]
    with rule_at(partly_confirmed):
        assert sum(len(initiator.process(scan)) for scan in scans) == starts
