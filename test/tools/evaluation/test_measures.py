"""The figures of runs, by hand, and the GOSPA metric, against every assignment that there is."""

import itertools
import math

import numpy as np
import pytest
from support.run_summaries import NOTHING, run_of, start

from tsepm_ros.tools.evaluation.intervals import mean_count, proportion
from tsepm_ros.tools.evaluation.measures import RunSummary, gospa, measures_of
from tsepm_ros.tools.evaluation.simulated_run import Outcome
from tsepm_ros.tools.simulation import Scenario

TRUE, REDUNDANT, MISPLACED = Outcome.TRUE, Outcome.REDUNDANT, Outcome.MISPLACED
SCENE = Scenario("hand", scans=4, period=12.0, clutter_box=(0.0, 1000.0, 0.0, 2000.0))
RUNS = [
    run_of(start(0), start(3), false=(3, 0, 0, 0), targets=2),
    run_of(start(1), start(2, MISPLACED), *[start(3, REDUNDANT)] * 4, targets=2),
]


def test_counts_by_hand():
    figures = measures_of(SCENE, RUNS)
    assert (figures.runs, figures.scans) == (2, 4)
    assert figures.detection == proportion(3, 4)
    assert figures.false_per_run == mean_count([3, 1])
    assert figures.false_density.value == pytest.approx(2.0 / (4 * 2.0))
    assert figures.false_density.high == pytest.approx(figures.false_per_run.high / 8.0)
    assert figures.false_per_hour.value == pytest.approx(2.0 * 3600.0 / 48.0)
    assert figures.redundant_per_run.value == 2.0
    assert figures.confirmation_time.value == pytest.approx((0 + 36 + 12) / 3)
    assert figures.confirmation_median.value == 12.0


def test_a_horizon_counts_its_own_scans_only():
    figures = measures_of(SCENE, RUNS, 2)
    assert figures.scans == 2
    assert figures.detection == proportion(2, 4)
    assert figures.false_per_run == mean_count([3, 0])
    assert figures.false_density.value == pytest.approx(1.5 / (2 * 2.0))
    assert figures.false_per_hour.value == pytest.approx(1.5 * 3600.0 / 24.0)
    assert figures.redundant_per_run.value == 0.0


def test_errors_of_true_and_of_pure_starts():
    mixed = start(1, pure=False, position_error=90.0, velocity_error=9.0, nees=30.0)
    far = start(1, MISPLACED, position_error=50.0, nees=10.0)
    again = start(2, REDUNDANT, position_error=1.0, nees=0.0)
    figures = measures_of(SCENE, [run_of(start(0), mixed, far, again, targets=2)])
    assert figures.position_error.value == pytest.approx(math.sqrt((30**2 + 90**2) / 2))
    assert figures.velocity_error.value == pytest.approx(math.sqrt((2**2 + 9**2) / 2))
    assert figures.nees.value == 17.0
    assert figures.pure_position_error.value == pytest.approx(math.sqrt((30**2 + 50**2) / 2))
    assert figures.pure_nees.value == 7.0
    assert figures.position_to_bound.value == pytest.approx(math.sqrt((30**2 + 50**2) / 1800))


def test_gospa_is_averaged_over_the_scans_and_its_parts_add_up_in_squares():
    one = run_of(localisation=100.0, missed=0.0, false_held=1800.0)
    still = RunSummary(1, (), (*one.scans[:3], NOTHING))
    assert measures_of(SCENE, [still]).gospa_mean.value == pytest.approx(0.75 * math.sqrt(1900.0))
    assert measures_of(SCENE, [still]).gospa.value == pytest.approx(math.sqrt(0.75 * 1900.0))
    two = run_of(localisation=0.0, missed=900.0, false_held=0.0)
    figures = measures_of(SCENE, [one, two])
    assert figures.gospa_localisation.value == pytest.approx(math.sqrt(50.0))
    assert figures.gospa_missed.value == pytest.approx(math.sqrt(450.0))
    assert figures.gospa_false.value == pytest.approx(30.0)
    assert figures.gospa.value == pytest.approx(math.sqrt(1400.0))


def test_what_is_not_known_has_no_figure():
    nothing_held = {"held": -1, "localisation": math.nan, "missed": math.nan}
    figures = measures_of(SCENE, [run_of(false_held=math.nan, **nothing_held)] * 3)
    assert figures.detection.value == 0.0
    assert figures.text("detection").startswith("0.0000 (")
    for name in ("held", "gospa", "nees", "pure_nees", "position_to_bound", "confirmation_95"):
        assert math.isnan(getattr(figures, name).value)
        assert figures.text(name) == "-"


def plain_gospa(tracks: np.ndarray, targets: np.ndarray, cutoff: float) -> float:
    """Equation (1) of the paper's Proposition 1, p = 2, by trying everything."""
    n, m = len(tracks), len(targets)
    least = math.inf
    for size in range(min(n, m) + 1):
        for chosen in itertools.combinations(range(n), size):
            for theirs in itertools.permutations(range(m), size):
                apart = sum(
                    float(((tracks[i] - targets[j]) ** 2).sum())
                    for i, j in zip(chosen, theirs, strict=True)
                )
                least = min(least, apart + cutoff**2 / 2 * (n + m - 2 * size))
    return math.sqrt(least)


@pytest.mark.parametrize("seed", range(30))
def test_the_metric_is_the_least_over_all_assignments(seed):
    rng = np.random.default_rng([5, seed])
    tracks = rng.uniform(0, 100, (rng.integers(0, 5), 2))
    targets = rng.uniform(0, 100, (rng.integers(0, 5), 2))
    cutoff = float(rng.uniform(10, 80))
    found = gospa(tracks, targets, cutoff)
    assert found.distance == pytest.approx(plain_gospa(tracks, targets, cutoff))
    assert gospa(targets, tracks, cutoff).distance == pytest.approx(found.distance)


def test_a_track_at_the_cut_off_is_false_and_its_target_missed():
    found = gospa(np.array([[10.0, 0.0]]), np.array([[0.0, 0.0]]), 10.0)
    assert (found.localisation, found.missed, found.false) == (0.0, 50.0, 50.0)
