"""Figures of the sensor that do not fit the scans are said once, with those to set."""

import dataclasses
import math

import numpy as np
import pytest
from support.sessions import arrived

from tsepm_ros import Scan, SensorModel
from tsepm_ros.session.consistency_checks import SensorFigures, findings
from tsepm_ros.session.session import Session
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.clutter.measurement_errors import FittedErrors
from tsepm_ros.tracker.clutter.seen import Extent

SEEN = Extent(10.0, 299.0, -1.04, 1.05)
SHORT = SensorModel(max_range=300.0, azimuth_min=-1.0472, azimuth_max=1.0472)


def test_figures_that_fit_are_not_mentioned():
    good = FittedErrors(0.5, 0.0, 0.017, 1.1, 0.9, 150.0)
    assert findings(SensorFigures()) == {}
    figures = SensorFigures(sensor=SHORT, seen=SEEN, seen_detections=400, errors=good, confirmed=20)
    assert findings(figures) == {}


def test_a_coverage_far_too_large_is_named_with_the_figures_to_set():
    said = findings(SensorFigures(seen=SEEN, seen_detections=40))["coverage"]
    assert "sensor.max_range to 300" in said
    assert "sensor.azimuth_min to -1.04" in said
    assert "sensor.azimuth_max to 1.05" in said
    few = SensorFigures(sensor=SensorModel(max_range=480.0), seen=SEEN, seen_detections=6)
    assert findings(few) == {}, "six detections may lie together by chance"


def test_a_minimum_range_next_to_nothing_is_said_as_0():
    sensor = SensorModel(min_range=5e-324)
    said = findings(SensorFigures(sensor=sensor, seen=SEEN, seen_detections=40))["coverage"]
    assert "from 0 to 9000 m" in said


def test_a_chance_gap_in_azimuth_is_no_sector():
    seen = Extent(10.0, 199.0, -0.664, 5.52)
    said = findings(SensorFigures(seen=seen, seen_detections=80))["coverage"]
    assert "sensor.max_range to 200" in said
    assert "all round" in said
    assert "azimuth" not in said


def test_a_coverage_too_small_is_named_only_where_much_is_lost():
    extent = Extent(3.0, 812.0, -math.pi, math.pi)
    lost = SensorFigures(sensor=SHORT, outside=90, detections=200, outside_extent=extent)
    said = findings(lost)["coverage_too_small"]
    assert "45 %" in said
    assert "sensor.max_range to 820" in said
    few = SensorFigures(sensor=SHORT, outside=90, detections=20000, outside_extent=extent)
    assert findings(few) == {}


@pytest.mark.parametrize(("given", "named"), [(20.0, True), (3.0, False), (0.0, False)])
def test_the_minimum_range_is_named_where_detections_are_nearer(given, named):
    extent = Extent(3.0, 812.0, -math.pi, math.pi)
    sensor = SensorModel(min_range=given, max_range=300.0)
    lost = SensorFigures(sensor=sensor, outside=90, detections=200, outside_extent=extent)
    assert ("sensor.min_range to 3" in findings(lost)["coverage_too_small"]) is named


@pytest.mark.parametrize(("factor", "said"), [(0.6, True), (0.8, False), (1.4, False), (1.6, True)])
def test_errors_are_named_from_a_factor_on(factor, said):
    errors = FittedErrors(0.0, 0.02, 0.03, factor, 1.0, 150.0)
    found = findings(SensorFigures(errors=errors)).get("errors", "")
    assert ("range_std_fraction to 0.02" in found) is said
    assert "azimuth_std" not in found


def test_confirmations_far_above_the_target_rate_are_named():
    many = SensorFigures(confirmed=40, duration=1200.0, false_tracks_per_hour=1.0)
    assert "40 tracks" in findings(many)["confirmations"]
    allowed = SensorFigures(confirmed=40, duration=1200.0, false_tracks_per_hour=100.0)
    assert findings(allowed) == {}
    assert findings(SensorFigures(confirmed=400, duration=1200.0)) == {}, "no rate, no promise"


@pytest.mark.long
def test_a_session_says_each_finding_once_and_again_after_a_reset():
    heard: list[tuple[str, str]] = []
    session = Session(Settings(), lambda subject, said: heard.append((subject, said)))
    rng = np.random.default_rng(2)

    def play(begin: float) -> None:
        for ping in range(60):
            number = rng.poisson(20)
            scan = Scan(
                begin + ping, 300.0 * np.sqrt(rng.random(number)), rng.uniform(-1.05, 1.05, number)
            )
            session.add_scan(arrived(scan), 0.0)
            list(session.process())

    play(0.0)
    assert [subject for subject, _ in heard] == ["coverage"]
    assert "sensor.max_range to 300" in heard[0][1]
    figures = session.figures()
    assert figures.sensor_findings.keys() == {"coverage"}
    assert figures.clutter_density == pytest.approx(20.0 / (1.05 * 300.0**2), rel=0.2)
    assert figures.coverage_area == pytest.approx(1.05 * 300.0**2, rel=0.1)
    session.reset()
    play(100.0)
    assert [subject for subject, _ in heard] == ["coverage", "coverage"]


@pytest.mark.long
def test_what_is_mended_as_told_is_no_longer_named():
    """Coverage and errors at once; other errors than those of the parameters count anew."""
    heard: list[tuple[str, str]] = []
    sensor = SensorModel(
        max_range=300.0,
        range_std=0.5,
        range_std_fraction=0.0,
        azimuth_std=0.05,
        clutter_density=1e-5,
    )
    session = Session(Settings(sensor=sensor), lambda *told: heard.append(told))
    rng = np.random.default_rng(3)

    def play(first: int, last: int) -> None:
        for ping in range(first, last):
            clutter = 600.0 * np.sqrt(rng.random(20)), rng.uniform(-math.pi, math.pi, 20)
            target = 100.0 + 0.5 * ping + 0.5 * rng.normal(), 0.3 + 0.01 * rng.normal()
            both = [np.append(*pair) for pair in zip(clutter, target, strict=True)]
            session.add_scan(arrived(Scan(float(ping), *both)), 0.0)
            list(session.process())

    play(0, 100)
    assert {"coverage_too_small", "errors"} <= {subject for subject, _ in heard}
    said = dict(heard)
    assert "sensor.max_range to 600" in said["coverage_too_small"]
    assert "sensor.azimuth_std to 0.0" in said["errors"]
    mended = dataclasses.replace(sensor, max_range=600.0, azimuth_std=0.01)
    session.configure(dataclasses.replace(session.settings, sensor=mended))
    heard.clear()
    play(100, 110)
    assert session.figures().sensor_findings == {}
    play(110, 200)
    assert [subject for subject, _ in heard if subject != "coverage"] == []
    assert session.figures().sensor_findings.keys() <= {"coverage"}


def test_detections_without_errors_name_no_values():
    exact = FittedErrors(1e-6, 0.0, 1e-9, 1e-5, 1e-7, 150.0)
    said = findings(SensorFigures(errors=exact))["errors"]
    assert "simulated" in said
    assert "set sensor" not in said
