"""The spacing of detections: silent in clutter, quick where targets have several echoes."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from plots_scenes import Swimmers, box

from tsepm_ros import SensorModel
from tsepm_ros.tracker.clustering import PlotExtent, grouped
from tsepm_ros.tracker.clutter.seen_extent import Extent, SeenExtent
from tsepm_ros.tracker.multi_detection import (
    INSIDE,
    STRIP_PRIOR,
    DetectionSpacing,
    EchoScatter,
    StripCounts,
)
from tsepm_ros.tracker.scan import Scan

LIMIT = math.log(1e6)


def largest(sensor: SensorModel, scans) -> float:
    spacing, found = DetectionSpacing(sensor), -math.inf
    for scan in scans:
        spacing.observe(scan.range, scan.azimuth)
        found = max(found, spacing.log_ratio)
    return found


@pytest.mark.parametrize("kind", ["uniform", "smooth", "rough", "blocks"])
def test_clutter_of_the_box_looks_like_clutter(kind):
    assert largest(SensorModel(), box(kind, 600, seed=1, redrawn=100)) < LIMIT


@pytest.mark.parametrize("kind", ["uniform", "smooth", "rough", "blocks"])
@pytest.mark.long
def test_clutter_of_the_box_looks_like_clutter_for_long(kind):
    assert largest(SensorModel(), box(kind, 10_000, seed=2)) < LIMIT


@pytest.mark.parametrize("false", [5.0, 50.0, 500.0])
def test_clutter_alone_exceeds_what_one_in_ten_may_at_most_in_one_run_of_ten(false):
    # Ville: the ratio ever exceeds 10 with a probability of 0.1 at most. Of 60 runs 14 or more
    # would have a probability below 0.002. Narrow sector: most boxes are cut to the coverage.
    sensor = SensorModel(max_range=300.0, azimuth_min=-0.2, azimuth_max=0.2)
    above = 0
    for seed in range(60):
        rng = np.random.default_rng([seed, 5])
        scans = []
        for stamp in range(10):
            n = rng.poisson(false / 5.0)
            azimuth = rng.uniform(-0.2, 0.2, n)
            scans.append(Scan(float(stamp), 300.0 * np.sqrt(rng.random(n)) + 1e-3, azimuth))
        above += largest(sensor, scans) > math.log(10.0)
    assert above < 14


@pytest.mark.parametrize("common", [True, False])
def test_several_echoes_are_seen_within_pings(common):
    scene = Swimmers(common=common, pings=25)
    for seed in range(4):
        spacing = DetectionSpacing(scene.sensor)
        found = []
        for ping in scene.draw(seed):
            spacing.observe(ping.scan.range, ping.scan.azimuth)
            found.append(spacing.log_ratio)
        assert max(found[:12]) >= LIMIT
        assert spacing.extent.along <= 4.0


@pytest.mark.parametrize("share", [0.1, 0.02])
def test_in_a_shorter_range_every_length_is_as_much_shorter(share):
    rng = np.random.default_rng(2)
    sea, tank = (
        DetectionSpacing(SensorModel(max_range=100.0 * one, azimuth_min=-1.0, azimuth_max=1.0))
        for one in (1.0, share)
    )
    for _ in range(12):
        range_ = np.append(rng.uniform(1.0, 99.0, 4), 40.0 + rng.uniform(-1.0, 1.0, 3))
        azimuth = np.append(rng.uniform(-1.0, 1.0, 4), rng.uniform(-0.02, 0.02, 3))
        sea.observe(range_, azimuth, reach=5.0)
        tank.observe(share * range_, azimuth, reach=share * 5.0)
    assert tank.log_ratio == pytest.approx(sea.log_ratio, rel=1e-9)
    assert sea.log_ratio > LIMIT
    assert tank.extent.along == pytest.approx(share * sea.extent.along)


def test_what_lies_beyond_the_coverage_does_not_count():
    sensor = SensorModel(max_range=300.0)
    spacing = DetectionSpacing(sensor)
    for _ in range(50):
        spacing.observe(np.array([301.0, 302.0, 303.0]), np.zeros(3))
    assert spacing.log_ratio < 0.0


def test_an_unknown_coverage_is_cut_to_where_clutter_is_seen(monkeypatch):
    # Uniform clutter in a wedge 20 m wide: cut to 9 km all round it would look clustered, were it
    # not as near across the line of sight beside the smaller boxes.
    def draw(seen: SeenExtent | None) -> float:
        rng, spacing = np.random.default_rng(6), DetectionSpacing(SensorModel())
        largest = -math.inf
        for _ in range(40):
            range_, azimuth = 300.0 * np.sqrt(rng.random(12)) + 1.0, rng.uniform(-0.03, 0.03, 12)
            region = None if seen is None else seen.region
            spacing.observe(range_, azimuth, seen=region)
            largest = max(largest, spacing.log_ratio)
            if seen is not None:
                seen.update(range_, azimuth, np.ones(12))
        return largest

    assert draw(SeenExtent(Extent.of(SensorModel()))) < 5.0
    assert draw(None) < 5.0
    monkeypatch.setattr(StripCounts, "concentration", np.ones((4, 16)))
    assert draw(SeenExtent(Extent.of(SensorModel()))) < 5.0
    assert draw(None) > LIMIT


def test_dense_clutter_hides_several_echoes_for_some_pings_only():
    scene = Swimmers(false=200.0, pings=20)
    for seed in range(2):
        spacing = DetectionSpacing(scene.sensor)
        for ping in scene.draw(seed):
            spacing.observe(ping.scan.range, ping.scan.azimuth, reach=5.0)
        assert spacing.log_ratio >= LIMIT


def test_a_hull_is_longer_than_a_plot():
    for hull in (20.0, 40.0):
        scene = Swimmers(echoes=(6, 8), hull=hull, speed=3.0, pings=25)
        spacing = DetectionSpacing(scene.sensor)
        for ping in scene.draw(1):
            spacing.observe(ping.scan.range, ping.scan.azimuth)
        assert spacing.log_ratio >= LIMIT
        assert spacing.hull_extent is not None
    plain = DetectionSpacing(Swimmers().sensor)
    for ping in Swimmers(pings=25).draw(1):
        plain.observe(ping.scan.range, ping.scan.azimuth)
    assert plain.hull_extent is None
    assert DetectionSpacing(SensorModel(), 7.0).hull_extent is None


def test_one_echo_is_never_several():
    scene = Swimmers(echoes=(1, 1), pings=300)
    assert largest(scene.sensor, (ping.scan for ping in scene.draw(1))) < LIMIT


def test_the_given_extent_and_resolution_are_tried_alone():
    sensor = SensorModel(range_resolution=0.5, azimuth_resolution=0.02)
    assert DetectionSpacing(sensor, 7.0).extent == PlotExtent(7.5, 7.0, 0.02)


def test_several_odds_are_tried():
    assert (np.diff(INSIDE) > 0.0).all()
    assert INSIDE[0] > 1.0


@pytest.mark.parametrize("common", [True, False])
@pytest.mark.parametrize("spread", [1.0, 3.0])
def test_the_scatter_tells_errors_from_extent(common, spread):
    scene = Swimmers(common=common, spread=spread, false=0.0, pings=150)
    # Clutter of no density is no sensor's.
    sensor, scatter = replace(scene, false=1.0).sensor, EchoScatter.nothing()
    extent = PlotExtent(8.0, 8.0, 0.1)
    for ping in scene.draw(3):
        label = grouped(ping.scan.range, ping.scan.azimuth, extent)
        scatter = scatter.after(ping.scan, label, sensor)
    errors = scatter.errors(extent)
    assert errors.independent == pytest.approx(0.0 if common else 1.0, abs=0.25)
    assert errors.extent_variance == pytest.approx(
        spread**2 / 16.0, abs=0.15 + 0.3 * spread**2 / 16
    )
    assert scatter.mean_size == pytest.approx(4.0, abs=0.4)


KINDS = "arc", "ring", "spoke", "near"


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_clutter_on_arcs_and_rays_and_near_the_sensor_is_no_target(kind, seed):
    """Side lobes, a sea floor, interference and reverberation, for 300 pings, in even clutter."""
    rng = np.random.default_rng(seed)
    spacing = DetectionSpacing(SensorModel(max_range=300.0))
    largest = -math.inf
    for _ in range(300):
        number, even = rng.poisson(12), rng.poisson(5)
        range_, azimuth = {
            "arc": (100.0 + rng.standard_normal(number), rng.uniform(-1.0, 1.0, number)),
            "ring": (40.0 + 3.0 * rng.standard_normal(number), rng.uniform(-3.1, 3.1, number)),
            "spoke": (300.0 * rng.random(number), 0.5 + 0.01 * rng.standard_normal(number)),
            "near": (1.0 + rng.exponential(15.0, number), rng.uniform(-3.1, 3.1, number)),
        }[kind]
        range_ = np.append(range_, 300.0 * np.sqrt(rng.random(even)))
        azimuth = np.append(azimuth, rng.uniform(-np.pi, np.pi, even))
        spacing.observe(range_, azimuth)
        largest = max(largest, spacing.log_ratio)
    assert largest < LIMIT


def test_detections_in_strips_are_those_of_a_loop():
    rng, shape = np.random.default_rng(5), (3, 4)
    counts, found, expected = StripCounts(shape), np.zeros((2, *shape)), np.zeros((2, *shape))
    for _ in range(5):
        test = np.sort(rng.integers(0, 3, 20))
        near = rng.random((2, 20, 4)) < 0.4
        shares = rng.random((2, 20, 4))
        counts.count(test, tuple(near), tuple(shares))
        found, expected = 0.99 * found, 0.99 * expected
        for fall, of in enumerate(test):
            for extent in range(4):
                for axis in (0, 1):
                    if not near[1 - axis, fall, extent]:
                        found[axis, of, extent] += near[axis, fall, extent]
                        expected[axis, of, extent] += shares[axis, fall, extent]
    factor = np.maximum((found + STRIP_PRIOR) / (expected + STRIP_PRIOR), 1.0)
    np.testing.assert_allclose(counts.concentration, factor[0] * factor[1], rtol=1e-12)
