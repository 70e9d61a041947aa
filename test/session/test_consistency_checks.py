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
"""What a session says of what a driver sends, and of what does not fit its parameters."""

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest
from support.sessions import arrived, settings

from msg_adapters.detections import rays_without_detection
from msg_adapters.ping import ReadingOptions, good_detections
from msg_adapters.point_cloud import detections_of_fields
from tsepm_ros import Scan, SensorModel
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import MessageFacts, Mounting, UnregisteredScan
from tsepm_ros.session.consistency_checks import (
    LAST,
    WINDOW,
    LossCheck,
    MessageCheck,
    RepetitionCheck,
    SensorFigures,
    check_findings,
    check_questions,
    explained_by_check,
)
from tsepm_ros.session.session import Session
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.clutter.density import ClutterExtent
from tsepm_ros.tracker.clutter.sensor_performance import FittedErrors

START = 1_700_000_000.0


def asked_of(pings, *, period=0.2, now=None, own_ship=None, late=0.0):
    """Sentences by subject about pings (range, azimuth, more) at a period, s."""
    check, said = MessageCheck(), {}
    for index, (range_, azimuth, more) in enumerate(pings):
        stamp = START + period * index
        ping = good_detections(
            round(1e9 * stamp),
            "sonar",
            ReadingOptions(),
            range=np.asarray(range_, float),
            azimuth=np.asarray(azimuth, float),
            **{name: value for name, value in more.items() if name != "facts"},
        )
        scan = ping.sensor_scan
        if "facts" in more:
            scan = dataclasses.replace(scan, facts=more["facts"])
        arrival = -math.inf if now is None else stamp + now + late * (index % 2)
        pose = None if own_ship is None else stamp + own_ship
        for subject, sentence in check.judge(scan, pose, arrival):
            said.setdefault(subject, sentence)
    return said


def noisy(n=40, rng=None, **more):
    """Pings of two objects that stand and of random clutter."""
    rng = rng or np.random.default_rng(1)
    for _ in range(n):
        range_ = [900.0 + rng.normal(0, 3), 400 + rng.normal(0, 3), *rng.uniform(10, 1500, 4)]
        yield range_, [0.3, -1.0, *rng.uniform(-3, 3, 4)], more


def test_pings_of_a_usual_sonar_raise_no_question():
    assert asked_of(noisy(3 * WINDOW)) == {}
    assert asked_of(noisy(), now=0.3, own_ship=0.25, late=0.1) == {}
    assert asked_of(noisy(time_offset=np.full(6, 0.1))) == {}
    assert asked_of(noisy(), period=24.0, now=18.1, own_ship=18.0) == {}, "a slow ping"


FACTORS = {"ms": 1e3, "us": 1e6, "in float32": 1e6}


@pytest.mark.parametrize("unit", FACTORS)
@pytest.mark.parametrize(("period", "scale"), [(0.1, 0.03), (2.0, 1.0), (12.0, 4.0)])
def test_times_in_another_unit_are_asked_about(unit, period, scale):
    rng = np.random.default_rng(2)

    def pings():
        for range_, azimuth, _ in noisy():
            range_ = scale * np.asarray(range_)
            offset = FACTORS[unit] * range_ / 1500.0 + rng.normal(0, 1e-6, 6)
            if unit == "in float32":
                offset = offset.astype(np.float32)
            yield range_, azimuth, {"time_offset": offset}

    assert "in ms, us or ns" in asked_of(pings(), period=period)["time_offset"]


@pytest.mark.parametrize("seconds", [2.5, 30.0])
def test_times_within_a_turn_are_not_asked_about(seconds):
    rng = np.random.default_rng(3)
    pings = ((r, a, {"time_offset": rng.uniform(0.0, seconds, 6)}) for r, a, _ in noisy())
    assert asked_of(pings, period=seconds) == {}


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_detections_that_repeat_to_the_bit_are_said_with_their_share(share):
    fixed = np.linspace(100.0, 500.0, 10), np.linspace(-1.0, 1.0, 10)
    rng = np.random.default_rng(4)
    others = round(10 / share) - 10

    def pings():
        for _ in range(30):
            yield [*fixed[0], *rng.uniform(10, 99, others)], [*fixed[1], *rng.random(others)], {}

    sentence = asked_of(pings())["repeated"]
    assert f"{100 * share:.0f} % of" in sentence and "They are used" in sentence


def noise(count, n=5, seed=6):
    """Detections of scans, none of which is like another."""
    rng = np.random.default_rng(seed)
    return [(rng.uniform(100.0, 900.0, n), rng.uniform(-1.0, 1.0, n)) for _ in range(count)]


def dropped_of(scans, *, period=2.0, **features):
    """Drops of scans (range, azimuth), the number of results, and what was reported."""
    said = []
    session = Session(settings(), lambda *why: said.append(why))
    results = 0
    for index, (range_, azimuth) in enumerate(scans):
        ping = good_detections(
            round(1e9 * (START + period * index)),
            "sonar",
            ReadingOptions(),
            range=np.asarray(range_, float),
            azimuth=np.asarray(azimuth, float),
            features={name: values[index] for name, values in features.items()},
        )
        session.add_scan(ping.sensor_scan, START + period * index)
        results += len(list(session.process(START + period * index)))
    results += len(list(session.process(last=True)))
    return session.dropped, results, said


@pytest.mark.parametrize("period", [0.1, 12.0])
@pytest.mark.parametrize("times", [2, 5])
def test_scans_that_are_sent_several_times_are_no_new_evidence(times, period):
    # Before the first change, a scan that is equal may be that of a simulator without noise.
    scans = [scan for scan in noise(8) for _ in range(times)]
    dropped, results, said = dropped_of(scans, period=period)
    assert dropped == {"scan_repeated": 7 * (times - 1)}
    assert results == 8 + times - 1
    assert any(reason == "scan_repeated" and "to the bit" in text for reason, text in said)
    assert times > 2 or not any("They are used" in text for _, text in said)


def test_a_driver_that_repeats_its_last_scan_for_ever_gives_no_evidence():
    scans = noise(8)
    dropped, results, said = dropped_of([*scans, *[scans[-1]] * 30])
    assert (dropped, results) == ({"scan_repeated": 30}, 8)
    assert any("scans were dropped" in text for _, text in said)


def test_a_source_whose_every_scan_is_equal_goes_on_and_is_said():
    dropped, results, said = dropped_of(noise(1) * 30)
    assert (dropped, results) == ({}, 30)
    assert any("They are used" in text for _, text in said)


def test_equal_scans_of_a_source_without_noise_that_misses_some_echoes_are_used():
    (range_, azimuth), rng = noise(1)[0], np.random.default_rng(8)
    seen = [rng.random(5) < 0.8 for _ in range(40)]
    dropped, results, _ = dropped_of([(range_[some], azimuth[some]) for some in seen])
    assert (dropped, results) == ({}, 40)


def test_scans_without_detections_and_single_coarse_detections_do_not_repeat_the_last():
    nothing = np.zeros(0)
    assert dropped_of([(nothing, nothing)] * 20)[:2] == ({}, 20)
    steps = [(np.array([100.0 + k // 3]), np.array([0.5])) for k in range(30)]
    assert dropped_of(steps)[:2] == ({}, 30)


def test_equal_places_of_other_amplitude_are_other_detections():
    scans, rng = noise(4), np.random.default_rng(9)
    doubled = [scan for scan in scans for _ in range(2)]
    strengths = [rng.random(5) for _ in doubled]
    assert dropped_of(doubled, intensity=strengths)[0] == {}
    assert dropped_of(doubled, intensity=[s for s in strengths[::2] for _ in range(2)])[0] == {
        "scan_repeated": 3
    }


def test_a_turn_in_parts_that_is_repeated_for_ever_gives_no_evidence():
    rng, parts = np.random.default_rng(3), 16
    width = 2.0 * math.pi / parts
    messages = [
        (rng.uniform(50.0, 900.0, 3), part * width + rng.uniform(0.02, width - 0.02, 3))
        for _ in range(6)
        for part in range(parts)
    ]
    once = dropped_of(messages, period=0.2)
    again = dropped_of(messages + 6 * messages[-parts:], period=0.2)
    assert once[0] == {}
    assert again[0]["scan_repeated"] >= 5
    assert again[1] <= once[1] + 1


def test_values_for_no_return_are_said_with_their_share():
    facts = MessageFacts(rays=200, no_return={"nan": 20, "inf": 100, "a constant": 50})
    sentence = asked_of(noisy(facts=facts))["no_return"]
    assert "10 % nan" in sentence and "25 % a constant" in sentence and "inf" not in sentence
    rep_117 = MessageFacts(rays=200, no_return={"inf": 100})
    assert asked_of(noisy(facts=rep_117)) == {}


def test_what_a_message_states_is_said_when_it_changes():
    def pings():
        for index, (range_, azimuth, _) in enumerate(noisy()):
            states = {"range_max (m)": 60.0 if index >= 20 else 30.0, "sound speed (m/s)": math.nan}
            yield range_, azimuth, {"facts": MessageFacts(states=states)}

    [(subject, sentence)] = asked_of(pings()).items()
    assert subject == "changed range_max (m)"
    assert "changed to 60 at 1700000004.000 s, from 30 before" in sentence


def test_what_messages_state_in_turns_is_said_once():
    check, said = MessageCheck(), []
    for index in range(40):  # the last part of a turn of four is shorter
        facts = MessageFacts(states={"sector (rad)": 0.5 if index % 4 == 3 else 1.0})
        message = arrived(Scan(float(index), [], []), facts=facts)
        said += [sentence for _, sentence in check.judge(message, None, float(index))]
    [sentence] = said
    assert "changed to 0.5 at 3.000 s, from 1 before" in sentence


@pytest.mark.parametrize(("std", "is_said"), [(5.0, True), (2.0, False)])
def test_an_error_of_own_ship_that_hides_all_motion_is_said_while_it_is_stated(std, is_said):
    sensor = SensorModel(range_std=0.1, range_std_fraction=0.0, azimuth_std=0.01, max_range=30.0)
    heard = []
    options = dataclasses.replace(settings(own_ship_source="odometry"), sensor=sensor)
    one = Session(options, lambda reason, sentence: heard.append(reason))
    for index in range(30):
        stated = np.diag([std**2, std**2, 0.0]) if index < 20 else None
        one.add_own_ship(
            PoseSample(START + index, 0.0, 0.0, 0.0, covariance=stated, frame_id="map")
        )
        one.add_scan(arrived(Scan(START + index, [9.0 + 0.1 * index], [0.1])), 0.0)
        assert len(list(one.process())) == 1
        if index == 15:
            said = one.figures().findings.get("own_ship_error", "")
            assert ("5 m, detections have 0.3 m at most" in said) is is_said
    assert heard.count("own_ship_error") == is_said
    assert "own_ship_error" not in one.figures().findings


@pytest.mark.parametrize("seconds", [18.0, 37.0, 7200.0])
def test_a_clock_ahead_of_the_arrivals_is_asked_about(seconds):
    ahead = {"detections": {"now": -seconds}, "own ship": {"own_ship": 0.1 + seconds}}
    for name, given in ahead.items():
        said = asked_of(noisy(), **{"now": 0.1, **given}, late=0.05)
        sentence = said[f"clock of {name}"]
        assert f"{seconds:.3g} s ahead" in sentence
        assert ("GPS" in sentence) is (seconds < 40.0)


def test_bearings_that_are_sent_one_after_the_other_are_no_clock_ahead():
    pings = [
        (range_, azimuth, {**more, "time_offset": np.linspace(0.0, 2.9, len(range_))})
        for range_, azimuth, more in noisy()
    ]
    assert asked_of(pings, period=3.0, now=3.0) == {}
    assert "1.5 s ahead" in asked_of(pings, period=3.0, now=1.4)["clock of detections"]


def test_a_clock_behind_by_leap_seconds_is_asked_about_and_others_are_latency():
    assert "18.1 s behind" in asked_of(noisy(), now=18.1)["clock of detections"]
    assert asked_of(noisy(), now=9.0) == {}


def test_stamps_of_a_fast_playback_are_no_clock_ahead():
    check = MessageCheck()
    for index, (range_, azimuth, _) in enumerate(noisy()):
        ping = good_detections(
            round(1e9 * (START + index)),
            "sonar",
            ReadingOptions(),
            range=np.array(range_),
            azimuth=np.array(azimuth),
        )
        assert check.judge(ping.sensor_scan, None, START + 0.1 * index) == []


@pytest.mark.parametrize("apart", ["sectors", "axes"])
def test_two_sonars_on_one_topic_are_asked_about(apart):
    """By turns: sectors to port and to starboard, or one object in two sets of axes."""
    rng = np.random.default_rng(5)
    turn = {"sectors": (1.0, -1.0), "axes": (0.4, 0.4 - math.pi)}[apart]

    def pings():
        for index in range(WINDOW):
            side = turn[index % 2]
            range_ = [900.0 - index + rng.normal(0, 3), *rng.uniform(10, 1500, 4)]
            yield range_, [side + rng.normal(0, 0.005), *(side + rng.uniform(-0.5, 0.5, 4))], {}

    assert "two sonars on one topic" in asked_of(pings())["two_sonars"]


TARGET = slice(100, 110)


@pytest.mark.parametrize("code", [30.0, 29.99, 29.9, 20.0, 65.535, 0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("limit", [30.0, 100.0])
def test_no_return_has_many_codes(code, limit):
    rng = np.random.default_rng(6)
    ranges = np.full(361, code, np.float32).astype(float)
    ranges[TARGET] = 12.0 + rng.normal(0, 0.02, 10)
    left_out = np.any(list(rays_without_detection(ranges, limit).values()), axis=0)
    assert np.flatnonzero(~left_out).tolist() == list(range(100, 110))


def test_echoes_of_a_wall_or_of_a_large_object_are_no_code():
    """Ranges in steps of 0.1 m: a wall ahead, a basin's end, and an object alone."""
    angle = np.radians(np.linspace(-60, 60, 241))
    wall = np.round(20.0 / np.cos(angle), 1)
    basin = np.round(np.minimum(25.0 / np.cos(angle), 6.0 / np.abs(np.sin(angle) + 1e-9)), 1)
    alone = np.full(241, np.inf)
    alone[50:90] = 42.1
    for ranges in (wall, basin, alone):
        found = rays_without_detection(ranges, 50.0)
        assert not any(found[name].any() for name in found if name != "inf")


@pytest.mark.parametrize(
    ("sensor", "mounting", "name"),
    [
        ({}, {}, ""),
        ({"azimuth_std": math.radians(10.0), "azimuth_resolution": 0.7}, {"yaw": math.pi}, ""),
        ({"azimuth_std": 1.0}, {}, "sensor.azimuth_std is 1 rad"),
        ({"azimuth_resolution": 1.0}, {}, "sensor.azimuth_resolution is 1 rad"),
        ({}, {"yaw": 5.0}, "mounting.yaw is 5 rad"),
        ({}, {"yaw": -5.0}, "mounting.yaw is -5 rad"),
    ],
)
def test_parameters_that_look_like_degrees_are_asked_about(sensor, mounting, name):
    asked = check_questions(SensorModel(**sensor), Mounting(**mounting))
    assert len(asked) == bool(name)
    assert all(
        sentence.startswith(name) and "degrees are meant, set" in sentence for sentence in asked
    )


def asked_of_angles(field: str, pings: list[np.ndarray], **options: str) -> list[str]:
    """The questions of a session about the angles of some pings."""
    sentences: list[str] = []

    def report(reason: str, sentence: str) -> None:
        if reason == "degrees":
            sentences.append(sentence)

    session = Session(Settings(), report)
    for index, angles in enumerate(pings):
        values = {"range": np.full(len(angles), 500.0), field: angles}
        ping = detections_of_fields(index * 10**9, "sonar", values, ReadingOptions(**options))
        assert np.abs(ping.scan.azimuth).max(initial=0.0) <= math.pi
        session.add_scan(ping.sensor_scan, now=0.0)
    return sentences


@pytest.mark.parametrize("field", ["azimuth", "bearing"])
@pytest.mark.parametrize("low, high", [(-60.0, 60.0), (0.0, 360.0), (0.0, 400.0)])
def test_angles_in_degrees_and_gradians_are_asked_about_once_with_their_figure(field, low, high):
    rng = np.random.default_rng(1)
    pings = [rng.uniform(low, high, 3) for _ in range(50)]
    [sentence] = asked_of_angles(field, pings)
    largest = max(round(float(np.abs(ping).max())) for ping in pings[:7])
    assert f"beyond 2 pi, up to {largest}:" in sentence and "gradians" in sentence


@pytest.mark.parametrize("low, high", [(-math.pi, math.pi), (0.0, 2 * math.pi), (-0.5, 6.5)])
@pytest.mark.parametrize("reference", ["bow", "north"])
def test_radians_are_not_asked_about(low, high, reference):
    rng = np.random.default_rng(1)
    pings = [rng.uniform(low, high, 20) for _ in range(20)]
    assert asked_of_angles("bearing", pings, bearing_reference=reference) == []
    assert asked_of_angles("azimuth", pings) == []


def test_a_few_odd_angles_are_not_asked_about():
    assert asked_of_angles("azimuth", [np.array([100.0, 0.1, 0.2])] * 30) == []


def heard(made, **more):
    said: dict[str, str] = {}
    return Session(made, said.setdefault, **more), said


@pytest.mark.parametrize("period", [0.1, 12.0])
@pytest.mark.parametrize(("lost", "is_said"), [(0.3, False), (0.55, True), (1.0, True)])
def test_half_of_the_scans_lost_are_said_at_any_rate_of_pings(period, lost, is_said):
    """Also late in a long run: the last scans count."""
    session, said = heard(settings())
    rng = np.random.default_rng(1)
    for index in range(120):
        twice = index > 60 and rng.random() < lost / (1.0 - lost + 1e-9)
        for _ in range(2 if twice and lost < 1.0 else 1):
            stamp = period * (61 if index > 60 and lost == 1.0 else index + 1)
            session.add_scan(arrived(Scan(stamp, [], [])), 0.0)
            list(session.process())
    assert ("lost scan_same_stamp" in said) is is_said
    if is_said:
        sentence = said["lost scan_same_stamp"]
        assert f"of the last {LAST} scans were dropped" in sentence
        assert "Remedy: Look for two drivers" in sentence


def test_a_few_poses_dropped_are_no_cause_of_many_scans_lost():
    dropped = {"own_ship_stale": 100, "own_ship_late": 1}
    assert "Compare the clocks" in explained_by_check("own_ship_stale", dropped, {})
    assert "two publishers" in explained_by_check(
        "own_ship_stale", {**dropped, "own_ship_late": 900}, {}
    )


@pytest.mark.parametrize(("share", "is_said"), [(0.4, False), (0.6, True), (1.0, True)])
def test_half_of_the_detections_lost_are_said(share, is_said):
    losses, said, dropped = LossCheck(), [], Counter()
    for _ in range(30):
        said += losses.drop("range_above_max", "", round(10 * share), dropped)
        said += losses.processed(10 - round(10 * share), dropped)
    assert len(said) == is_said
    if is_said:
        assert f"{100 * share:.0f} % of the detections" in said[0].sentence
        assert "the driver must set `range_max` in m" in said[0].sentence


@pytest.mark.parametrize("reason", ["flagged_bad", "on_land"])
def test_what_is_expected_to_be_lost_is_not_said(reason):
    losses = LossCheck()
    for _ in range(30):
        assert losses.drop(reason, "", 100, Counter()) == []
        assert losses.processed(1, Counter()) == []


def test_scans_without_detections_lose_nothing():
    session, said = heard(settings())
    for index in range(30):
        session.add_scan(UnregisteredScan(Scan(float(index), [], []), "sonar"), 0.0)
        list(session.process())
    assert said == {}


SEEN = ClutterExtent(10.0, 299.0, -1.04, 1.05)
SHORT = SensorModel(max_range=300.0, azimuth_min=-1.0472, azimuth_max=1.0472)


def test_figures_that_fit_are_not_mentioned():
    good = FittedErrors(0.5, 0.0, 0.017, 1.1, 0.9, 150.0)
    assert check_findings(SensorFigures()) == {}
    figures = SensorFigures(sensor=SHORT, seen=SEEN, seen_detections=400, errors=good, confirmed=20)
    assert check_findings(figures) == {}


def test_a_coverage_far_too_large_is_named_with_the_figures_to_set():
    said = check_findings(SensorFigures(seen=SEEN, seen_detections=40))["coverage"]
    assert "sensor.max_range to 300" in said
    assert "sensor.azimuth_min to -1.04" in said
    assert "sensor.azimuth_max to 1.05" in said
    few = SensorFigures(sensor=SensorModel(max_range=480.0), seen=SEEN, seen_detections=6)
    assert check_findings(few) == {}, "six detections may lie together by chance"
    sensor = SensorModel(min_range=5e-324)
    said = check_findings(SensorFigures(sensor=sensor, seen=SEEN, seen_detections=40))["coverage"]
    assert "from 0 to 9000 m" in said
    seen = ClutterExtent(10.0, 199.0, -0.664, 5.52)
    said = check_findings(SensorFigures(seen=seen, seen_detections=80))["coverage"]
    assert "sensor.max_range to 200" in said
    assert "all round" in said
    assert "azimuth" not in said


def test_a_coverage_too_small_is_named_only_where_much_is_lost():
    extent = ClutterExtent(3.0, 812.0, -math.pi, math.pi)
    lost = SensorFigures(sensor=SHORT, outside=90, detections=200, outside_extent=extent)
    said = check_findings(lost)["coverage_too_small"]
    assert "45 %" in said
    assert "sensor.max_range to 820" in said
    few = SensorFigures(sensor=SHORT, outside=90, detections=20000, outside_extent=extent)
    assert check_findings(few) == {}


def test_detections_all_round_about_a_sector_are_asked_for_their_unit():
    sensor = SensorModel(max_range=60.0, azimuth_min=-1.0, azimuth_max=1.0)
    for low, high in ((-3.13, 3.14), (2.39, 8.58)):
        extent = ClutterExtent(0.4, 60.01, low, high)
        lost = SensorFigures(sensor=sensor, outside=90, detections=200, outside_extent=extent)
        said = check_findings(lost)["coverage_too_small"]
        assert "are angles in another unit than rad? Else set sensor.azimuth_min to -3.14" in said
        assert "sensor.azimuth_max to 3.14, unless" in said
        assert "max_range" not in said


def test_a_sector_over_the_seam_is_named_within_the_bounds_of_its_parameters():
    seen = ClutterExtent(10.0, 299.0, 2.5, 6.9)
    said = check_findings(SensorFigures(seen=seen, seen_detections=40))["coverage"]
    assert "sensor.azimuth_min to -3.78, sensor.azimuth_max to 0.617 (m, rad)" in said
    wanted = SensorModel(azimuth_min=-3.78, azimuth_max=0.617)
    assert wanted.covers(100.0, np.array([2.6, 6.8]), 0.0, 0.0).all()


def test_detections_in_the_mirror_of_a_sector_are_asked_about_before_another_sector():
    sensor = SensorModel(max_range=300.0, azimuth_min=0.2, azimuth_max=1.4)
    for low, high, mirrored in ((-1.35, -0.25, True), (0.3, 2.2, False), (-1.4, 1.4, False)):
        extent = ClutterExtent(3.0, 290.0, low, high)
        lost = SensorFigures(sensor=sensor, outside=90, detections=200, outside_extent=extent)
        said = check_findings(lost)["coverage_too_small"]
        assert ("clockwise" in said) is mirrored
        assert "azimuth_min" in said


@pytest.mark.parametrize(
    ("ranges", "advice"),
    [
        ((4000.0, 95_000.0), "give m if they are in mm"),
        ((4000.0, 400_000.0), "set sensor.max_range to"),
        ((40.0, 140.0), "set sensor.max_range to"),
    ],
)
def test_ranges_beyond_the_coverage_are_no_mirror_and_in_mm_only_if_a_thousandth_fits(
    ranges, advice
):
    sensor = SensorModel(max_range=100.0)
    extent = ClutterExtent(*ranges, -1.0, 1.0)
    lost = SensorFigures(sensor=sensor, outside=90, detections=200, outside_extent=extent)
    said = check_findings(lost)["coverage_too_small"]
    assert advice in said
    assert "clockwise" not in said
    assert ("mm" in said) is (advice[:4] == "give")


@pytest.mark.parametrize(
    ("given", "nearest", "named"),
    [(20.0, 3.0, "3"), (20.0, 0.357, "0.35"), (3.0, 3.0, ""), (0.0, 3.0, "")],
)
def test_the_minimum_range_is_named_where_detections_are_nearer(given, nearest, named):
    extent = ClutterExtent(nearest, 812.0, -math.pi, math.pi)
    sensor = SensorModel(min_range=given, max_range=300.0)
    lost = SensorFigures(sensor=sensor, outside=90, detections=200, outside_extent=extent)
    said = check_findings(lost)["coverage_too_small"].partition("sensor.min_range to ")[2]
    assert said.partition(",")[0].partition(" ")[0] == named


@pytest.mark.parametrize(("factor", "said"), [(0.6, True), (0.8, False), (1.4, False), (1.6, True)])
def test_errors_are_named_from_a_factor_on(factor, said):
    errors = FittedErrors(0.0, 0.02, 0.03, factor, 1.0, 150.0)
    found = check_findings(SensorFigures(errors=errors)).get("errors", "")
    assert ("range_std_fraction to 0.02" in found) is said
    assert "azimuth_std" not in found


def test_confirmations_far_above_the_target_rate_are_named():
    many = SensorFigures(confirmed=40, duration=1200.0, false_tracks_per_hour=1.0)
    assert "40 tracks" in check_findings(many)["confirmations"]
    allowed = SensorFigures(confirmed=40, duration=1200.0, false_tracks_per_hour=100.0)
    assert check_findings(allowed) == {}
    assert check_findings(SensorFigures(confirmed=400, duration=1200.0)) == {}, (
        "no rate, no promise"
    )


@pytest.mark.long
def test_a_session_says_each_finding_once_and_again_after_a_reset():
    heard: list[tuple[str, str]] = []
    session = Session(Settings(), lambda subject, said: heard.append((subject, said)))
    rng = np.random.default_rng(2)

    def play(begin: float) -> None:
        for index in range(60):
            number = rng.poisson(20)
            scan = Scan(
                begin + index, 300.0 * np.sqrt(rng.random(number)), rng.uniform(-1.05, 1.05, number)
            )
            session.add_scan(arrived(scan), 0.0)
            list(session.process())

    play(0.0)
    assert [subject for subject, _ in heard] == ["coverage"]
    assert "sensor.max_range to 300" in heard[0][1]
    figures = session.figures()
    assert {key for key, said in figures.findings.items() if said} == {"coverage"}
    assert figures.clutter_density == pytest.approx(20.0 / (1.05 * 300.0**2), rel=0.2)
    assert figures.coverage_area == pytest.approx(1.05 * 300.0**2, rel=0.1)
    session.reset()
    play(100.0)
    assert [subject for subject, _ in heard] == ["coverage", "coverage"]


def test_images_state_their_coverage_so_that_none_is_advised():
    heard: list[str] = []
    session = Session(Settings(), lambda subject, said: heard.append(subject))
    rng = np.random.default_rng(2)
    for index in range(30):
        range_, azimuth = 300.0 * np.sqrt(rng.random(20)), rng.uniform(-1.05, 1.05, 20)
        scan = Scan(float(index), range_, azimuth, features={"standing": np.zeros(20)})
        session.add_scan(arrived(scan), 0.0)
        list(session.process())
    assert "coverage" not in heard


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
        for index in range(first, last):
            clutter = 600.0 * np.sqrt(rng.random(20)), rng.uniform(-math.pi, math.pi, 20)
            target = 100.0 + 0.5 * index + 0.5 * rng.normal(), 0.3 + 0.01 * rng.normal()
            both = [np.append(*pair) for pair in zip(clutter, target, strict=True)]
            session.add_scan(arrived(Scan(float(index), *both)), 0.0)
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
    assert not any(session.figures().findings.values())
    play(110, 200)
    assert [subject for subject, _ in heard if subject != "coverage"] == []
    assert {key for key, said in session.figures().findings.items() if said} <= {"coverage"}


def test_detections_without_errors_name_no_values():
    exact = FittedErrors(1e-6, 0.0, 1e-9, 1e-5, 1e-7, 150.0)
    said = check_findings(SensorFigures(errors=exact))["errors"]
    assert "simulated" in said
    assert "set sensor" not in said


def copies_of(scans):
    """Counts of what is left out of scans (range, azimuth), scans that go on, and what is said."""
    dropped, said = Counter(), []

    def drop(reason, sentence, number):
        dropped[reason] += number
        said.append((reason, sentence))

    check, used = RepetitionCheck(drop), 0
    for index, scan in enumerate(scans):
        used += check.new_in(UnregisteredScan(Scan(2.0 * index, *scan), "sonar")) is not None
    return dropped, used, said


def rays_of(count, copied, *, step=0.0, noise=0.02, seed=3, rays=180):
    """Scans of a lidar, of which runs of rays repeat the scan before in every second one."""
    rng, azimuth = np.random.default_rng(seed), np.linspace(-1.5, 1.5, rays)
    wall, scans = rng.uniform(3.0, 30.0, rays), list[tuple[np.ndarray, np.ndarray]]()
    for k in range(count):
        range_ = wall + noise * rng.standard_normal(rays)
        range_ = np.round(range_ / step) * step if step else range_
        for first, last in copied if k % 2 and k > 1 else ():
            range_[first:last] = scans[-1][0][first:last]
        scans.append((range_, azimuth))
    return scans


@pytest.mark.parametrize("copied", [[(20, 60)], [(0, 90)], [(10, 40), (100, 150)], [(5, 178)]])
def test_a_run_of_rays_that_repeats_the_last_scan_is_counted_and_not_used(copied):
    dropped, results, said = copies_of(rays_of(20, copied))
    number = sum(last - first for first, last in copied)
    assert (dropped, results) == ({"detection_repeated": 9 * number}, 20)
    (sentence, *_) = [text for reason, text in said if reason == "detection_repeated"]
    assert f"{number} of 180 detections at" in sentence


def test_a_session_counts_what_is_repeated_and_uses_the_rest():
    dropped, results, _ = dropped_of(rays_of(8, [(4, 16)], rays=24))
    assert (dropped, results) == ({"detection_repeated": 3 * 12}, 8)


def test_a_detection_that_equals_another_of_its_scan_is_counted_once():
    rng = np.random.default_rng(4)
    scans = [rng.uniform((5.0, -1.0), (90.0, 1.0), (6, 2)).T for _ in range(5)]
    twice = [np.repeat(scan, 2, axis=1) for scan in scans]
    dropped, results, said = copies_of(twice)
    assert (dropped, results) == ({"detection_repeated": 30}, 5)
    assert "6 of 12 detections at 0.000 s equal another of their scan" in said[0][1]
    assert copies_of(scans)[0] == {}


@pytest.mark.parametrize("shift", [lambda k: -1e3 * (k >= 6), lambda k: 1e6 * (k == 6)])
def test_copies_are_found_also_after_stamps_that_went_back_or_one_that_was_ahead(shift):
    rng = np.random.default_rng(4)
    check, copies, scan = RepetitionCheck(lambda *_: None), [], None
    for k in range(12):
        scan = scan if k % 3 == 2 else rng.uniform((5.0, -1.0), (90.0, 1.0), (6, 2)).T
        arrived = UnregisteredScan(Scan(2.0 * k + shift(k), *scan), "sonar")
        copies += [k] if check.new_in(arrived) is None else []
    assert copies == [2, 5, 8, 11]


def test_detections_above_each_other_are_not_equal():
    check, scan = RepetitionCheck(lambda *_: None), Scan(3.0, [40.0] * 3, [0.2] * 3)
    apart = check.new_in(UnregisteredScan(scan, "sonar", height=np.array([0.0, 1.0, 2.0])))
    assert len(apart.scan) == 3
    level = Scan(4.0, scan.range, scan.azimuth)
    assert len(check.new_in(UnregisteredScan(level, "sonar", height=np.zeros(3))).scan) == 1


@pytest.mark.parametrize(
    "sensor",
    [
        {"step": 0.05},  # equal by nature as often as not
        {"step": 0.05, "noise": 0.004},
        {"noise": 0.0},
        {"step": 0.01, "noise": 0.05},
        {"step": 0.25, "noise": 0.02},
    ],
)
def test_equals_by_nature_of_coarse_sensors_and_of_sources_without_noise_are_used(sensor):
    dropped, results, _ = copies_of(rays_of(60, [], **sensor))
    assert (dropped, results) == ({}, 60)


def test_a_target_before_a_scene_without_noise_makes_no_copies_of_the_scene():
    scans = rays_of(60, [], noise=0.0)
    for k, (range_, _) in enumerate(scans):
        range_[2 * k : 2 * k + 10] = 2.0 + 0.001 * k
    assert copies_of(scans)[:2] == ({}, 60)
