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
"""Files of runs: found again only by what they belong to."""

import dataclasses
import json
import multiprocessing
import os
import signal
import sys
import time
from pathlib import Path

import pytest
from support.run_summaries import run_of, start

from tsepm_ros.methods.registry import METHODS
from tsepm_ros.tools.evaluation.performance import (
    PerformancePlan,
    evaluate_performance,
    performance_markdown,
    performance_run_file,
)
from tsepm_ros.tools.evaluation.result_files import (
    Result,
    ResultRunFile,
    complete_result_files,
    completed_results,
    mapped_results,
    read_result,
    result_code_key,
    write_result,
)
from tsepm_ros.tools.evaluation.simulated_run import (
    SimulatedOperatingPoint,
    simulated_operating_points,
)
from tsepm_ros.tools.simulation import load_scenario

TOY = """
import {helper}
from tsepm_ros.methods.score import Score


class Toy(Score):
    files = ("toy_weights.txt",)

    def step(self, observed):
        from toy_package.later import LIMIT

        return super().step(observed)
"""


@pytest.mark.usefixtures("tests_installed")
def test_runs_of_a_method_outside_the_package_are_of_its_modules_and_files_also_those_used_later(
    tmp_path, monkeypatch
):
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "toy_package").mkdir()
    for name in ("__init__", "later", "deeper"):
        text = "from . import deeper\nLIMIT = 3\n" if name == "later" else ""
        (tmp_path / "toy_package" / f"{name}.py").write_text(text)
    (tmp_path / "toy_weights.txt").write_text("0.5\n")
    (tmp_path / "toy_rule.py").write_text("HITS = 3\n")
    (tmp_path / "toy_method.py").write_text(TOY.format(helper="toy_rule"))
    monkeypatch.setitem(METHODS, "toy", "toy_method:Toy")
    inside, codes = simulated_operating_points(["score"])[0].code, []
    # Each of the next processes has other code.
    for name in ("", "toy_package/deeper.py", "toy_weights.txt", "toy_rule.py"):
        if name:
            with (tmp_path / name).open("a") as file:
                file.write("CHANGED = True\n")
        result_code_key.cache_clear()
        codes += [point.code for point in simulated_operating_points(["toy"])[:1]]
    assert len({inside, *codes}) == 5
    assert simulated_operating_points(["score"])[0].code == inside == result_code_key()
    assert "toy_package.later" not in sys.modules, "it is imported by a run only"
    for name in ("toy_rule", "toy_method"):
        monkeypatch.delitem(sys.modules, name)


def test_the_key_of_stored_runs_is_of_every_module_and_of_further_files(tmp_path):
    (tmp_path / "peer.py").write_text("rule = 3\n")
    assert result_code_key(tmp_path / "peer.py") != result_code_key()


BOX = load_scenario("box")

POINT = SimulatedOperatingPoint("score", "1/h", {"false_tracks_per_hour": 1.0}, version="1")

SUMMARIES = {0: run_of(), 1: run_of(start(2), false=(0, 1, 0, 2)), 4: run_of(start(1))}

RECORDS = {index: summary.as_json() for index, summary in SUMMARIES.items()}


@pytest.fixture
def file(tmp_path) -> ResultRunFile:
    made = performance_run_file(tmp_path, BOX, POINT, 1)
    for index, record in RECORDS.items():
        made.append(index, record)
    return made


def test_a_header_says_what_the_runs_depend_on(file):
    header = json.loads(file.path.read_text().splitlines()[0])
    assert header["method"] == "score"
    assert header["options"] == {"false_tracks_per_hour": 1.0}
    assert header["scenario"]["sensor"]["clutter_density"] == 1e-6
    assert (header["seed"], header["version"]) == (1, "1")


@pytest.mark.parametrize(
    "other",
    [
        {"seed": 2},
        {"point": dataclasses.replace(POINT, options={"false_tracks_per_hour": 2.0})},
        {"point": dataclasses.replace(POINT, version="2")},
        {"scenario": load_scenario("box", {"sensor.azimuth_std": 0.02})},
        {"scenario": load_scenario("box", {"scans": 8})},
    ],
    ids=["seed", "options", "version", "sensor", "scans"],
)
def test_anything_else_has_a_file_of_its_own(file, tmp_path, other):
    found = performance_run_file(tmp_path, **{"scenario": BOX, "point": POINT, "seed": 1, **other})
    assert found.path != file.path
    assert found.results == {}
    assert performance_run_file(tmp_path, BOX, POINT, 1).results == RECORDS


def test_what_is_cut_off_is_written_again_and_other_damage_is_refused(file, tmp_path):
    content = file.path.read_bytes()
    lines = content.splitlines(keepends=True)
    file.path.write_bytes(b"".join([*lines[:2], b'[1, {"tar\n', *lines[3:]]))
    with pytest.raises(ValueError, match="is damaged"):
        performance_run_file(tmp_path, BOX, POINT, 1)
    file.path.write_bytes(content[:20])
    assert performance_run_file(tmp_path, BOX, POINT, 1).results == {}
    assert file.path.read_bytes() == lines[0]
    file.path.replace(performance_run_file(tmp_path, BOX, POINT, 2).path)
    with pytest.raises(ValueError, match="was made by another version"):
        performance_run_file(tmp_path, BOX, POINT, 2)


@pytest.mark.parametrize(
    "line", ["5", "[1]", '["a", {}]', "null", '{"a": 1}', "[" * 100_000, "[true, 1]"]
)
def test_a_line_that_is_no_run_is_named(tmp_path, line):
    file = ResultRunFile(tmp_path, ["box"], {"version": 1})
    file.append(0, {"a": 1})
    with file.path.open("a") as content:
        content.write(line + "\n")
    with pytest.raises(ValueError, match=r"is damaged: .* is not a run") as error:
        ResultRunFile(tmp_path, ["box"], {"version": 1})
    assert len(str(error.value)) < 400


def test_a_result_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "deep" / "a.json"
    result = Result(
        command="tsepm evaluate",
        seed=1,
        runs=2,
        parameters={"window": 8},
        header=["a"],
        rows=[["±"]],
    )
    write_result(path, result)
    assert read_result(path) == result
    path.write_text("[1]")
    with pytest.raises(ValueError, match="not a result file"):
        read_result(path)


def _ended_once(job: tuple[str, int]) -> int:
    """The square of a number; the process that is the first to do job 2 is killed."""
    folder, number = job
    mark = Path(folder) / "killed"
    if number == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def _ended(job: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return job


def _late_first(job: tuple[str, int]) -> int:
    """The first job waits until another is stored."""
    folder, number = job
    while number == 0 and not any(b"[1," in path.read_bytes() for path in Path(folder).iterdir()):
        time.sleep(0.01)
    return number


def test_a_worker_that_is_killed_is_replaced_and_nothing_is_lost(tmp_path):
    jobs = [(str(tmp_path), number) for number in range(6)]
    assert list(mapped_results(_ended_once, jobs, 2)) == [0, 1, 4, 9, 16, 25]
    assert (tmp_path / "killed").exists()


SHORT = PerformancePlan(scenarios=[load_scenario("box", {"scans": 4})], points=[POINT], runs=24)


def killing(victim):
    """A progress that kills a process after three results."""

    def kill(results, total):
        for place, result in enumerate(results):
            if place == 3:
                os.kill(victim(), signal.SIGKILL)
            yield result

    return kill


def assert_same_runs(folder, workers, victim):
    """Runs by workers of which one is killed are those of this process; repeated it continues."""
    evaluate_performance(SHORT, folder / "one")
    evaluate_performance(SHORT, folder / "two", workers, killing(victim))
    [one], [two] = ([*(folder / name).iterdir()] for name in ("one", "two"))
    written = two.read_bytes()
    assert sorted(written.splitlines()) == sorted(one.read_bytes().splitlines())
    texts = [
        performance_markdown(SHORT, evaluate_performance(SHORT, path, progress=none_missing), "")
        for path in (folder / "one", folder / "two")
    ]
    assert texts[0] == texts[1] and two.read_bytes() == written


def test_an_evaluation_of_which_a_worker_is_killed_has_the_same_runs(tmp_path):
    assert_same_runs(tmp_path, 2, lambda: multiprocessing.active_children()[0].pid)


def test_a_cluster_of_which_a_worker_is_killed_leaves_the_same_runs(tmp_path):
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    settings = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with (
        distributed.LocalCluster(host="127.0.0.1", **settings) as cluster,
        distributed.Client(cluster) as client,
    ):
        processes = list(client.run(os.getpid).values())
        assert_same_runs(tmp_path, client.get_executor(), lambda: processes[0])


def none_missing(results, total):
    assert total == 0
    return results


def test_a_study_whose_workers_are_always_killed_ends_with_the_remedy():
    with pytest.raises(OSError, match=r"ended 3 times.*fewer --workers"):
        list(completed_results(_ended, range(3), 2))


def test_runs_are_stored_as_they_are_completed(tmp_path):
    files = [ResultRunFile(tmp_path, ["a"], {"a": 1})]
    given = complete_result_files(
        files, 3, _late_first, lambda _, index: (str(tmp_path), index), processes=2
    )
    assert list(given) == [[0, 1, 2]]
    stored = [json.loads(line)[0] for line in files[0].path.read_bytes().splitlines()[1:]]
    assert sorted(stored) == [0, 1, 2] and stored[0] == 1


def test_a_file_of_others_with_the_name_of_runs_stays(tmp_path):
    path = ResultRunFile(tmp_path, ["a"], {"a": 1}).path
    path.write_text("an evening's work")
    with pytest.raises(ValueError, match="is not a run"):
        ResultRunFile(tmp_path, ["a"], {"a": 1})
    assert path.read_text() == "an evening's work"
