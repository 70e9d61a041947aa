"""The improved sequential and the logic method: scenes by hand, and their plain-loop versions."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2
from support.batches import batches
from support.builders import FIXED_RANGE_ERROR, detections, scan_at
from support.plain_hit_counting import plain_logic, plain_sequential
from support.scenes import Scene, random_scene

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.studies.logic import Polynomials


def initiator(**options):
    return make_initiator("sequential", sensor=FIXED_RANGE_ERROR, **options)


def confirmed_at(seen: str, **options) -> list[int]:
    """Scans, from 1 on, that confirm a target seen where `seen` has a 1."""
    made = initiator(**options)
    found = []
    for k, one in enumerate(seen):
        where = [(3000.0, 5.0 * 12.0 * k)] if one == "1" else []
        found += [k + 1] * len(made.process(scan_at(12.0 * k, where)))
    return found


@pytest.mark.parametrize(
    ("seen", "confirmed"),
    [("1111011", [7]), ("1110010101", [10]), ("1010010101", []), ("10100101011", [])],
    ids=["figure 3", "figure 4", "figure 5", "a sixth hit too late"],
)
def test_six_of_ten_as_in_the_figures(seen, confirmed):
    assert confirmed_at(seen) == confirmed


@pytest.mark.parametrize(
    ("ranges", "hits"),
    [
        ([3000, 3000, 3000, 3000, 3200, 3150, 3150], [1, 2, 3, 4, 6, 7]),
        ([3000, 3000, 3000, 3200, 3310, 3250, 3450, 3400, 3600, 3550], [1, 2, 3, 6, 8, 10]),
    ],
    ids=["figure 3", "figure 4"],
)
def test_points_outside_the_gate_leave_the_track_its_later_ones(ranges, hits):
    found = {}
    for matching in ("oldest", "nearest"):
        made = initiator(matching=matching)
        tracks = []
        for k, x in enumerate(ranges):
            tracks += made.process(scan_at(12.0 * k, [(float(x), 0.0)]))
        found[matching] = [[scan + 1 for scan, _ in track.hits] for track in tracks]
    assert found["oldest"] == [hits]
    assert hits not in found["nearest"], "the points outside must contend for the later ones"


@pytest.mark.parametrize("gap", [1, 2, 3, 5])
@pytest.mark.parametrize("inside", [True, False])
def test_the_gate_is_that_of_equation_7(gap, inside):
    # Hits along the line of sight: distances are differences of the unbiased ranges.
    made = initiator(min_hits=2)
    made.process(scan_at(0.0, [(3000.0, 0.0)]))
    for k in range(1, gap):
        made.process(scan_at(12.0 * k, []))
    reach = 10.0 * gap * 12.0 + 2.0 * 30.0
    unbiased = np.exp(0.5 * FIXED_RANGE_ERROR.azimuth_std**2)
    step = (reach + (-0.01 if inside else 0.01)) / unbiased
    assert len(made.process(scan_at(12.0 * gap, [(3000.0 + step, 0.0)]))) == inside


SENSOR = SensorModel(range_std=20.0, range_std_fraction=0.0, azimuth_std=1e-3)


def run(scans, **options):
    made = make_initiator("logic", sensor=SENSOR, **options)
    return [t for k, where in enumerate(scans) for t in made.process(scan_at(12.0 * k, where))]


def along_x(*steps: float):
    """Scans of one detection each that moves by the steps, m; the range's error is along x."""
    return [[(3000.0 + x, 0.0)] for x in np.cumsum([0.0, *steps])]


GAMMA = np.sqrt(chi2.ppf(0.99, 2))


@pytest.mark.parametrize(
    ("steps", "reach"),
    [((), 120.0 + GAMMA * np.sqrt(2) * 20.0), ((60.0,), 60.0 + GAMMA * np.sqrt(6) * 20.0)],
    ids=["second hit", "third hit"],
)
@pytest.mark.parametrize("inside", [True, False])
def test_the_region_is_that_of_the_speeds_and_then_of_the_line(steps, reach, inside):
    # The straight line through z_1, z_2 predicts 2 z_2 - z_1: the variance is 4 + 1, and R_j.
    scans = along_x(*steps, reach + (-0.5 if inside else 0.5))
    hits = len(scans)
    assert len(run(scans, min_hits=hits, window=hits)) == inside


def test_a_parabola_is_followed_by_the_second_order_only():
    scans = along_x(*(10.0 + 40.0 * k for k in range(6)))
    options = {"min_hits": 7, "window": 7, "gate_probability": 0.9}
    assert len(run(scans, **options)) == 1
    assert run(scans, degree=1, **options) == []


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_polynomial_is_that_of_numpy_with_its_covariance(degree):
    rng = np.random.default_rng(degree)
    times = np.array([100.0, 112.0, 130.0, 141.0, 155.0])
    hits = detections(rng.normal(0, 100, (3, 5, 2)), times)
    roots = rng.normal(0, 5, (3, 5, 2, 2))
    hits["covariance"] = roots @ np.swapaxes(roots, -1, -2)
    at = np.array([160.0, 170.0, 150.0])
    fitted = Polynomials.fitted(hits, 165.0, degree)
    position, covariance = fitted.at(np.arange(3), at)
    for row, time in enumerate(at):
        unit = [np.polyval(np.polyfit(times - time, one, degree), 0.0) for one in np.eye(5)]
        np.testing.assert_allclose(position[row], unit @ hits["position"][row], atol=1e-8)
        expected = np.einsum("i,iuv->uv", np.square(unit), hits["covariance"][row])
        np.testing.assert_allclose(covariance[row], expected, atol=1e-8)
    drift, sigma = fitted.reach(15.0)
    apart = np.hypot(*(position - fitted.coefficients[:, 0]).T)
    assert (apart <= drift * (1 + 1e-9) + 1e-9).all()
    assert (np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]) <= sigma * (1 + 1e-9)).all()


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
