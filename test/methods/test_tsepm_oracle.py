"""The published method equals its plain-loop version, track for track."""

from __future__ import annotations

import numpy as np
import pytest
from support.batches import batches
from support.builders import AS_GIVEN
from support.plain_tsepm import plain_tsepm_with_counts
from support.scenes import Scene, random_scene

from tsepm_ros import SensorModel, make_initiator

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
        "tsepm",
        sensor=SensorModel(**scene.sensor),
        limit_speed=False,
        **AS_GIVEN,
        **scene.options,
    )
    compared = 0
    for scan, tracks, count in zip(scene.as_scans(), expected, counts, strict=True):
        found = {track.hits: track for track in initiator.process(scan)}
        statistics = initiator.statistics
        assert statistics.potential_tracks + statistics.hopeless_tracks == count.potential
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
