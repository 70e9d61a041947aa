"""A study gives the same numbers whoever does it, also when a worker dies in the middle."""

from __future__ import annotations

import dataclasses
import multiprocessing
import os
import signal

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
def test_a_dead_worker_costs_nothing_but_time(scenario, expected):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=50,
    ) as cluster:
        victim = next(iter(cluster.workers.values())).pid
        workers = Workers(scheduler=cluster.scheduler_address)
        results = study(scenario, TSEPM, RUNS, SEED, workers)
        found = [next(results)]
        os.kill(victim, signal.SIGKILL)
        found.extend(results)
    assert as_json(found) == expected


def test_a_scheduler_that_nobody_runs_is_said(scenario):
    pytest.importorskip("distributed")
    workers = Workers(scheduler="tcp://127.0.0.1:1", connect_time=0.5)
    results = study(scenario, TSEPM, range(4), SEED, workers)
    with pytest.raises(ValueError, match=r"127\.0\.0\.1:1 cannot be reached"):
        next(results)


@pytest.mark.long
def test_workers_end_with_the_study_that_is_closed_early(scenario, expected):
    results = study(scenario, TSEPM, RUNS, SEED, Workers(processes=2))
    assert as_json([next(results)]) == expected[:1]
    results.close()
    assert multiprocessing.active_children() == []
