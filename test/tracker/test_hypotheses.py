"""Hypotheses and their tree against plain loops."""

from dataclasses import replace

import numpy as np
import pytest
from support.batches import batches
from support.builders import AS_GIVEN
from support.scenes import random_scene
from support.score_scenes import NEVER, in_plain_loops, score

from tsepm_ros.tracker.hypotheses import Hypotheses, Start, given_starts
from tsepm_ros.tracker.initial_state import NO_HIT


def test_given_a_start_the_score_falls_by_the_share_of_the_hits_that_are_its_own():
    of, none = Hypotheses.none(3), NO_HIT
    hypotheses = replace(
        of,
        hits=np.array([[1, 2, none], [1, 3, none], [2, none, none]]),
        hit_count=np.array([2, 2, 1]),
        score_given_held=np.array([6.0, 6.0, -1.0]),
    )
    start = Start(
        np.array([1]), np.array([1, 2]), np.array([1.0, 0.5]), np.zeros(4), np.eye(4), 8.0
    )
    given = given_starts(hypotheses, [start])
    np.testing.assert_allclose(given.score_given_held, [1.5, 3.0, -1.0])


@pytest.mark.parametrize("seed", batches(24, 8))
def test_hypotheses_and_scores_are_those_of_plain_loops(seed):
    scene = random_scene(seed)
    plain_scans, sensor, options = in_plain_loops(scene, seed)
    initiator = score(sensor, false_tracks_per_hour=NEVER, **AS_GIVEN, **options)
    compared = 0
    for scan, grown in zip(scene.as_scans(), plain_scans, strict=False):
        expected = grown.kept
        assert len(initiator.process(scan)) == 0
        assert initiator.statistics.potential_tracks == len(expected)
        plain = {one.keys: one for one in expected}
        assert len(plain) == len(expected)
        found = initiator.potential_tracks()
        assert {track.hits for track in found} == {keys for keys in plain if len(keys) > 1}
        for row, hits in enumerate(found.hits):
            np.testing.assert_allclose(found.score[row], plain[hits].score, rtol=1e-7, atol=1e-7)
        inside = initiator.method.hypotheses
        inside = inside[inside.hit_count > 1]
        for row, hits in enumerate(found.hits):
            np.testing.assert_allclose(inside.state[row], plain[hits].state, rtol=1e-6, atol=1e-5)
            scale = np.linalg.norm(plain[hits].covariance)
            np.testing.assert_allclose(
                inside.covariance[row], plain[hits].covariance, rtol=0, atol=1e-7 * scale
            )
        compared += len(found)
    assert compared > 0
