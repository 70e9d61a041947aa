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
"""Sweeps: messages of parts of a turn are joined to scans, and give the tracks of whole turns."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from support.builders import assert_same_tracks
from support.sessions import arrived
from support.sweeps import (
    BEAM_NS,
    BEAMS,
    FIRST,
    RADAR,
    START_NS,
    STEP,
    TARGETS,
    TURN,
    beam,
    circling,
    contents,
    fan,
    in_parts,
    played,
    read,
    settings,
    still,
    turns,
    whole,
)

from tsepm_ros import Scan
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.session import Session
from tsepm_ros.session.sweep import Sweep, joined_sweep
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.scan import ScanArc


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


def test_once_messages_are_joined_the_time_between_scans_is_that_of_a_turn():
    one = Session(settings("auto"))
    messages = [read(message) for message in in_parts(turns(8), 6)]
    played_open(one, messages[:10])
    assert one.deliveries.interval < 0.5 * TURN
    played_open(one, messages[10:])
    assert one.deliveries.interval == pytest.approx(TURN, rel=0.02)


@pytest.mark.parametrize("of_a_turn", [True, False])
def test_the_coverage_is_judged_by_a_sector_and_not_by_the_beams_of_the_first_turn(of_a_turn):
    """All detections so far lie in a part of the coverage in both."""
    session = Session(settings("auto"))
    rng = np.random.default_rng(3)
    for number in range(160):
        first = FIRST + (number if of_a_turn else 40) * STEP
        message = fan(START_NS + number * BEAM_NS, first, rng.uniform(20.0, 900.0, 4))
        session.add_scan(read(message), 0.0)
        list(session.process())
    found = [finding for finding in session.figures().findings.values() if finding]
    assert len(found) == (not of_a_turn)
    assert all(finding.startswith("all detections are") for finding in found)


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
    standing = [beam(last + 0.02 * n, -2.0) for n in range(3000)]
    results = played(one, standing)
    assert len(results) >= 4
    held = one.tracker.maintenance.confirmed
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


def played_open(session: Session, messages: list[UnregisteredScan]):
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


STEPS = 36

ANGLE = 2 * math.pi / STEPS

TIME = 0.1

PERIOD = STEPS * TIME


def assembly(max_detections: int = 1000) -> Sweep:
    session = SessionOptions(sweep=f"{PERIOD}", restart_jump=60.0)
    return Sweep(Settings(session, RADAR, CommonOptions(max_detections=max_detections)))


def message(number: int, *, start: float = 100.0, direction: int = 1, known: bool = True):
    """Message `number` of a beam that turns evenly; its one echo has a range of its own."""
    azimuth = math.remainder(0.3 + direction * number * ANGLE, 2 * math.pi)
    return beam(start + number * TIME, azimuth if known else None, *([10.0 * (1 + number)] * known))


def fed(one: Sweep, messages, *, close: bool = True):
    """Scans, and the reasons of what was refused."""
    taken = [one.take(each, each.scan.stamp) for each in messages]
    taken += [one.close()] if close else []
    scans = [scan for each, _ in taken for scan in each]
    return scans, [refusal.reason for _, remarks in taken for refusal in remarks]


def numbers(*spans: tuple[int, int]) -> list[list[float]]:
    return [[10.0 * (1 + number) for number in range(*span)] for span in spans]


@pytest.mark.parametrize("direction", [1, -1])
def test_a_scan_is_a_full_turn(direction):
    scans, reasons = fed(assembly(), [message(n, direction=direction) for n in range(3 * STEPS)])
    assert contents(scans) == numbers((0, STEPS), (STEPS, 2 * STEPS), (2 * STEPS, 3 * STEPS))
    assert reasons == []
    for turn, scan in enumerate(scans):
        assert scan.scan.stamp == pytest.approx(100.0 + turn * PERIOD)
        assert scan.scan.time_offset == pytest.approx(np.arange(STEPS) * TIME)
        assert scan.transmit_offset == pytest.approx(np.arange(STEPS) * TIME)


def test_whole_turns_have_looked_everywhere_and_parts_at_their_arc():
    scans, _ = fed(assembly(), [message(n) for n in range(STEPS + 9)])
    assert scans[0].scan.swept is None
    start, width = scans[1].scan.swept
    assert start == pytest.approx(0.3 - 0.5 * ANGLE)
    assert width == pytest.approx(9 * ANGLE)


@pytest.mark.parametrize("steps", [36, 35.3, 100.7])
def test_the_seam_stays_where_it_is_whatever_the_step(steps):
    step, one = 2 * math.pi / steps, assembly()
    messages = [
        beam(n * PERIOD / steps, math.remainder(n * step, 2 * math.pi), 10.0 * (1 + n))
        for n in range(int(20 * steps))
    ]
    scans, _ = fed(one, messages)
    assert len(scans) == 20
    starts = [
        math.remainder((scan.scan.range[0] / 10.0 - 1.0) * step, 2 * math.pi) for scan in scans
    ]
    assert max(map(abs, starts)) <= 0.5 * step + 1e-9


def test_a_gap_of_half_a_turn_ends_the_scan_and_a_shorter_one_leaves_a_hole():
    kept = [n for n in range(3 * STEPS) if not 10 <= n < 20 and not 34 <= n < 40]
    scans, reasons = fed(assembly(), [message(n) for n in kept])
    assert [len(scan.scan) for scan in scans] == [24, 32, 36]
    assert scans[1].scan.range[0] == 410.0
    assert reasons == []
    kept = [n for n in range(2 * STEPS) if not 10 <= n < 10 + STEPS // 2]
    scans, _ = fed(assembly(), [message(n) for n in kept])
    assert contents(scans) == numbers((0, 10), (28, 28 + STEPS), (64, 72))
    assert scans[0].scan.swept[1] == pytest.approx(10 * ANGLE)


def test_messages_without_an_azimuth_advance_by_time_from_those_with_one():
    messages = [message(n, known=n % 5 == 0) for n in range(3 * STEPS)]
    scans, _ = fed(assembly(), messages)
    assert [scan.scan.stamp for scan in scans] == pytest.approx([100.0, 103.6, 107.2])
    assert contents(scans)[1] == [10.0 * (1 + n) for n in range(40, 72, 5)]
    messages = [message(n, known=n in (3, 38, 76, 110, 149)) for n in range(5 * STEPS)]
    scans, _ = fed(assembly(), messages)
    assert contents(scans) == [[40.0], [390.0], [770.0], [1110.0], [1500.0]]


def test_a_sector_ends_where_the_beam_turns_back():
    there = [0.1 * n for n in range(20)]
    azimuths = [*there, *there[::-1], *there, *there[::-1]]
    scans, _ = fed(assembly(), [beam(0.1 * n, a, 10.0 * (1 + n)) for n, a in enumerate(azimuths)])
    lengths = [len(scan.scan) for scan in scans]
    assert sum(lengths) == 80
    assert all(19 <= length <= 21 for length in lengths)
    for scan in scans:
        assert scan.scan.swept[0] == pytest.approx(-0.05, abs=0.11)
        assert scan.scan.swept[1] == pytest.approx(2.0, abs=0.11)


def test_a_turn_in_the_other_direction_and_other_axes_end_the_scan():
    azimuths = [n * ANGLE for n in range(50)]
    azimuths += [azimuths[-1] - n * ANGLE for n in range(1, 60)]
    messages = [
        beam(0.1 * n, math.remainder(a, 2 * math.pi), 10.0 * (1 + n))
        for n, a in enumerate(azimuths)
    ]
    scans, _ = fed(assembly(), messages)
    assert contents(scans) == numbers((0, 36), (36, 50), (50, 86), (86, 109))
    messages = [message(n) for n in range(20)]
    messages[10:] = [dataclasses.replace(each, axes="sonar") for each in messages[10:]]
    scans, _ = fed(assembly(), messages)
    assert contents(scans) == numbers((0, 10), (10, 20))


def test_a_beam_that_stands_ends_the_scan_and_a_slow_one_gets_its_time():
    one = assembly()
    standing = [beam(0.1 * n, 0.3, 10.0 * (1 + n)) for n in range(400)]
    scans, _ = fed(one, standing)
    assert np.concatenate(contents(scans)).tolist() == [10.0 * (1 + n) for n in range(400)]
    assert len(scans[0].scan) == pytest.approx(1.5 * STEPS, abs=2)
    lengths = [len(scan.scan) for scan in scans[:-1]]
    assert lengths == sorted(lengths)
    slow = [message(n) for n in range(STEPS)]
    slow += [
        beam(110.0 + 0.5 * n, math.remainder(0.3 + n * ANGLE, 2 * math.pi), 10.0 * (1 + n))
        for n in range(8 * STEPS)
    ]
    scans, _ = fed(assembly(), slow)
    assert len(scans[-2].scan) == STEPS  # 5 times slower, it is a whole turn again


def test_a_target_across_the_seam_is_in_one_scan():
    """Its echoes in the last beams and the first; another range in the same beams is not its."""
    messages = []
    for number in range(3 * 360):
        place = number % 360
        near = [800.0] if place in (358, 359, 0, 1, 2) else []
        other = [300.0 + number] if place in (0, 1, 2, 3) else []
        azimuth = math.remainder(math.radians(place), 2 * math.pi)
        messages.append(beam(0.01 * number, azimuth, *near, *other))
    one = assembly()
    first, second, third = fed(one, messages)[0]
    assert first.scan.range.tolist().count(800.0) == 3 + 5
    assert second.scan.range.tolist().count(800.0) == 5
    assert third.scan.range.tolist().count(800.0) == 2  # the rest never came
    times = second.scan.stamp + second.scan.time_offset[second.scan.range == 800.0]
    assert times == pytest.approx([7.18, 7.19, 7.20, 7.21, 7.22])
    assert [660.0 + k in second.scan.range for k in range(4)] == [True] * 4
    assert not np.isin([1020.0, 1021.0], second.scan.range).any()


def test_what_never_ends_at_the_seam_is_cut():
    """A wall all round: only some degrees of it belong before the seam."""
    messages = [
        beam(0.01 * n, math.remainder(math.radians(n), 2 * math.pi), 500.0) for n in range(3 * 360)
    ]
    scans, _ = fed(assembly(), messages)
    assert [len(scan.scan) for scan in scans] == [365, 360, 355]


def test_late_messages_are_dropped():
    late = [message(3, start=101.05), message(2)]
    messages = [message(n) for n in range(2 * STEPS - 10)]
    scans, reasons = fed(assembly(), [*messages[:50], *late, *messages[50:]])
    assert contents(scans) == numbers((0, STEPS), (STEPS, 2 * STEPS - 10))
    assert reasons == ["message_late"] * 2


def test_a_repeated_message_is_dropped_and_another_beam_of_its_stamp_is_not():
    messages = [message(n) for n in range(STEPS)]
    scans, reasons = fed(assembly(), [*messages[:5], messages[4], messages[2], *messages[5:]])
    assert contents(scans) == numbers((0, STEPS))
    assert reasons == ["scan_same_stamp"] * 2
    batch = [beam(100.0 + 0.4 * (n // 4), 0.3 + n * ANGLE, 10.0 * (1 + n)) for n in range(STEPS)]
    scans, reasons = fed(assembly(), batch)
    assert contents(scans) == numbers((0, STEPS))
    assert reasons == []


@pytest.mark.parametrize(("stamp", "reason"), [(0.0, "stamp_not_set"), (7.0, "scan_far_back")])
def test_a_single_stamp_far_back_is_dropped(stamp, reason):
    messages = [message(n) for n in range(STEPS)]
    messages.insert(9, beam(stamp, 1.0, 77.0))
    scans, reasons = fed(assembly(), messages)
    assert contents(scans) == numbers((0, STEPS))
    assert reasons == [reason]


def test_a_clock_set_back_a_little_begins_anew_after_half_a_turn():
    first = [message(n) for n in range(50)]
    second = [message(n, start=90.03) for n in range(50, 150)]
    scans, reasons = fed(assembly(), [*first, *second])
    assert contents(scans)[:2] == numbers((0, 36), (36, 50))
    assert set(reasons) == {"message_late"}
    assert 18 <= len(reasons) <= 21
    assert sum(len(scan.scan) for scan in scans) == 150 - len(reasons)


def test_a_message_that_shows_nearly_a_turn_is_a_scan_by_itself():
    wide = [
        UnregisteredScan(
            Scan(float(n), [5.0], [1.0]), "radar", beams=ScanArc(-3.0, 6.0, whole=True)
        )
        for n in range(3)
    ]
    scans, _ = fed(assembly(), wide)
    assert scans == wide


def test_no_echo_is_lost_or_doubled_in_any_disorder():
    rng = np.random.default_rng(5)
    for _ in range(30):
        order = np.arange(150)
        for place in rng.integers(0, 140, 12):
            order[place : place + 4] = rng.permutation(order[place : place + 4])
        order = order[rng.random(150) > 0.1]
        for place in rng.integers(0, len(order) - 9, 5):
            order = np.insert(order, place + rng.integers(1, 9), order[place])
        scans, reasons = fed(assembly(), [message(int(n)) for n in order])
        found = np.concatenate(contents(scans))
        assert len(found) == len(np.unique(found))
        assert len(found) + len(reasons) == len(order)


@pytest.mark.long
def test_hostile_stamps_and_azimuths_lose_no_echo_uncounted():
    """Every message is in one scan, or counted; what waits is bounded by the limit."""
    rng = np.random.default_rng(8)
    for _ in range(40):
        one = assembly(max_detections=50)
        stamps = np.cumsum(rng.choice([0.0, 0.1, 0.1, 0.1, -0.1, -50.0, 1e3, -1e4, 1e7], 300))
        azimuths = rng.choice([*rng.uniform(-9.0, 9.0, 300), math.pi, -math.pi], 300)
        messages = [
            beam(float(stamp), None if rng.random() < 0.2 else float(azimuth), 10.0 * (1 + n))
            for n, (stamp, azimuth) in enumerate(zip(stamps, azimuths, strict=True))
        ]
        scans, reasons = fed(one, messages)
        found = np.concatenate(contents(scans))
        assert len(found) == len(np.unique(found)) == 300 - len(reasons)
        assert max(len(scan.scan) for scan in scans) <= 60
        for scan in scans:
            assert np.isfinite(scan.scan.time_offset if len(scan.scan) > 1 else 0.0).all()


@pytest.mark.parametrize("messages_per_turn", [8, 36])
def test_after_a_beam_that_trembled_turns_are_whole_again(messages_per_turn):
    step, rng = 2 * math.pi / messages_per_turn, np.random.default_rng(3)
    trembling = [beam(0.001 * n, rng.uniform(-1.0, 1.0), 10.0 * (1 + n)) for n in range(50)]
    turning = [
        beam(
            1.0 + n * PERIOD / messages_per_turn,
            math.remainder(n * step, 2 * math.pi),
            5000.0 + 10.0 * n,
        )
        for n in range(12 * messages_per_turn)
    ]
    scans, reasons = fed(assembly(), [*trembling, *turning])
    assert reasons == []
    assert [len(scan.scan) for scan in scans[-4:-1]] == [messages_per_turn] * 3


RICH = UnregisteredScan(
    Scan(
        11.0,
        [100.0, 200.0],
        [0.1, 0.1],
        range_std=[3.0, 4.0],
        azimuth_std=[0.2, 0.3],
        time_offset=[0.1, 0.2],
        features={"intensity": [5.0, 6.0]},
        group=[4, -1],
    ),
    "radar",
    transmit_offset=np.array([0.01, 0.02]),
    height=np.array([-1.0, -2.0]),
)

PLAIN = UnregisteredScan(Scan(10.5, [300.0], [0.05], features={"range_rate": [2.0]}), "radar")


def test_what_one_message_has_and_the_other_does_not():
    one = joined_sweep([PLAIN, RICH, beam(12.0, 0.2)], RADAR, None)
    scan = one.scan
    assert (scan.stamp, one.frame_id) == (10.5, "radar")
    assert scan.range.tolist() == [300.0, 100.0, 200.0]
    assert scan.range_std == pytest.approx([1.0, 3.0, 4.0])
    assert scan.azimuth_std == pytest.approx([0.01, 0.2, 0.3])
    assert scan.time_offset == pytest.approx([0.0, 0.6, 0.7])
    assert one.transmit_offset == pytest.approx([0.0, 0.51, 0.52])
    assert one.height == pytest.approx([0.0, -1.0, -2.0])
    assert scan.features["intensity"] == pytest.approx([math.nan, 5.0, 6.0], nan_ok=True)
    assert scan.features["range_rate"] == pytest.approx([2.0, math.nan, math.nan], nan_ok=True)
    assert scan.group[0] == scan.group[2] == -1
    assert scan.group[1] >= 0
    Scan(**{name: value for name, value in vars(scan).items() if value is not None})  # is allowed


@pytest.mark.parametrize("size", [1, 2, 3, 5, 30])
def test_runs_of_rays_go_on_from_message_to_message(size):
    """The groups of one message with all rays are those of its parts."""
    rng = np.random.default_rng(size)
    for _ in range(20):
        ranges = np.cumsum(rng.choice([0.0, 0.2, 30.0, -40.0], 30)) + 300.0
        ranges[rng.random(30) < 0.2] = np.inf
        expected = read(fan(START_NS, FIRST, ranges)).scan.group
        parts = [
            read(fan(START_NS + place * 10**6, FIRST + place * STEP, ranges[place : place + size]))
            for place in range(0, 30, size)
        ]
        exact = dataclasses.replace(RADAR, range_std=1e-6)
        group = joined_sweep(parts, exact, None).scan.group
        assert np.array_equal(group[:, None] == group, expected[:, None] == expected)


def test_messages_that_are_apart_share_no_run():
    near = [read(fan(START_NS + n, FIRST + 5 * n * STEP, [100.0])) for n in range(3)]
    assert len(set(joined_sweep(near, RADAR, None).scan.group)) == 3
    unknown = [dataclasses.replace(each, beams=None) for each in near]
    assert len(set(joined_sweep(unknown, RADAR, None).scan.group)) == 3
