"""Sweeps in parts in a session: a message per beam gives the tracks of a message per turn."""

import dataclasses
import math

import numpy as np
import pytest
from support.builders import assert_same_tracks
from support.sessions import arrived
from support.sweeps import (
    BEAM_NS,
    BEAMS,
    START_NS,
    TARGETS,
    TURN,
    beam,
    circling,
    in_parts,
    played,
    read,
    settings,
    still,
    turns,
    whole,
)

from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.tools.simulation import Simulator, load_scenario


@pytest.mark.parametrize(("size", "pose"), [(6, still), (1, circling)], ids=["still", "circling"])
def test_a_turn_in_parts_gives_the_tracks_of_the_turn_in_one_message(pose, size):
    """To the bit: hits, states and covariances, also of a ship that moves and turns."""
    ranges, options, own_ship = turns(10, pose), {}, None
    if pose is not still:
        options, own_ship = {"own_ship_source": "odometry"}, pose
    expected = played(Session(settings("off", **options)), whole(ranges), own_ship)
    one = Session(settings(f"{TURN}", **options))
    results = played(one, in_parts(ranges, size), own_ship)
    assert one.dropped == {}
    assert len(results) == len(expected) == 10
    assert sum(len(result.new) for result in results) == 2
    for result, other in zip(results, expected, strict=True):
        assert result.stamp_ns == other.stamp_ns
        for name in ("range", "azimuth", "time_offset", "sensor_pose"):
            assert np.array_equal(getattr(result.scan, name), getattr(other.scan, name))
        assert_same_tracks(result.new, other.new)
        assert_same_tracks(result.current, other.current)
        assert result.statistics == other.statistics
    time = results[-1].stamp - 1e-9 * START_NS
    truth = [(x + vx * time, y + vy * time) for x, vx, y, vy in TARGETS]
    for track in results[-1].current:
        assert min(np.hypot(*(track.state[[0, 2]] - truth).T)) < 10.0
        assert min(np.hypot(*(track.state[[1, 3]] - np.array(TARGETS)[:, [1, 3]]).T)) < 1.5


@pytest.mark.long
def test_a_target_at_the_seam_is_one_track():
    ranges = turns(14, targets=((-300.0, 0.0, 0.0, 0.5),), clutter=0, width=3)
    results = played(Session(settings(f"{TURN}")), in_parts(ranges))
    assert sum(len(result.new) for result in results) == 1
    middle = results[1:-1]
    assert {len(result.scan) for result in middle} <= {5, 6, 7}
    for result in middle:  # its echoes follow each other, across the seam
        assert np.ptp(result.scan.time_offset) < 0.1 * TURN


def test_the_state_and_latency_of_a_given_sweep_are_reported():
    one = Session(settings("3.14"))
    messages = [read(message) for message in in_parts(turns(2), 6)]
    played_open(one, messages[:10])
    assert one.figures().sweep == "sweeps of 3.14 s, none complete yet"
    played_open(one, messages[10:])
    assert one.figures().sweep == f"sweeps of 3.14 s in {BEAMS // 6} messages"
    one = Session(settings(f"{TURN}"))
    played(one, in_parts(turns(3), 6))
    figures = one.figures()
    assert figures.sweep == f"sweeps of {TURN:.3g} s in {BEAMS // 6} messages"
    assert figures.sweep_latency == pytest.approx(TURN, rel=0.02)
    assert Session(settings("off")).figures().sweep == "a message is a scan"


@pytest.mark.long
def test_a_learned_sweep_is_given_up_where_the_beam_stands():
    said = []
    one = Session(settings("auto"), lambda reason, sentence: said.append(sentence))
    turning = [read(message) for message in in_parts(turns(8), 6)]
    played_open(one, turning)
    assert one.figures().sweep.startswith("sweeps of 3.14 s")
    last = turning[-1].scan.stamp
    standing = [beam(last + 0.5 * (n + 1), -2.0, 500.0) for n in range(400)]
    results = played_open(one, standing)
    assert [sentence for sentence in said if "no longer turns" in sentence] == [said[-1]]
    assert one.figures().sweep == "a message is a scan"
    assert [result.stamp for result in results[-5:]] == [one.scan.stamp for one in standing[-5:]]
    assert sum(len(result.scan) for result in results) >= len(standing), "no echo is lost"


def test_changed_limits_count_for_the_open_sweep():
    """Each limit of the configuration reaches the sweep in parts as it does the whole turn."""
    ranges = turns(6)
    before = settings(f"{TURN}")
    common = dataclasses.replace(before.common, max_detections=4)
    changed = dataclasses.replace(before, common=common)
    one = Session(before)
    results = played_open(one, [read(message) for message in in_parts(ranges[:3], 6)])
    one.configure(changed)
    results += played(one, in_parts(ranges, 6)[len(in_parts(ranges[:3], 6)) :])
    assert max(len(result.scan) for result in results[:2]) > 4
    assert max(len(result.scan) for result in results[3:]) <= 4


@pytest.mark.parametrize("method", ["tsepm", "score"])
def test_auto_changes_nothing_for_a_sonar_that_looks_everywhere(method):
    scenario = dataclasses.replace(load_scenario("box"), scans=12)
    scans = [simulated.scan for simulated in Simulator(scenario, 4)]
    results = []
    for sweep in ("off", "auto"):
        one = Session(settings(sweep, sensor=scenario.sensor, method=method))
        results.append(played(one, [arrived(scan) for scan in scans]))
    for off, auto in zip(*results, strict=True):
        assert_same_tracks(auto.current, off.current)
        assert_same_tracks(auto.new, off.new)
        assert auto.statistics == off.statistics


def test_an_open_scan_ends_after_a_silence_on_both_clocks():
    one = Session(settings("2.0"))
    for number in range(10):
        one.add_scan(beam(0.1 * number, 0.1 * number, 100.0), (50.0, 7.0))
    assert list(one.process((51.9, 99.0))) == []
    assert list(one.process((99.0, 8.9))) == []
    (result,) = one.process((52.1, 9.1))
    assert len(result.scan) == 10
    assert result.scan.swept[1] == pytest.approx(1.0)
    one.add_scan(beam(4.0, 2.0, 100.0), (54.0, 11.0))
    assert [len(result.scan) for result in one.process(last=True)] == [1]
    one.add_scan(beam(5.0, 2.0, 100.0), (55.0, 12.0))
    one.reset()
    assert list(one.process(last=True)) == []


def test_a_part_of_a_turn_counts_no_misses_elsewhere():
    """A beam that stands on open water does not end the tracks elsewhere."""
    ranges = turns(6, clutter=0)
    one = Session(settings(f"{TURN}"))
    results = played(one, in_parts(ranges))
    assert len(results[-1].current) == 2
    last = results[-1].stamp + TURN
    standing = [beam(last + 0.01 * n, -2.0) for n in range(6000)]
    results = played(one, standing)
    assert len(results) >= 4
    held = one.tracker.maintenance.held
    assert len(held) == 2
    assert held.existence.min() > 0.9


def test_a_reset_clock_restarts_after_a_scan():
    one = Session(settings(f"{TURN}", restart_jump=5.0))
    ranges = turns(8)
    messages = in_parts(ranges, 6)
    again = [dataclasses.replace(read(m), stamp_ns=0) for m in messages]
    back = [
        dataclasses.replace(each, scan=each.scan.replaced(stamp=each.scan.stamp - 1000.0))
        for each in again
    ]
    first = played_open(one, [read(m) for m in messages])
    second = played(one, back)
    assert [result.arrival.value for result in second][0:2] == ["next", "restart"]
    assert sum(len(result.new) for result in first + second) == 4
    assert one.dropped == {}


def played_open(session: Session, messages: list[SensorScan]):
    results = []
    for message in messages:
        session.add_scan(message, 0.0)
        results += session.process()
    return results


@pytest.mark.parametrize("value", ["on", "", "0", "-2", "nan", "inf", "601", "2.5 s"])
def test_a_sweep_that_is_not_allowed_is_refused(value):
    with pytest.raises(ValueError, match=r"^sweep must be off, auto, or a number of seconds"):
        SessionOptions(sweep=value)


@pytest.mark.parametrize(
    ("value", "text"), [(2.5, "2.5"), (3, "3"), (False, "off"), ("auto", "auto")]
)
def test_a_sweep_may_be_given_as_yaml_reads_it(value, text):
    assert SessionOptions(sweep=value).sweep == text


def test_times_are_those_of_the_nanoseconds():
    """A date in seconds does not fit a float64 to the nanosecond, their difference does."""
    messages = [read(message) for message in in_parts(turns(2, clutter=30))]
    results = played(Session(settings(f"{TURN}")), messages)
    offsets = results[0].scan.time_offset / (BEAM_NS * 1e-9)
    assert np.array_equal(offsets, np.round(offsets))
    assert math.isclose(results[0].stamp, START_NS * 1e-9)
