"""Reproductions: closed forms, what tables and scenes give, and the command."""

import csv
import dataclasses
import itertools
import math
import sys
from types import ModuleType

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import norm
from support.builders import detections

from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.studies.assignment import Pairs, nearest_first
from tsepm_ros.studies.reproduction import environment_2018 as environment
from tsepm_ros.studies.reproduction import (
    monte_carlo,
    sequential_2014,
    split_merge_2016,
    tsepm_2018,
)
from tsepm_ros.studies.reproduction.monte_carlo import Started
from tsepm_ros.studies.reproduction.report import (
    SOURCES,
    Line,
    Panel,
    Picture,
    Setting,
    Table,
    write,
)
from tsepm_ros.studies.reproduction.sequential_2014 import MAIN, Counts
from tsepm_ros.studies.split_merge import SplitMerge, SplitMergeOptions
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.evaluation.intervals import Estimate
from tsepm_ros.tools.evaluation.simulated_run import SimulatedScene
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracker import Tracker

ROWS = {row.name: row for row in monte_carlo.TABLE_1}
LOW_IN_PRINT = {"4/6", "4/7"}
NO_GATE_FITS = {"4/7", "5/9", "7/9"}


@pytest.mark.parametrize("name", sorted(LOW_IN_PRINT))
def test_one_factor_too_many_explains_the_rows_that_the_closed_form_misses(name):
    assert tsepm_2018.detection_with_slip(ROWS[name]) == pytest.approx(
        ROWS[name].detection, abs=1e-4
    )


def test_rows_that_fit_no_reading_or_cannot_be_compared_are_named_and_print_is_rounded():
    assert set(tsepm_2018.unmatched_detection()) == LOW_IN_PRINT
    assert set(tsepm_2018.unmatched_false_before()) == NO_GATE_FITS
    assert tsepm_2018._log_distance(near_print(1.5)) == pytest.approx(np.log(1.5))
    values = near_print(1.5)
    values[0] = Estimate(0.0, 0.0, 0.1)
    values[1] = Estimate(3.0 * monte_carlo.TABLE_1[1].false_after, 0.0, 1.0)
    assert set(ROWS) - set(tsepm_2018._log_ratios(values)) == {"3/4", "7/9", "8/9"}
    nothing = near_print(0.0)
    assert tsepm_2018._log_distance(nothing) == np.inf


def near_print(factor, half_width=0.0):
    """P_F(2) a factor from print, with intervals of some half width."""
    values = [factor * row.false_after for row in monte_carlo.TABLE_1]
    return [Estimate(value, value - half_width, value + half_width) for value in values]


def test_the_fixed_margin_gates_as_errors_of_that_size_would():
    """Where all errors are the same, Eq. 4's margin is the fixed one, so that nothing differs."""
    same = list(monte_carlo.table_1_cases().values())[2]
    fixed = dataclasses.replace(same, method="fixed margin")
    scene = SimulatedScene.drawn(same.scenario, [1, 0])
    row = ROWS["3/4"]
    counts = [
        monte_carlo._table_1_counts(scene, row, "squared", case.method) for case in (same, fixed)
    ]
    assert counts[0][monte_carlo.Counted.WRONG] > 0
    assert counts[0][:6] == pytest.approx(counts[1][:6], rel=0.02)
    stated, with_margin = list(monte_carlo.table_1_cases().values())[:2]
    assert stated.scenario == with_margin.scenario and with_margin.method == "fixed margin"


def distances_by_hand(method, hits, used):
    """The distance of each hit from the line through the hits that may be used, by matrices."""
    largest = np.zeros(len(hits))
    for row, track in enumerate(hits):
        for place, hit in enumerate(track):
            others = used(track, place)
            if len(others) < 2:
                continue
            designs, weights = [], []
            for other in (*others, hit):
                one = np.zeros((2, 4))
                time = other["time"] - method.stamp
                one[0, :2] = one[1, 2:] = 1.0, time
                designs.append(one)
                weights.append(other["covariance"])
            design = np.concatenate(designs[:-1])
            inverse = np.linalg.pinv(design)
            state = inverse @ np.concatenate([other["position"] for other in others])
            errors = block_diag(*weights[:-1])
            covariance = designs[-1] @ inverse @ errors @ inverse.T @ designs[-1].T + weights[-1]
            misfit = hit["position"] - designs[-1] @ state
            value = misfit @ np.linalg.solve(covariance, misfit)
            largest[row] = max(largest[row], value)
    return largest


@pytest.mark.parametrize(
    ("kind", "used"),
    [
        (monte_carlo.Predicted, lambda track, place: np.delete(track, place)),
        (monte_carlo.PredictedByEarlier, lambda track, place: track[:place]),
    ],
)
def test_a_hit_is_predicted_from_hits_without_it(kind, used):
    options = TsepmOptions(min_hits=5, window=8)
    method = kind(SensorModel(), CommonOptions(), options)
    rng = np.random.default_rng(1)
    times = np.sort(rng.uniform(0.0, 90.0, (20, 5)), axis=1)
    places = np.array([4000.0, 3000.0]) + rng.normal(0.0, 300.0, (20, 5, 2))
    hits = detections(places, times, variance=1e4)
    ids = method.detections.append(hits.ravel()).reshape(20, 5)
    method.stamp = 90.0
    candidates = method.estimated(ids)
    expected = distances_by_hand(method, hits, used)
    np.testing.assert_allclose(candidates.evaluation, expected, rtol=1e-6)
    np.testing.assert_allclose(candidates.distance, expected, rtol=1e-6)


def test_a_merged_group_may_be_judged_by_any_of_its_members():
    """In clutter of 3e-6 merging hides true members behind a better fit of false ones."""
    runs = [monte_carlo.run_comparison(monte_carlo.DENSITIES[3e-6], [1, run]) for run in range(3)]
    for run in runs:
        found, _, _, by_any, reached, left = run["tsepm, f1 literal"]
        assert by_any >= found
        assert reached >= left > 0
        errors = np.reshape(run["weights"], (-1, len(monte_carlo.WEIGHTS)))
        assert np.isfinite(errors).all()
    assert sum(run["tsepm, f1 squared"][3] for run in runs) == 3


def test_the_gate_is_hit_as_often_as_by_simulation_and_falls_below_what_is_claimed():
    rng = np.random.default_rng(3)
    error, n = 120.0, 200_000
    sensor = tsepm_2018.sensor_at(error)
    target = np.array([[5000.0, 5000.0], [5060.0, 5000.0]])
    range_ = np.hypot(*target.T) * (1 + sensor.range_std_fraction * rng.standard_normal((n, 2)))
    azimuth = np.arctan2(*target.T[::-1]) + sensor.azimuth_std * rng.standard_normal((n, 2))
    x, y = range_ * np.cos(azimuth), range_ * np.sin(azimuth)
    inside = np.hypot(*np.diff([x, y], axis=2)[..., 0]) <= 120.0 + 2.146 * error
    # Five standard errors, and what linearising the polar errors leaves.
    assert tsepm_2018.gate_hit_probability(error) == pytest.approx(inside.mean(), abs=4e-3)
    falling = [tsepm_2018.gate_hit_probability(error) for error in (15.0, 75.0, 120.0, 300.0)]
    assert all(one > other for one, other in itertools.pairwise(falling))
    assert falling[-1] < monte_carlo.GATE_PROBABILITY


def test_tracks_of_table_i_merge_by_sets():
    """Conditions (i) and (iii) by Python's sets, groups by walks from pair to pair."""
    tracks = {index: set(hits) for index, hits in split_merge_2016.TABLE_I.items()}
    assert all(len(hits) == 5 for hits in tracks.values())
    pairs = [
        [max(one)[0] == max(two)[0] and len(one & two) > 2.5 for two in tracks.values()]
        for one in tracks.values()
    ]
    reached = np.linalg.matrix_power(np.array(pairs, float), len(pairs)) > 0.0
    expected = {frozenset(np.array(list(tracks))[row].tolist()) for row in reached}
    assert {frozenset(group) for group in split_merge_2016.table_i_groups()} == expected
    assert len(expected) == 5


def test_the_text_s_pairs_meet_the_conditions_and_leave_eight():
    assert all(split_merge_2016.may_merge(*pair) for pair in split_merge_2016.SAID_TO_MERGE)
    assert not any(split_merge_2016.may_merge(*pair) for pair in split_merge_2016.SAID_NOT_TO_MERGE)
    left = split_merge_2016.AFTER_SPLITTING - len(split_merge_2016.disjoint_pairs())
    assert left == split_merge_2016.AFTER_MERGING
    assert split_merge_2016.chained() == 7


def test_split_only_puts_out_every_raw_confirmation():
    scenario = load_scenario("four_targets", {"scans": 8})
    counts = split_merge_2016.run_four_targets(scenario, [1, 0])
    starter = Tracker(SplitMerge(scenario.sensor, CommonOptions(), SplitMergeOptions()))
    merged = Started.on(SimulatedScene.drawn(scenario, [1, 0]), starter, 8)
    assert counts["merged"][0] == len(merged.tracks)
    assert counts["split"][0] == starter.totals.raw_confirmations > len(merged.tracks)
    assert sum(counts["split areas"]) < counts["split"][0]
    assert (np.array(counts["split near"]) <= counts["split areas"]).all()


@dataclasses.dataclass(frozen=True)
class ToyCase:
    scale: float


def toy_run(case, seed):
    return {"value": [case.scale * seed[1], float(seed[0])]}


def test_an_interrupted_reproduction_goes_on_where_it_stopped(tmp_path):
    done = []

    def count(runs, total):
        for one in runs:
            done.append(total)
            yield one

    cases = [ToyCase(1.0), ToyCase(10.0)]
    first = Setting(folder=tmp_path, runs=2, seed=7, progress=count)
    first.results(toy_run, cases)
    assert done == [4] * 4
    for path in tmp_path.iterdir():  # as a killed process leaves it
        path.write_bytes(path.read_bytes()[:-3])
    done.clear()
    results = dataclasses.replace(first, runs=3).results(toy_run, cases)
    assert done == [4] * 4  # the cut line and the new run of each case
    assert [[run["value"] for run in runs] for runs in results] == [
        [[0.0, 7.0], [1.0, 7.0], [2.0, 7.0]],
        [[0.0, 7.0], [10.0, 7.0], [20.0, 7.0]],
    ]
    done.clear()
    dataclasses.replace(first, seed=8).results(toy_run, cases)
    assert done == [4] * 4


def test_ratios_cover_the_truth_as_often_as_said():
    """400 trials: the share of 95 % intervals that cover, within 4 standard errors."""
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(400):
        starts = rng.poisson(20.0, 50)
        one = tsepm_2018.ratio(rng.poisson(0.3 * starts), starts)
        covered += one.low <= 0.3 <= one.high
    assert covered / 400 == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 400))


def test_a_ratio_without_an_event_has_a_bound_and_one_without_a_whole_is_unknown():
    none = tsepm_2018.ratio([0, 0], [10, 20])
    assert (none.value, none.low) == (0.0, 0.0)
    assert none.high == pytest.approx(3.689 / 30, rel=1e-3)
    assert np.isnan(tsepm_2018.ratio([0, 0], [0, 0]).value)


def toy_source(setting):
    [runs] = setting.results(toy_run, [ToyCase(2.0)])
    rows = [["mean", Estimate(1.0, 0.5, 1.5)], ["runs", len(runs)]]
    return [
        "A text.",
        Table("toy", {"what": "", "figure": ".2f"}, rows),
        Picture("toy", "A picture", [Panel([Line([0, 1], [1, 2], "a line")])]),
    ]


def test_a_source_is_one_line_of_the_registry(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    monkeypatch.setitem(SOURCES, "toy", "Toy 1999")
    module = ModuleType("tsepm_ros.studies.reproduction.toy")
    monkeypatch.setattr(module, "reproduce", toy_source, raising=False)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    arguments = ["reproduce", "toy", "--runs", "3", "--seed", "4", "--workers", "1"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    text = (tmp_path / "report.md").read_text()
    assert "## Toy 1999" in text
    assert "tsepm reproduce toy --runs 3 --seed 4" in text
    assert "3 runs, seed 4" in text
    assert "| mean | 1.00 |" in text
    assert list(csv.reader((tmp_path / "toy.csv").open())) == [
        ["what", "figure", "figure, low", "figure, high"],
        ["mean", "1.0", "0.5", "1.5"],
        ["runs", "3", "", ""],
    ]
    assert (tmp_path / "toy.png").read_bytes().startswith(b"\x89PNG")
    assert "report.md" in capsys.readouterr().out


def test_without_matplotlib_the_report_says_that_there_are_no_pictures(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    picture = Picture("toy", "A picture", [])
    write([picture], tmp_path / "report.md")
    assert not list(tmp_path.glob("*.png"))
    assert "needs matplotlib" in (tmp_path / "report.md").read_text()


@pytest.mark.long
def test_tables_and_pictures_are_written(tmp_path):
    pytest.importorskip("matplotlib")
    setting = Setting(folder=tmp_path / "runs", runs=1)
    errors = {error: monte_carlo.ERRORS[error] for error in (15.0, 75.0, 120.0)}
    densities = dict(list(monte_carlo.DENSITIES.items())[:2])
    parts = [
        *tsepm_2018.reproduce(setting, densities, errors),
        *split_merge_2016.reproduce(setting),
    ]
    write(parts, tmp_path / "report.md")
    text = (tmp_path / "report.md").read_text()
    for name in ("figures_5_6", "figures_7_8"):
        assert f"(tsepm_2018_{name}.png)" in text
        assert (tmp_path / f"tsepm_2018_{name}.png").exists()
    with (tmp_path / "tsepm_2018_table_1_before.csv").open() as file:
        rows = list(csv.reader(file))
    assert [row[0] for row in rows[1:]] == list(ROWS)
    assert "the rows 4/6 and 4/7 are lower in print" in text
    assert "4/7, 5/9, 7/9 fit no g" in text
    with (tmp_path / "tsepm_2018_figures_5_6.csv").open() as file:
        heading, *rows = csv.reader(file)
    assert [float(row[0]) for row in rows] == list(densities)
    assert {f"{curve}: {what}" for curve in monte_carlo.CURVES for what in ("P_D", "P_F")} <= {
        *heading
    }


TIMES = np.arange(0.0, 240.0, 0.01)


def distances():
    """Distance of the targets over time, by complex numbers: bearings are clockwise from north."""
    courses = []
    for distance, azimuth, speed, heading in environment.ENCOUNTER:
        begin, step = (np.exp(1j * np.radians(90.0 - angle)) for angle in (azimuth, heading))
        courses.append(distance * begin + speed * step * TIMES)
    return np.abs(courses[1] - courses[0])


def test_one_combination_of_the_readings_does_what_the_text_says_not_the_printed_one():
    apart = distances()
    closest = float(TIMES[apart.argmin()])
    assert apart.min() == pytest.approx(188.6, abs=0.1)
    states, times = environment.encounter(), np.arange(0.0, 240.0, 0.5)
    right = []
    for reading in itertools.product(environment.SLOPES, environment.ANGLES, environment.SIGNS):
        values = environment.time_of_closest_approach(states, times, reading)
        if environment.holds(times, values, closest) == "holds":
            right.append(", ".join(reading))
            np.testing.assert_allclose(values, closest - times, atol=0.01)
    assert right == ["phi_r from y, with quadrants, with a minus instead of bars"]
    printed = environment.PICTURED["as printed"]
    assert (environment.time_of_closest_approach(states, times, printed) >= 0.0).all()


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ([2.0, 1.0, -1.0, -2.0], "holds"),
        ([2.0, 1.0, 1.0, 2.0], "does not hold"),
        ([-2.0, -1.0, -1.0, -2.0], "does not hold"),
        ([1.0, 2.0, -1.0, -2.0], "does not hold"),
        ([2.0, 1.0, -2.0, -1.0], "does not hold"),
    ],
    ids=["described", "bars", "sign", "grows before", "shrinks after"],
)
def test_the_description(values, verdict):
    assert environment.holds(np.arange(4.0), np.array(values), 1.5) == verdict


def test_the_published_distances_need_one_plot_per_track():
    each, pairs = environment.smallest(np.array(environment.ENVIRONMENT_TABLE_1))
    assert each.tolist() == [False, True]
    assert pairs


def test_the_smallest_pair_first_is_the_package_s():
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(50):
        table = rng.random((2, 2))
        chosen = nearest_first(Pairs(np.array([0, 1, 0, 1]), np.array([0, 0, 1, 1]), table.ravel()))
        straight = bool((chosen.parent == chosen.row).all())
        assert environment.smallest(table)[1] == straight
        seen.add(straight)
    assert seen == {True, False}


def test_the_printed_decision_by_hand():
    # Mean (2, 4) of three plots; with (6, 8) it is (3, 5): 1 + 1.
    history = np.array([[1.0, 4.0], [2.0, 4.0], [3.0, 4.0]])
    assert environment.decision(history, np.array([6.0, 8.0])) == pytest.approx(2.0)


def test_the_printed_decision_shrinks_with_the_history():
    # As printed no threshold fits a short and a long history: why it is not what is used.
    rng = np.random.default_rng(1)
    short, long = rng.standard_normal((500, 3, 3)), rng.standard_normal((500, 30, 3))
    candidate = rng.standard_normal((500, 3))
    assert (
        environment.decision(short, candidate).mean()
        > 30 * environment.decision(long, candidate).mean()
    )


@pytest.mark.parametrize("offset", [0.5, 1.0, 2.0])
def test_long_histories_decide_as_known_means_do(offset):
    """Within 4 standard errors of Phi(d / 2), d the distance of the means."""
    trials = 4000
    made = environment.decide(np.random.default_rng(1), trials, offset, (300, 300))
    share = norm.cdf(0.5 * offset * np.sqrt(environment.FEATURES))
    error = np.sqrt(share * (1.0 - share) / trials)
    assert made[0].value == pytest.approx(share, abs=4.0 * error + 1e-3)


def test_a_longer_history_draws_all_plots():
    equal, unlike = (
        environment.decide(np.random.default_rng(1), 1000, 1.0, histories)
        for histories in ((10, 10), (30, 5))
    )
    assert equal[0].low > 0.75
    assert unlike[0].high < 0.55


def test_the_command_writes_the_chapter(tmp_path):
    pytest.importorskip("matplotlib")
    assert main(["reproduce", "environment_2018", "--runs", "2", "--out", str(tmp_path)]) == 0
    text = (tmp_path / "report.md").read_text()
    assert "closest after 122.7 s, 189 m apart" in text
    assert "gives the published decision" in text
    assert (tmp_path / "environment_2018_figure_4.png").exists()
    rows = (tmp_path / "environment_2018_table_1.csv").read_text().splitlines()
    assert len(rows) == 1 + len(environment.OFFSETS) * len(environment.HISTORIES)


def test_the_scene_is_the_published_one():
    targets = np.array(sequential_2014.hexagon(np.random.default_rng(1)))
    place = targets[:, 0::2]
    np.testing.assert_allclose(np.hypot(*place.T), 6000.0)
    np.testing.assert_allclose(np.hypot(*(place - np.roll(place, 1, axis=0)).T), 6000.0)
    np.testing.assert_allclose(np.hypot(*targets[:, 1::2].T), 5.0)
    scenario = sequential_2014.hexagon_case(12.0, 0.9)
    assert scenario.duration == 120.0
    assert scenario.sensor.clutter_density * scenario.area == pytest.approx(30.0)
    assert scenario.own_ship.pose(50.0)[:2].tolist() == pytest.approx([0.0, -200.0])
    assert scenario.own_ship.pose(150.0)[:2].tolist() == pytest.approx([200.0, 0.0], abs=1.0)


def test_targets_without_errors_are_started_by_every_reading_in_the_sixth_scan():
    one = sequential_2014.hexagon_case(12.0, 1.0)
    exact = dataclasses.replace(
        one.sensor, range_std_fraction=1e-6, azimuth_std=1e-6, clutter_density=1e-12
    )
    counts = sequential_2014.run_hexagon(dataclasses.replace(one, sensor=exact), [1, 0])
    for gate, matching in sequential_2014.MATCHED:
        for kind in ("true", "all"):
            assert counts[f"{gate}, {matching}: {kind}"] == [0.0] * 5 + [6.0] * 6
    for name in sequential_2014.ESTIMATORS:
        errors = np.reshape(counts[name], (6, 4))
        assert np.abs(errors).max() < 0.1
    assert counts["pure"] == [1.0] * 6


def counts(period, rows):
    array = np.array(rows, float)
    return Counts(period, 0.9, *sequential_2014.DEFAULT_READING, array, array)


def test_times_become_scans():
    one = counts(12.0, [np.arange(11)])
    # Seventy-two seconds: the sixth scan if the first takes an interval, else the seventh.
    assert [mean.value for mean in one.formed(one.true)] == [5, 6, 7, 8, 9]
    assert [mean.value for mean in one.formed(one.true, earlier=True)] == [6, 7, 8, 9, 10]
    shorter = counts(8.0, [np.arange(16)])
    assert [mean.value for mean in shorter.formed(shorter.true)] == [8, 9, 11, 12, 14]
    like = counts(12.0, [[0] * 5 + list(sequential_2014.FORMED) + [6.0]])
    assert like.distance() == 0.0
    assert sequential_2014.closest([one, like]) is like
    assert counts(12.0, [[6] * 11] * 3 + [[5] * 11]).at_least(6).value == 0.75


def test_the_published_speed_error_is_below_the_bound():
    closed = math.sqrt(2.0 / math.pi) * 90.0 / (12.0 * math.sqrt(82.5))
    assert sequential_2014.min_speed_error(10, 12.0) == pytest.approx(closed, rel=1e-3)
    assert closed > sequential_2014.TABLE_1["least_squares"][1]


@pytest.mark.long
def test_the_chapter_is_written(tmp_path):
    pytest.importorskip("matplotlib")
    setting = Setting(folder=tmp_path / "runs", runs=3)
    parts = sequential_2014.reproduce(setting, {MAIN: sequential_2014.hexagon_case(*MAIN)})
    write(parts, tmp_path / "report.md")
    rows = list(csv.reader((tmp_path / "sequential_2014_starts.csv").open()))
    assert rows[1][:4] == ["-", "-", "-", "published"]
    assert {(row[2], row[3]) for row in rows[2:]} == set(sequential_2014.MATCHED)
    errors = list(csv.reader((tmp_path / "sequential_2014_table_1.csv").open()))
    assert [row[2] for row in errors[1:4]] == ["82.3", "114.5", "210.6"]
    others = list(csv.reader((tmp_path / "sequential_2014_conventional.csv").open()))
    assert [row[0] for row in others[1:]] == list(sequential_2014.CONVENTIONAL)
    assert float(others[-1][1]) > 3.0, "the method of the source starts its targets"
    for name in ("figures_8_9", "figures_10_11"):
        assert (tmp_path / f"sequential_2014_{name}.png").exists()


def test_runs_depend_on_the_seed_and_the_run_alone(tmp_path):
    setting = Setting(folder=tmp_path / "one", runs=2, seed=3)
    again = dataclasses.replace(setting, folder=tmp_path / "other", runs=1)
    [first], [second] = (
        one.results(sequential_2014.run_hexagon, [sequential_2014.hexagon_case(*MAIN)])
        for one in (setting, again)
    )
    assert first[0] == second[0] != first[1]
