"""The methods `sequential` and `logic` equal their plain-loop versions, track for track."""

from typing import Any

import numpy as np
import pytest
from support.batches import batches
from support.plain_hit_counting import plain_logic, plain_sequential
from support.scenes import Scene, random_scene

from tsepm_ros import SensorModel, make_initiator

SCENES = 24
BATCH = 4
ALWAYS = 8


def options_of(scene: Scene, seed: int, method: str) -> dict[str, Any]:
    rng = np.random.default_rng([2014, seed])
    rule = {name: scene.options[name] for name in ("max_speed", "min_hits", "window")}
    if method == "logic":
        return rule | {
            "gate_probability": float(rng.choice([0.9, 0.99])),
            "degree": int(rng.integers(1, 4)),
            "missed": str(rng.choice(["waits", "ends"])),
        }
    return rule | {
        "gate_sigmas": float(rng.choice([0.0, 2.0, 3.0])),
        "gate_error": str(rng.choice(["range", "major_axis"])),
        "estimator": str(rng.choice(["least_squares", "linear_fitting", "kalman_filter"])),
        "process_noise": float(rng.choice([0.0, 0.001, 0.1])),
        "matching": str(rng.choice(["nearest", "oldest", "shared"])),
    }


PLAIN = {"sequential": plain_sequential, "logic": plain_logic}


def compare(method: str, seed: int) -> int:
    """Compare one scene; returns the number of tracks compared."""
    scene = random_scene(seed)
    options = options_of(scene, seed, method)
    expected = PLAIN[method](scene.scans, scene.sensor, options)
    sensor = SensorModel(**scene.sensor)
    made = make_initiator(method, sensor=sensor, limit_speed="off", **options)
    for scan, (tracks, potential) in zip(scene.as_scans(), expected, strict=True):
        found = {track.hits: track for track in made.process(scan)}
        assert set(found) == {track.hits for track in tracks}
        assert made.statistics.potential_tracks == potential
        for track in tracks:
            same = found[track.hits]
            assert_close(same.state, track.state)
            if options.get("estimator") != "linear_fitting":
                assert_close(same.covariance, track.covariance)
                assert same.evaluation == pytest.approx(track.evaluation, rel=1e-6, abs=1e-9)
    return sum(len(tracks) for tracks, _ in expected)


def assert_close(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * np.linalg.norm(expected))


@pytest.mark.parametrize("first", batches(SCENES, ALWAYS, BATCH))
@pytest.mark.parametrize("method", PLAIN)
def test_equals_the_plain_version(method: str, first: int) -> None:
    compared = sum(compare(method, seed) for seed in range(first, first + BATCH))
    assert compared > 0, "the scenes must confirm tracks, or nothing was compared"
