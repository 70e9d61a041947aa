"""A study gives the same numbers whoever does it, also when a worker dies in the middle."""

from __future__ import annotations

import dataclasses
import os
import signal

import pytest

from tsepm_ros.analysis.study import study
from tsepm_ros.simulation import load_scenario

RUNS = 48
SEED = 7


@pytest.fixture(scope="module")
def scenario():
    return dataclasses.replace(load_scenario("box"), scans=8)


@pytest.fixture(scope="module")
def expected(scenario):
    return list(study(scenario, "tsepm", {}, runs=RUNS, seed=SEED))


def test_two_processes_give_the_same_numbers_as_one(scenario, expected):
    assert list(study(scenario, "tsepm", {}, runs=RUNS, seed=SEED, workers=2)) == expected


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
        results = study(
            scenario, "tsepm", {}, runs=RUNS, seed=SEED, scheduler=cluster.scheduler_address
        )
        found = [next(results)]
        os.kill(victim, signal.SIGKILL)
        found.extend(results)
    assert found == expected


def test_a_scheduler_that_nobody_runs_is_said(scenario, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("tsepm_ros.analysis.study.CONNECT_TIME", 0.5)
    results = study(scenario, "tsepm", {}, runs=4, seed=SEED, scheduler="tcp://127.0.0.1:1")
    with pytest.raises(ValueError, match=r"127\.0\.0\.1:1 cannot be reached"):
        next(results)
