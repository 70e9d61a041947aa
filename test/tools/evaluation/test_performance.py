# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Evaluations and studies: what is found, interrupted ones, and workers that end."""

import csv
import dataclasses
import io
import json
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from support.patience import WAIT
from support.run_summaries import as_json, study

from tsepm_ros import ConfirmedTrack
from tsepm_ros.tools.evaluation.measures import HEADINGS, measures_of
from tsepm_ros.tools.evaluation.performance import (
    PerformancePlan,
    evaluate_performance,
    performance_markdown,
    write_performance_csv,
)
from tsepm_ros.tools.evaluation.simulated_run import SimulatedOperatingPoint
from tsepm_ros.tools.simulation import load_scenario

pytestmark = pytest.mark.usefixtures("tests_installed")

BOX = load_scenario("box", {"scans": 7})
SCORE = SimulatedOperatingPoint("score", "300/h", {"false_tracks_per_hour": 300.0})
TSEPM = SimulatedOperatingPoint("tsepm", "3/4", {"min_hits": 3, "window": 4})


class NearestStarter:
    """Starts a track, without a covariance, at the detection nearest to where the target is."""

    def __init__(self, min_range: float) -> None:
        self.min_range = min_range
        self.scan_index = -1

    def process(self, scan):
        self.scan_index += 1
        x, y = scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth)
        apart = np.hypot(x - 5000.0, y - 5000.0)
        row = int(apart.argmin())
        if apart[row] < self.min_range:
            return []
        state = np.array([x[row], 0.0, y[row], 0.0])
        hits = ((self.scan_index, row),)
        return [ConfirmedTrack(0, scan.stamp, state, np.full((4, 4), np.nan), hits, np.nan)]


def make_toy(scenario, method, options):
    return NearestStarter(**options)


TOY = SimulatedOperatingPoint("toy", "nearest", {"min_range": 0.0}, make_toy)


def plan(*points, runs=4, **more) -> PerformancePlan:
    return PerformancePlan(
        scenarios=[BOX], points=points or [SCORE, TSEPM], runs=runs, seed=5, **more
    )


def tables(what: PerformancePlan, folder, **more) -> tuple[str, str]:
    evaluated = evaluate_performance(what, folder, **more)
    file = io.StringIO()
    write_performance_csv(what, evaluated, file)
    return performance_markdown(what, evaluated, "command"), file.getvalue()


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    return tables(plan(), tmp_path_factory.mktemp("whole"))


def lines(folder) -> dict[str, int]:
    return {path.name: len(path.read_text().splitlines()) for path in folder.iterdir()}


@pytest.mark.long
def test_an_interrupted_evaluation_goes_on_where_it_stopped(tmp_path, expected):
    class StopError(Exception):
        pass

    def stop_after_five(runs, total):
        assert total == 8
        for done, one in enumerate(runs):
            if done == 5:
                raise StopError
            yield one

    with pytest.raises(StopError):
        evaluate_performance(plan(), tmp_path, progress=stop_after_five)
    assert sorted(lines(tmp_path).values()) == [2, 5]  # with the header
    left = []
    found = tables(plan(), tmp_path, progress=lambda runs, total: (left.append(total), runs)[1])
    assert left == [3]
    assert found == expected


@pytest.mark.long
def test_a_killed_process_costs_the_run_that_it_was_writing(tmp_path, expected):
    evaluate_performance(plan(), tmp_path)
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:-30])
    assert tables(plan(), tmp_path) == expected


def test_a_point_is_reported_as_soon_as_its_runs_are_done(tmp_path):
    done: list[int] = []
    said = []

    def count(runs, total):
        for one in runs:
            done.append(total)
            yield one

    evaluated = evaluate_performance(
        plan(TSEPM, TOY, runs=2),
        tmp_path,
        progress=count,
        report=lambda one: said.append((len(done), one.points[0].method, one.measures[0])),
    )
    assert [one[:2] for one in said] == [(2, "tsepm"), (4, "toy")]
    assert [one[2].found for one in said] == [one.found for one in evaluated[0].measures]
    done.clear()
    evaluate_performance(
        plan(TSEPM, TOY, runs=2), tmp_path, progress=count, report=lambda one: said.append(one)
    )
    assert (len(said), done) == (4, []), "those of stored runs, too"


def test_two_workers_give_the_same_tables_as_one(tmp_path, expected):
    assert tables(plan(), tmp_path, processes=2) == expected


def test_anything_that_starts_tracks_can_be_evaluated(tmp_path):
    (found,) = evaluate_performance(plan(TOY, TSEPM), tmp_path, 2)
    toy = found.measures[0]
    assert toy.found.value > 0.5  # its one hit is the target's
    assert toy.false_per_run.value > 0.0  # but when the target was missed
    assert toy.redundant_per_run.value > 1.0
    for name in ("nees", "held", "position_to_bound"):
        assert math.isnan(getattr(toy, name).value)
    assert not math.isnan(toy.pure_position_error.value)
    assert "| toy | nearest |" in performance_markdown(plan(TOY, TSEPM), [found], "command")


def test_points_that_cannot_be_told_apart_are_refused():
    with pytest.raises(ValueError, match="score 300/h is given twice"):
        dataclasses.replace(plan(), points=[SCORE, SCORE])


def test_the_csv_has_every_figure_with_its_interval(expected):
    rows = list(csv.DictReader(io.StringIO(expected[1])))
    assert [(row["scenario"], row["method"], row["point"]) for row in rows] == [
        ("box", "score", "300/h"),
        ("box", "tsepm", "3/4"),
    ]
    for row in rows:
        assert (row["scans"], row["runs"], row["seed"]) == ("7", "4", "5")
        for name in HEADINGS:
            value, low, high = (float(row[f"{name}{end}"]) for end in ("", "_low", "_high"))
            assert math.isnan(value) or math.isnan(low) or low <= value <= high
    assert json.loads(rows[1]["options"]) == {"min_hits": 3, "window": 4}
    assert 0.0 <= float(rows[0]["found_low"]) < float(rows[0]["found_high"]) <= 1.0


DESIGN_BOX = load_scenario("box", {"scans": 8})
RUNS = 150
FIVE_OF_EIGHT = SimulatedOperatingPoint("tsepm")


@pytest.mark.long
def test_p_d_and_false_tracks_in_the_box_scene_are_the_design_s():
    """Design, section 6: 0.916, and 21.6 per run, false and misplaced, in 500 runs of 5/8."""
    box = list(study(DESIGN_BOX, FIVE_OF_EIGHT, range(RUNS), 2018))
    # Shares and counts differ by chance: 3.3 standard errors of the differences are 99.9 %.
    share = measures_of(DESIGN_BOX, box).found.value
    error = math.sqrt(0.916 * 0.084 * (1 / RUNS + 1 / 500))
    assert abs(share - 0.916) < 3.3 * error
    false = [one.wrong for one in box]
    error = np.std(false, ddof=1) * math.sqrt(1 / RUNS + 1 / 500)
    assert error < 0.8
    assert abs(np.mean(false) - 21.6) < 3.3 * error


@pytest.mark.long
def test_workers_end_with_the_study_that_is_closed_early():
    results = study(DESIGN_BOX, FIVE_OF_EIGHT, range(24), 7, 2)
    assert as_json([next(results)]) == as_json(study(DESIGN_BOX, FIVE_OF_EIGHT, range(1), 7))
    results.close()
    assert multiprocessing.active_children() == []


SCRIPT = """
import os, sys, time
from tsepm_ros.tools.evaluation.result_files import mapped_results

def busy(job):
    os.write(1, b"%d\\n" % os.getpid())  # in one piece
    time.sleep(3600)

if __name__ == "__main__":
    list(mapped_results(busy, range(4), 2))
"""


def is_alive(process: int) -> bool:
    try:
        with open(f"/proc/{process}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.long
@pytest.mark.skipif(not os.path.exists("/proc/self/stat"), reason="needs /proc")
def test_workers_of_a_killed_parent_end(tmp_path):
    script = tmp_path / "run.py"
    script.write_text(SCRIPT)
    workers: list[int] = []
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True) as run:
        try:
            workers += [int(run.stdout.readline()) for _ in range(2)]
            assert all(is_alive(worker) for worker in workers)
            run.kill()
            run.wait()
            end = time.monotonic() + WAIT
            while any(is_alive(worker) for worker in workers) and time.monotonic() < end:
                time.sleep(0.05)
            assert not any(is_alive(worker) for worker in workers)
        finally:
            run.kill()
            for worker in filter(is_alive, workers):
                os.kill(worker, signal.SIGKILL)


WHILE_THEY_START = """
import os, signal, time
from tsepm_ros.tools.evaluation.result_files import mapped_results

def wait(job):
    time.sleep(0.001)

def end(number, frame):
    raise SystemExit(40 + number)

if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    ended = iter([signal.{name}])
    os.register_at_fork(before=lambda: [os.kill(os.getpid(), number) for number in ended])
    list(mapped_results(wait, range(4), 2))
"""


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_workers_start_is_not_lost(tmp_path, number):
    script = tmp_path / "run.py"
    script.write_text(WHILE_THEY_START.format(name=number.name))
    ended = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=False, timeout=WAIT
    )
    assert (ended.returncode, ended.stderr) == (40 + number, "")
