"""A turning beam: what is learned as a sweep, and how its messages become scans and images."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from support.sweeps import FIRST, RADAR, START_NS, STEP, beam, contents, fan, read

from tsepm_ros import Scan
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.sweep import Sweep, joined
from tsepm_ros.session.turn import TurnLearner
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.simulation import Simulator, load_scenario, shipped_scenarios
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.scan import Arc, arc_of

STEPS = 36
ANGLE = 2 * math.pi / STEPS
TIME = 0.1
TURN = STEPS * TIME


def assembly(max_detections: int = 1000) -> Sweep:
    session = SessionOptions(sweep=f"{TURN}", restart_jump=60.0)
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
        assert scan.scan.stamp == pytest.approx(100.0 + turn * TURN)
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
        beam(n * TURN / steps, math.remainder(n * step, 2 * math.pi), 10.0 * (1 + n))
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
        SensorScan(Scan(float(n), [5.0], [1.0]), "radar", beams=Arc(-3.0, 6.0, whole=True))
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


RICH = SensorScan(
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
PLAIN = SensorScan(Scan(10.5, [300.0], [0.05], features={"range_rate": [2.0]}), "radar")


def test_what_one_message_has_and_the_other_does_not():
    one = joined([PLAIN, RICH, beam(12.0, 0.2)], RADAR, None)
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
        group = joined(parts, exact, None).scan.group
        assert np.array_equal(group[:, None] == group, expected[:, None] == expected)


def test_messages_that_are_apart_share_no_run():
    near = [read(fan(START_NS + n, FIRST + 5 * n * STEP, [100.0])) for n in range(3)]
    assert len(set(joined(near, RADAR, None).scan.group)) == 3
    unknown = [dataclasses.replace(each, beams=None) for each in near]
    assert len(set(joined(unknown, RADAR, None).scan.group)) == 3


def learned(messages):
    """Number of messages until a sweep is seen, and its seconds; None if it is never."""
    learner = TurnLearner()
    for number, message in enumerate(messages):
        turning = learner.take(message.scan.stamp, message.beams, message.scan.range)
        if turning is not None:
            return number, turning[0]
    return None


def echoes(stamp: float, azimuth, range) -> SensorScan:
    """A message that lists its detections only."""
    scan = Scan(stamp, range, azimuth)
    return SensorScan(scan, "sonar", beams=arc_of(scan.azimuth))


def turning(steps: float, direction: int = 1, *, whole: bool = True, seed: int = 0, share=1.0):
    rng = np.random.default_rng(seed)
    for number in range(int(4 * steps)):
        azimuth = math.remainder(direction * number * 2 * math.pi / steps, 2 * math.pi)
        if whole:
            yield beam(2.5 * number / steps, azimuth)
        elif rng.random() < share:
            yield beam(2.5 * number / steps, azimuth, rng.uniform(10.0, 900.0), whole=False)
        else:
            yield beam(2.5 * number / steps, None)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("steps", [8, 36, 400, 4096])
def test_a_turning_beam_is_a_sweep_after_a_turn(steps, direction):
    number, seconds = learned(turning(steps, direction))
    assert number <= steps + 1
    assert seconds == pytest.approx(2.5)


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_detections_at_different_ranges_show_it_too(share):
    number, seconds = learned(turning(180, whole=False, share=share))
    assert number <= 1.1 * 180 + 10
    assert seconds == pytest.approx(2.5, rel=0.02)


@pytest.mark.parametrize("back", [True, False])
def test_a_sector_is_a_sweep_after_two_passes(back):
    there = np.linspace(-1.0, 1.0, 41)
    azimuths = np.concatenate([there, there[::-1] if back else there] * 3)[17:]
    number, seconds = learned([beam(0.1 * n, float(a)) for n, a in enumerate(azimuths)])
    assert number <= 2.7 * 41
    assert seconds == pytest.approx(4.1, rel=0.05)


@pytest.mark.parametrize("name", shipped_scenarios())
def test_no_shipped_scenario_is_one(name):
    simulator = Simulator(load_scenario(name), 3)
    assert (
        learned(echoes(one.scan.stamp, one.scan.azimuth, one.scan.range) for one in simulator)
        is None
    )


def test_a_fan_that_stays_or_is_panned_slowly_and_a_target_to_and_fro_are_none():
    fans = [
        SensorScan(Scan(float(n), [], []), "sonar", beams=Arc(-0.5, 1.0, True)) for n in range(500)
    ]
    assert learned(fans) is None
    fans = [
        SensorScan(Scan(float(n), [], []), "sonar", beams=Arc(0.05 * n, 1.0, True))
        for n in range(1000)
    ]
    assert learned(fans) is None
    pings = [echoes(float(n), [math.sin(0.05 * n)], [200.0]) for n in range(2000)]
    assert learned(pings) is None


@pytest.mark.long
def test_few_detections_here_and_there_are_none():
    rng = np.random.default_rng(1)
    for number in (0.5, 1.0, 3.0):
        pings = (
            echoes(float(n), rng.uniform(-np.pi, np.pi, m), rng.uniform(1.0, 900.0, m))
            for n, m in enumerate(rng.poisson(number, 8_000))
        )
        assert learned(pings) is None


def test_a_buoy_seen_from_a_turning_vessel_is_none():
    rng = np.random.default_rng(1)
    for noise in (0.0, 0.01):
        pings = [
            echoes(
                float(n),
                [math.remainder(-0.1 * n + noise * rng.standard_normal(), 2 * math.pi)],
                [200.0 + rng.standard_normal()],
            )
            for n in range(400)
        ]
        assert learned(pings) is None
