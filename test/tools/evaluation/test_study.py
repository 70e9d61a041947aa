"""Studies: the design's figures, and the same numbers whoever does them."""

import dataclasses
import math
import multiprocessing

import numpy as np
import pytest
from support.run_summaries import as_json

from tsepm_ros.tools.evaluation.measures import RunSummary, measures_of
from tsepm_ros.tools.evaluation.performance import study
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint
from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.simulation import load_scenario

BOX = load_scenario("box", {"scans": 8})
RUNS = 150
TSEPM = OperatingPoint("tsepm")


@pytest.fixture(scope="module")
def box() -> list[RunSummary]:
    """The published method, 5/8, literal, over 8 scans of the box scene."""
    return list(study(BOX, TSEPM, range(RUNS), 2018))


@pytest.mark.long
def test_p_d_in_the_box_scene_is_the_design_s(box):
    # Design, section 6: 0.916 in 500 runs. The two shares differ by chance with a standard error
    # of sqrt(0.916 * 0.084 * (1 / 150 + 1 / 500)) = 0.026; 3.3 of them are 99.9 %.
    share = measures_of(BOX, box).detection.value
    error = math.sqrt(0.916 * 0.084 * (1 / RUNS + 1 / 500))
    assert abs(share - 0.916) < 3.3 * error


@pytest.mark.long
def test_false_tracks_in_the_box_scene_are_the_design_s(box):
    # Design: 21.6 per run in 500 runs, false and misplaced; one run has a standard deviation of
    # about 6.4. 3.3 standard errors of the difference, 2.0, are 99.9 %.
    false = [one.wrong for one in box]
    error = np.std(false, ddof=1) * math.sqrt(1 / RUNS + 1 / 500)
    assert error < 0.8
    assert abs(np.mean(false) - 21.6) < 3.3 * error


FEW_RUNS = range(24)
SEED = 7


@pytest.fixture(scope="module")
def scenario():
    return dataclasses.replace(load_scenario("box"), scans=8)


@pytest.fixture(scope="module")
def expected(scenario):
    return as_json(study(scenario, TSEPM, FEW_RUNS, SEED))


@pytest.mark.long
def test_workers_end_with_the_study_that_is_closed_early(scenario, expected):
    results = study(scenario, TSEPM, FEW_RUNS, SEED, Workers(processes=2))
    assert as_json([next(results)]) == expected[:1]
    results.close()
    assert multiprocessing.active_children() == []
