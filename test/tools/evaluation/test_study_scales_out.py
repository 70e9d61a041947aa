"""A study gives the same numbers by any number of processes."""

from __future__ import annotations

import dataclasses
import multiprocessing

import pytest
from support.run_summaries import as_json

from tsepm_ros.tools.evaluation.performance import study
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint
from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.simulation import load_scenario

RUNS = range(24)
SEED = 7
TSEPM = OperatingPoint("tsepm")


@pytest.fixture(scope="module")
def scenario():
    return dataclasses.replace(load_scenario("box"), scans=8)


@pytest.fixture(scope="module")
def expected(scenario):
    return as_json(study(scenario, TSEPM, RUNS, SEED))


@pytest.mark.long
def test_workers_end_with_the_study_that_is_closed_early(scenario, expected):
    results = study(scenario, TSEPM, RUNS, SEED, Workers(processes=2))
    assert as_json([next(results)]) == expected[:1]
    results.close()
    assert multiprocessing.active_children() == []
