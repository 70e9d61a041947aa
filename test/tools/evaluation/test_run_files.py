"""Summaries of runs, and their files: found again only by what they belong to."""

import dataclasses
import json

import numpy as np
import pytest
from support.run_summaries import run_of, start

from tsepm_ros import ConfirmedTrack
from tsepm_ros.methods.registry import available_methods
from tsepm_ros.tools.evaluation.measures import RunSummary, measures_of, start_bound, summarise
from tsepm_ros.tools.evaluation.performance import run, run_file
from tsepm_ros.tools.evaluation.result_files import (
    Result,
    RunFile,
    read_result,
    write_result,
)
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint, Outcome, SimulatedRun, simulate
from tsepm_ros.tools.simulation import Scenario, load_scenario

BOX = load_scenario("box")
POINT = OperatingPoint("score", "1/h", {"false_tracks_per_hour": 1.0}, version="1")
SUMMARIES = {0: run_of(), 1: run_of(start(2), false=(0, 1, 0, 2)), 4: run_of(start(1))}
RECORDS = {index: summary.as_json() for index, summary in SUMMARIES.items()}


@pytest.fixture
def file(tmp_path) -> RunFile:
    made = run_file(tmp_path, BOX, POINT, 1)
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
    found = run_file(tmp_path, **{"scenario": BOX, "point": POINT, "seed": 1, **other})
    assert found.path != file.path
    assert found.results == {}
    assert run_file(tmp_path, BOX, POINT, 1).results == RECORDS


def test_what_is_cut_off_is_written_again_and_other_damage_is_refused(file, tmp_path):
    content = file.path.read_bytes()
    lines = content.splitlines(keepends=True)
    file.path.write_bytes(b"".join([*lines[:2], b'[1, {"tar\n', *lines[3:]]))
    with pytest.raises(ValueError, match="is damaged"):
        run_file(tmp_path, BOX, POINT, 1)
    file.path.write_bytes(content[:20])
    assert run_file(tmp_path, BOX, POINT, 1).results == {}
    assert file.path.read_bytes() == lines[0]
    file.path.replace(run_file(tmp_path, BOX, POINT, 2).path)
    with pytest.raises(ValueError, match="was made by another version"):
        run_file(tmp_path, BOX, POINT, 2)


@pytest.mark.parametrize(
    "line", ["5", "[1]", '["a", {}]', "null", '{"a": 1}', "[" * 100_000, "[true, 1]"]
)
def test_a_line_that_is_no_run_is_named(tmp_path, line):
    file = RunFile(tmp_path, ["box"], {"version": 1})
    file.append(0, {"a": 1})
    with file.path.open("a") as content:
        content.write(line + "\n")
    with pytest.raises(ValueError, match=r"is damaged: .* is not a run") as error:
        RunFile(tmp_path, ["box"], {"version": 1})
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


MANY = {
    "tsepm": {"min_hits": 3, "window": 4},
    "score": {"false_tracks_per_hour": 300.0},
    "sequential": {"min_hits": 3, "window": 4},
    "heuristic": {"gate_sigmas": 2.0, "max_acceleration": 2.0},
    "modified_hough": {"min_hits": 3, "window": 4, "gate_sigmas": 2.0},
}
MOVING = load_scenario(
    "box", {"scans": 8, "sound_speed": 1500.0, "own_ship.speed": 8.0, "own_ship.turn_rate": 0.01}
)


def point(method: str) -> OperatingPoint:
    return OperatingPoint(method, options=MANY.get(method, {}))


@pytest.mark.long
@pytest.mark.parametrize("method", available_methods())
def test_a_prefix_of_a_run_is_the_run_with_fewer_scans(method):
    started = np.zeros(2)
    for seed in range(3):
        long = run((load_scenario("box", {"scans": 12}), [3, seed], point(method)))
        short = run((load_scenario("box", {"scans": 7}), [3, seed], point(method)))
        assert long.first(7).as_json() == short.as_json()
        assert short.count(*Outcome) > 0
        started += long.count(*Outcome), short.count(*Outcome)
    assert started[0] > started[1]


def test_a_record_comes_back_from_json_to_the_bit():
    kept = run((MOVING, [3, 1], point("tsepm")))
    assert any(not one.pure for one in kept.starts)  # these have nan
    text = json.dumps(kept.as_json(), allow_nan=False)
    again = RunSummary.from_json(json.loads(text))
    assert repr(again) == repr(kept)


class Seer:
    """Starts a track at the target from all its echoes so far, and holds what it is told to."""

    def __init__(self, scenario: Scenario, held: list) -> None:
        self.scenario = scenario
        self.maintenance = self
        self.current = self
        self.state = np.array(held, float).reshape(-1, 4)

    def process(self, scan):
        return []


def held_at(*held) -> RunSummary:
    sensor = {"sensor.clutter_density": 1e-20, "scans": 1}
    scene = load_scenario("box", sensor)
    seen = OperatingPoint("seer", options={}, factory=lambda one, *_: Seer(one, list(held)))
    return run((scene, [1, 1], seen))


def test_what_is_held_is_compared_with_the_truth():
    # The target is 7071 m away: 3 sigma of 1 degree are 370 m.
    assert held_at().scans[0].held == 0
    assert held_at([5000.0, 0.0, 5300.0, 0.0], [0.0, 0.0, 0.0, 0.0]).scans[0].held == 1
    assert held_at([5000.0, 0.0, 5400.0, 0.0]).scans[0].held == 0


def test_a_start_on_hits_of_others_or_of_one_scan_has_no_bound():
    made = simulate(MOVING, [3, 2], point("tsepm"))
    mixed = next(one for one in made.judged() if one.target == 0 and not one.pure)
    assert np.isnan(start_bound(made, mixed)).all()
    scan, row = next(
        (scan, list(origin).index(0)) for scan, origin in enumerate(made.origins) if 0 in origin
    )
    truth = made.simulator.truth(made.scans[scan].stamp)[0]
    start = ConfirmedTrack(0, made.scans[scan].stamp, truth, np.eye(4), ((scan, row),), 0.0)
    made.starts = [(scan, start)]
    (alone,) = SimulatedRun.judged(made)
    assert alone.pure
    assert np.isnan(start_bound(made, alone)).all()


class Corrector:
    """Starts on clutter at the target's place, and corrects the start two scans later."""

    def __init__(self, scenario: Scenario) -> None:
        self.revised: list[ConfirmedTrack] = []
        self.count = 0

    def process(self, scan):
        self.count += 1
        self.revised = [self.track(revision=1)] if self.count == 7 else []
        return [self.track()] if self.count in (2, 5) else []

    def track(self, revision: int = 0) -> ConfirmedTrack:
        state = np.array([5000.0, 5.0, 5000.0, 0.0])
        hits = ((self.count - 1, 0),) if revision else ((0, 0),)
        stamp = 12.0 * (self.count - 1)
        return ConfirmedTrack(0, stamp, state, 1e4 * np.eye(4), hits, 0.0, revision=revision)


def test_only_revision_0_counts_and_what_was_before_the_targets_does_not():
    changes = {"sensor.detection_probability": 1.0, "scans": 4, "warm_up": 3}
    made = simulate(
        load_scenario("box", {**changes, "sensor.clutter_density": 1e-6}),
        [3, 1],
        OperatingPoint("corrector", options={}, factory=lambda one, *_: Corrector(one)),
    )
    # The correction's hit is the target's.
    made.origins[6][0] = 0
    kept = summarise(made)
    assert [scan.false for scan in kept.scans] == [0, 1, 0, 0]
    assert [scan.at for scan in kept.scans] == [0, 1, 1, 1]
    assert [scan.corrections for scan in kept.scans] == [0, 0, 0, 1]
    assert [scan.right for scan in kept.scans] == [0, 0, 0, 1]
    assert kept.starts == ()
    measures = measures_of(made.scenario, [kept])
    assert (measures.detection.value, measures.detection_by_position.value) == (0.0, 1.0)
    assert (measures.detection_corrected.value, measures.corrections_per_run.value) == (1.0, 1.0)
    assert measures_of(made.scenario, [kept], 1).detection_by_position.value == 0.0
