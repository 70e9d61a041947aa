"""Messages of a turning beam become scans: where each ends, and what happens to odd messages."""

import dataclasses
import math

import numpy as np
import pytest
from support.sweeps import RADAR, beam, contents

from tsepm_ros import Scan
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.sweep import Sweep
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.scan import Arc

STEPS = 36
STEP = 2 * math.pi / STEPS
TIME = 0.1
TURN = STEPS * TIME


def assembly(max_detections: int = 1000) -> Sweep:
    session = SessionOptions(sweep=f"{TURN}", restart_jump=60.0)
    return Sweep(Settings(session, RADAR, CommonOptions(max_detections=max_detections)))


def message(number: int, *, start: float = 100.0, direction: int = 1, known: bool = True):
    """Message `number` of a beam that turns evenly; its one echo has a range of its own."""
    azimuth = math.remainder(0.3 + direction * number * STEP, 2 * math.pi)
    return beam(start + number * TIME, azimuth if known else None, *([10.0 * (1 + number)] * known))


def fed(one: Sweep, messages, *, close: bool = True):
    """Scans, and the reasons of what was refused."""
    taken = [one.take(each, each.scan.stamp) for each in messages]
    taken += [one.close()] if close else []
    scans = [scan for each in taken for scan in each.scans]
    return scans, [refusal.reason for each in taken for refusal in each.remarks]


def numbers(*spans: tuple[int, int]) -> list[list[float]]:
    return [[10.0 * (1 + number) for number in range(*span)] for span in spans]


@pytest.mark.parametrize("direction", [1, -1])
def test_a_scan_is_a_full_turn(direction):
    scans, reasons = fed(assembly(), [message(n, direction=direction) for n in range(3 * STEPS)])
    assert contents(scans) == numbers((0, STEPS), (STEPS, 2 * STEPS), (2 * STEPS, 3 * STEPS))
    assert reasons == []
    for turn, scan in enumerate(scans):
        assert scan.scan.stamp == pytest.approx(100.0 + turn * TURN)
        assert scan.scan.time_offset == pytest.approx(np.arange(STEPS) * TIME)
        assert scan.transmit_offset == pytest.approx(np.arange(STEPS) * TIME)


def test_whole_turns_have_looked_everywhere_and_parts_at_their_arc():
    scans, _ = fed(assembly(), [message(n) for n in range(STEPS + 9)])
    assert scans[0].scan.swept is None
    start, width = scans[1].scan.swept
    assert start == pytest.approx(0.3 - 0.5 * STEP)
    assert width == pytest.approx(9 * STEP)


@pytest.mark.parametrize("steps", [36, 35.3, 100.7])
def test_the_seam_stays_where_it_is_whatever_the_step(steps):
    step, one = 2 * math.pi / steps, assembly()
    messages = [
        beam(n * TURN / steps, math.remainder(n * step, 2 * math.pi), 10.0 * (1 + n))
        for n in range(int(20 * steps))
    ]
    scans, _ = fed(one, messages)
    assert len(scans) == 20
    starts = [
        math.remainder((scan.scan.range[0] / 10.0 - 1.0) * step, 2 * math.pi) for scan in scans
    ]
    assert max(map(abs, starts)) <= 0.5 * step + 1e-9


def test_lost_messages_only_leave_a_hole():
    kept = [n for n in range(3 * STEPS) if not 10 <= n < 20 and not 34 <= n < 40]
    scans, reasons = fed(assembly(), [message(n) for n in kept])
    assert [len(scan.scan) for scan in scans] == [24, 32, 36]
    assert scans[1].scan.range[0] == 410.0
    assert reasons == []


def test_a_gap_of_half_a_turn_ends_the_scan():
    kept = [n for n in range(2 * STEPS) if not 10 <= n < 10 + STEPS // 2]
    scans, _ = fed(assembly(), [message(n) for n in kept])
    assert contents(scans) == numbers((0, 10), (28, 28 + STEPS), (64, 72))
    assert scans[0].scan.swept[1] == pytest.approx(10 * STEP)


def test_messages_without_an_azimuth_advance_by_time():
    messages = [message(n, known=n % 5 == 0) for n in range(3 * STEPS)]
    scans, _ = fed(assembly(), messages)
    assert [scan.scan.stamp for scan in scans] == pytest.approx([100.0, 103.6, 107.2])
    assert contents(scans)[1] == [10.0 * (1 + n) for n in range(40, 72, 5)]


def test_one_known_beam_a_turn_keeps_its_place():
    """Its azimuth is ambiguous by turns; the time says how many."""
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


def test_a_turn_in_the_other_direction_ends_the_scan():
    azimuths = [n * STEP for n in range(50)]
    azimuths += [azimuths[-1] - n * STEP for n in range(1, 60)]
    messages = [
        beam(0.1 * n, math.remainder(a, 2 * math.pi), 10.0 * (1 + n))
        for n, a in enumerate(azimuths)
    ]
    scans, _ = fed(assembly(), messages)
    assert contents(scans) == numbers((0, 36), (36, 50), (50, 86), (86, 109))


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
        beam(110.0 + 0.5 * n, math.remainder(0.3 + n * STEP, 2 * math.pi), 10.0 * (1 + n))
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


def test_an_empty_seam_adds_no_latency():
    one = assembly()
    scans, _ = fed(one, [message(n) for n in range(STEPS)], close=False)
    assert scans == []
    scans, _ = fed(one, [message(STEPS)], close=False)
    assert len(scans) == 1
    assert one.latency == pytest.approx(TURN)


def test_a_late_message_of_an_unknown_beam_is_put_in_its_place_by_its_stamp():
    order = [*range(20), 21, 20, *range(22, 2 * STEPS)]
    one = assembly()
    scans, reasons = fed(one, [message(n, known=n != 20) for n in order])
    rest = [[10.0 * (1 + n) for n in range(STEPS) if n != 20]]
    assert contents(scans) == rest + numbers((STEPS, 2 * STEPS))
    assert reasons == []
    assert one.state == f"sweeps of 3.6 s in {STEPS} messages"


def test_late_messages_that_do_not_fit_are_dropped():
    late = [message(3, start=101.05), message(2)]
    messages = [message(n) for n in range(2 * STEPS - 10)]
    scans, reasons = fed(assembly(), [*messages[:50], *late, *messages[50:]])
    assert contents(scans) == numbers((0, STEPS), (STEPS, 2 * STEPS - 10))
    assert reasons == ["scan_late"] * 2


def test_a_repeated_message_is_dropped_and_another_beam_of_its_stamp_is_not():
    messages = [message(n) for n in range(STEPS)]
    scans, reasons = fed(assembly(), [*messages[:5], messages[4], messages[2], *messages[5:]])
    assert contents(scans) == numbers((0, STEPS))
    assert reasons == ["scan_same_stamp"] * 2
    batch = [beam(100.0 + 0.4 * (n // 4), 0.3 + n * STEP, 10.0 * (1 + n)) for n in range(STEPS)]
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
    assert set(reasons) == {"scan_late"}
    assert 18 <= len(reasons) <= 21
    assert sum(len(scan.scan) for scan in scans) == 150 - len(reasons)


def test_a_scan_ends_before_it_has_too_many_detections():
    scans, _ = fed(assembly(max_detections=10), [message(n) for n in range(STEPS)])
    assert contents(scans) == numbers((0, 10), (10, 20), (20, 30), (30, 36))


def test_a_message_that_shows_nearly_a_turn_is_a_scan_by_itself():
    wide = [
        SensorScan(Scan(float(n), [5.0], [1.0]), "radar", beams=Arc(-3.0, 6.0, whole=True))
        for n in range(3)
    ]
    scans, _ = fed(assembly(), wide)
    assert scans == wide


def test_messages_of_other_axes_begin_a_scan():
    messages = [message(n) for n in range(20)]
    messages[10:] = [dataclasses.replace(each, axes="sonar") for each in messages[10:]]
    scans, _ = fed(assembly(), messages)
    assert contents(scans) == numbers((0, 10), (10, 20))


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
        stamps = np.cumsum(rng.choice([0.0, 0.1, 0.1, 0.1, -0.1, -50.0, 1e3, -1e4, 1e9], 300))
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
            1.0 + n * TURN / messages_per_turn,
            math.remainder(n * step, 2 * math.pi),
            5000.0 + 10.0 * n,
        )
        for n in range(12 * messages_per_turn)
    ]
    scans, reasons = fed(assembly(), [*trembling, *turning])
    assert reasons == []
    assert [len(scan.scan) for scan in scans[-4:-1]] == [messages_per_turn] * 3
