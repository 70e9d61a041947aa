"""Which pings of a fast sonar are looked at for targets of several detections."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from plots_scenes import Pool

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tracker import plot_extraction
from tsepm_ros.tracker.multi_detection import DetectionSpacing
from tsepm_ros.tracker.plot_extraction import LOOK_STREAK, Looks

SENSOR = SensorModel(max_range=100.0, range_std=0.2, range_std_fraction=0.0, azimuth_std=0.01)
SPEED = 3.0


@pytest.fixture
def reaches(monkeypatch):
    """Reach of each look, m, in the order of the looks."""
    found = []
    observe = DetectionSpacing.observe

    def observed(self, range_, azimuth, position=None, reach=0.0, seen=None):
        found.append(reach)
        observe(self, range_, azimuth, position, reach, seen)

    monkeypatch.setattr(DetectionSpacing, "observe", observed)
    return found


def ping(number: int, rate: float, swept=None) -> Scan:
    """Three detections some 90 m apart, elsewhere in the next ping."""
    azimuth = np.array([0.0, 2.0, 4.0]) + 0.7 * number
    return Scan(number / rate, np.full(3, 50.0), azimuth, swept=swept)


def initiator_of(**options):
    return make_initiator("score", sensor=SENSOR, max_speed=SPEED, **options)


@pytest.mark.parametrize("rate", [7.0, 10.0, 20.0, 40.0])
def test_looks_are_their_interval_apart_and_never_in_step_with_the_pings(rate):
    taken, stamps = Looks(), []
    for stamp in np.arange(0.0, 200.0, 1.0 / rate):
        if taken.is_due(stamp):
            taken = taken.after(stamp)
            stamps.append(stamp)
    apart = np.diff(stamps)
    assert apart.min() >= 0.5 * plot_extraction.LOOK_INTERVAL - 1e-9
    assert apart.max() <= 1.5 * plot_extraction.LOOK_INTERVAL + 1.0 / rate
    # A look waits for the next ping, half the time between pings on average.
    assert apart.mean() == pytest.approx(plot_extraction.LOOK_INTERVAL + 0.5 / rate, rel=0.05)
    assert len(np.unique(apart.round(6))) > 1


def test_every_ping_of_a_slow_sonar_is_looked_at(reaches):
    initiator = initiator_of()
    for number in range(20):
        initiator.process(ping(number, 3.0))
    np.testing.assert_allclose(reaches, [0.0] + 19 * [SPEED / 3.0])


def test_of_a_fast_sonar_few_pings_are_and_the_reach_is_that_of_the_time_between(reaches):
    initiator = initiator_of()
    for number in range(101):
        initiator.process(ping(number, 20.0))
    assert len(reaches) == pytest.approx(5.0 / (plot_extraction.LOOK_INTERVAL + 0.025), abs=3)
    assert sum(reaches) == pytest.approx(
        SPEED * 5.0, abs=SPEED * 1.5 * plot_extraction.LOOK_INTERVAL
    )


@pytest.mark.long
def test_every_ping_is_while_detections_stay_close_and_few_once_plots_are_made(reaches):
    scene, seen = Pool(swimmers=3, echoes=3, false=4.0, pings=200), []
    initiator = make_initiator("score", sensor=scene.sensor, max_speed=SPEED)
    looked = []
    for one in scene.draw(2):
        initiator.process(one.scan)
        looked.append(len(reaches))
        seen.append(initiator.plots.seen)
    on = seen.index(True)
    taken = np.diff(looked, prepend=0)
    second = int(np.searchsorted(looked, LOOK_STREAK))
    assert taken[second : on + 1].all()
    after = 0.05 * (len(seen) - 1 - on)
    assert taken[on + 1 :].sum() == pytest.approx(
        after / (plot_extraction.LOOK_INTERVAL + 0.025), abs=3
    )


def test_every_part_of_a_turn_is(reaches):
    initiator = initiator_of()
    for number in range(30):
        initiator.process(ping(number, 20.0, swept=(0.5 * (number % 12), 0.5)))
    assert len(reaches) == 30


def test_a_likely_look_is_followed_by_a_look_at_the_next_ping(reaches, monkeypatch):
    observe = DetectionSpacing.observe

    def observed(self, *scan):
        observe(self, *scan)
        self.last_log_ratio = np.log(9.9 if len(reaches) % 2 else 10.1)

    monkeypatch.setattr(DetectionSpacing, "observe", observed)
    initiator = initiator_of()
    for number in range(100):
        initiator.process(ping(number, 20.0))
    apart = np.array(reaches[1:]) / SPEED
    # Looks 2, 4, ... are likely: the ones after them follow at once.
    np.testing.assert_allclose(apart[1::2], 0.05)
    assert apart[0::2].min() > 0.5 * plot_extraction.LOOK_INTERVAL - 1e-9


def test_the_ratio_of_the_last_ping_is_that_of_its_largest_box():
    spacing = DetectionSpacing(SENSOR)
    spacing.observe(np.array([50.0, 50.5]), np.array([0.0, 0.0]))
    assert spacing.last_log_ratio > np.log(2.0)
    spacing.observe(np.array([50.0, 50.0]), np.array([0.0, 2.0]))
    assert spacing.last_log_ratio == 0.0


def test_parts_of_a_turn_that_look_elsewhere_end_no_track():
    # 16 parts a turn; the target is missed in four looks at it, which are 64 scans.
    parts, rng = 16, np.random.default_rng(3)
    sensor = SensorModel(range_std=0.5, range_std_fraction=0.0, azimuth_std=0.005, max_range=100.0)
    initiator = make_initiator("score", sensor=sensor, max_speed=2.0, plots="off", window=64)
    ended = {}
    for number in range(parts * 24):
        turn, part = divmod(number, parts)
        here = int(part == 8 and turn not in range(14, 18))
        range_ = 50.0 + 0.5 * rng.standard_normal(here)
        azimuth = math.pi / parts + 0.005 * rng.standard_normal(here)
        width = 2.0 * math.pi / parts
        swept = ((part - 8) * width, width)
        initiator.process(Scan(number / 20.0, range_, azimuth, swept=swept))
        ended |= initiator.maintenance.ended
    assert not ended
    assert initiator.current.track_id.tolist() == [0]
