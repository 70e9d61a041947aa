"""Sequential 2014: its scene, the readings of its matching, and what its figures allow."""

import csv
import dataclasses
import math

import numpy as np
import pytest
from scipy.stats import binom

from tsepm_ros.studies.reproduction import monte_carlo, sequential_2014
from tsepm_ros.studies.reproduction import published as published
from tsepm_ros.studies.reproduction.report import Setting, write
from tsepm_ros.studies.reproduction.sequential_2014 import MAIN, Counts


def test_the_scene_is_the_published_one():
    targets = np.array(monte_carlo.hexagon(np.random.default_rng(1)))
    place = targets[:, 0::2]
    np.testing.assert_allclose(np.hypot(*place.T), 6000.0)
    np.testing.assert_allclose(np.hypot(*(place - np.roll(place, 1, axis=0)).T), 6000.0)
    np.testing.assert_allclose(np.hypot(*targets[:, 1::2].T), 5.0)
    scenario = monte_carlo.hexagon_case(12.0, 0.9)
    assert scenario.duration == 120.0
    assert scenario.sensor.clutter_density * scenario.area == pytest.approx(30.0)
    assert scenario.own_ship.pose(50.0)[:2].tolist() == pytest.approx([0.0, -200.0])
    assert scenario.own_ship.pose(150.0)[:2].tolist() == pytest.approx([200.0, 0.0], abs=1.0)


def test_targets_without_errors_are_started_by_every_reading_in_the_sixth_scan():
    one = monte_carlo.hexagon_case(12.0, 1.0)
    exact = dataclasses.replace(
        one.sensor, range_std_fraction=1e-6, azimuth_std=1e-6, clutter_density=1e-12
    )
    counts = monte_carlo.run_hexagon(dataclasses.replace(one, sensor=exact), [1, 0])
    for gate, matching in monte_carlo.MATCHED:
        for kind in ("true", "near", "all"):
            assert counts[f"{gate}, {matching}: {kind}"] == [0.0] * 5 + [6.0] * 6
    for name in sequential_2014.ESTIMATORS:
        errors = np.reshape(counts[name], (6, 4))
        assert np.abs(errors).max() < 0.1
    bounds = np.reshape(counts["bound"], (6, 3))
    assert (bounds[:, 2] == 1.0).all()
    assert bounds[:, :2].max() < 1e-3


def counts(period, rows):
    array = np.array(rows, float)
    return Counts(period, 0.9, *monte_carlo.DEFAULT_READING, array, array, array)


def test_times_become_scans():
    one = counts(12.0, [np.arange(11)])
    # Seventy-two seconds: the sixth scan if the first takes an interval, else the seventh.
    assert [mean.value for mean in one.formed(one.true)] == [5, 6, 7, 8, 9]
    assert [mean.value for mean in one.formed(one.true, earlier=True)] == [6, 7, 8, 9, 10]
    shorter = counts(8.0, [np.arange(16)])
    assert [mean.value for mean in shorter.formed(shorter.true)] == [8, 9, 11, 12, 14]
    like = counts(12.0, [[0] * 5 + list(published.FORMED.values()) + [6.0]])
    assert like.distance() == 0.0
    assert sequential_2014.closest([one, like]) is like
    assert counts(12.0, [[6] * 11] * 3 + [[5] * 11]).at_least(6).value == 0.75


def test_the_published_shares_exclude_each_other():
    share = sequential_2014.same_share()
    assert share**6 == pytest.approx(published.ALL_SIX)
    assert sequential_2014.four_or_more(share) == pytest.approx(binom.sf(3, 6, share))
    # Rounded to 1.00 it would be at least 0.995.
    assert sequential_2014.four_or_more(share) < 0.99
    assert sequential_2014.max_formed() == pytest.approx(5.52)
    assert sequential_2014.max_formed() < published.FORMED[108.0]


def test_no_unbiased_estimate_has_the_published_speed_error():
    closed = math.sqrt(2.0 / math.pi) * 90.0 / (12.0 * math.sqrt(82.5))
    assert sequential_2014.min_speed_error(10, 12.0) == pytest.approx(closed, rel=1e-3)
    assert closed > published.SEQUENTIAL_TABLE_1["least_squares"][1]


@pytest.mark.long
def test_the_chapter_is_written(tmp_path):
    pytest.importorskip("matplotlib")
    setting = Setting(folder=tmp_path / "runs", runs=3)
    parts = sequential_2014.reproduce(setting, {MAIN: monte_carlo.hexagon_case(*MAIN)})
    write(parts, tmp_path / "report.md")
    rows = list(csv.reader((tmp_path / "sequential_2014_starts.csv").open()))
    assert rows[1][:4] == ["-", "-", "published", "-"]
    assert {(row[2], row[3]) for row in rows[2:]} == set(monte_carlo.MATCHED)
    errors = list(csv.reader((tmp_path / "sequential_2014_table_1.csv").open()))
    assert [row[2] for row in errors[1:4]] == ["82.3", "114.5", "210.6"]
    others = list(csv.reader((tmp_path / "sequential_2014_conventional.csv").open()))
    assert [row[0] for row in others[1:]] == list(monte_carlo.CONVENTIONAL)
    assert float(others[-1][1]) > 0.5, "the method of the source starts its targets"
    for name in ("figures_8_9", "figures_10_11"):
        assert (tmp_path / f"sequential_2014_{name}.png").exists()


def test_runs_depend_on_the_seed_and_the_run_alone(tmp_path):
    setting = Setting(folder=tmp_path / "one", runs=2, seed=3)
    again = dataclasses.replace(setting, folder=tmp_path / "other", runs=1)
    [first], [second] = (
        one.results(monte_carlo.run_hexagon, [monte_carlo.hexagon_case(*MAIN)])
        for one in (setting, again)
    )
    assert first[0] == second[0] != first[1]
