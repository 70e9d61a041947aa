"""Evaluations: interrupted ones go on, and the tables say what was found."""

import csv
import dataclasses
import io
import json
import math

import numpy as np
import pytest

from tsepm_ros import ConfirmedTrack
from tsepm_ros.tools.evaluation.measures import HEADINGS
from tsepm_ros.tools.evaluation.performance import Plan, evaluate, markdown, write_csv
from tsepm_ros.tools.evaluation.simulated_run import OperatingPoint
from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.simulation import load_scenario

BOX = load_scenario("box", {"scans": 7})
SCORE = OperatingPoint("score", "300/h", {"false_tracks_per_hour": 300.0})
TSEPM = OperatingPoint("tsepm", "3/4", {"min_hits": 3, "window": 4})


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


TOY = OperatingPoint("toy", "nearest", {"min_range": 0.0}, make_toy)


def plan(*points, runs=4, **more) -> Plan:
    return Plan(scenarios=[BOX], points=points or [SCORE, TSEPM], runs=runs, seed=5, **more)


def tables(what: Plan, folder, **more) -> tuple[str, str]:
    evaluated = evaluate(what, folder, **more)
    file = io.StringIO()
    write_csv(what, evaluated, file)
    return markdown(what, evaluated, "command"), file.getvalue()


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
        evaluate(plan(), tmp_path, progress=stop_after_five)
    assert sorted(lines(tmp_path).values()) == [2, 5]  # with the header
    left = []
    found = tables(plan(), tmp_path, progress=lambda runs, total: (left.append(total), runs)[1])
    assert left == [3]
    assert found == expected


@pytest.mark.long
def test_a_killed_process_costs_the_run_that_it_was_writing(tmp_path, expected):
    evaluate(plan(), tmp_path)
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:-30])
    assert tables(plan(), tmp_path) == expected


def test_two_workers_give_the_same_tables_as_one(tmp_path, expected):
    assert tables(plan(), tmp_path, workers=Workers(processes=2)) == expected


@pytest.mark.long
def test_horizons_give_what_shorter_evaluations_give(tmp_path):
    at_5, at_7 = evaluate(plan(horizons=[5]), tmp_path)
    (alone,) = evaluate(
        dataclasses.replace(plan(), scenarios=[load_scenario("box", {"scans": 5})]), tmp_path
    )
    assert (at_5.scans, at_7.scans) == (5, 7)
    assert repr(at_5.measures) == repr(alone.measures)
    assert repr(at_5.measures) != repr(at_7.measures)


def test_anything_that_starts_tracks_can_be_evaluated(tmp_path):
    (found,) = evaluate(plan(TOY, TSEPM), tmp_path, Workers(processes=2))
    toy = found.measures[0]
    assert toy.detection.value > 0.5  # its one hit is the target's
    assert toy.false_per_run.value > 0.0  # but when the target was missed
    assert toy.redundant_per_run.value > 1.0
    for name in ("nees", "held", "gospa", "position_to_bound"):
        assert math.isnan(getattr(toy, name).value)
    assert not math.isnan(toy.pure_position_error.value)
    assert {(one.method, one.other) for one in found.comparisons} == {
        ("toy", "tsepm"),
        ("tsepm", "toy"),
    }
    assert "| toy | nearest |" in markdown(plan(TOY, TSEPM), [found], "command")


def test_a_refused_option_is_refused_before_any_run(tmp_path):
    wrong = OperatingPoint("tsepm", "wrong", {"min_hits": 9, "window": 8})
    with pytest.raises(ValueError, match="window must be at least min_hits"):
        evaluate(plan(SCORE, wrong), tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"horizons": [8]}, "horizon 8 is beyond the 7 scans of box"),
        ({"scenarios": [BOX, BOX]}, "box is given twice"),
        ({"points": [SCORE, SCORE]}, "score 300/h is given twice"),
    ],
    ids=["horizon", "scenario", "point"],
)
def test_plans_that_cannot_be_told_apart_or_done_are_refused(change, said):
    with pytest.raises(ValueError, match=said):
        dataclasses.replace(plan(), **change)


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
    assert 0.0 <= float(rows[0]["detection_low"]) < float(rows[0]["detection_high"]) <= 1.0
