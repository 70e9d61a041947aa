"""Questions about messages: what a driver sends when it means something else."""

import dataclasses
import math

import numpy as np
import pytest

from msg_adapters.laser_scan_detections import no_returns
from msg_adapters.ping import ReadingOptions, good_detections
from tsepm_ros.own_ship.registration import MessageFacts
from tsepm_ros.session.consistency_checks import WINDOW, MessageCheck

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
    assert "from 30 to 60 at 1700000004.000 s" in sentence


@pytest.mark.parametrize("seconds", [18.0, 37.0, 7200.0])
def test_a_clock_ahead_of_the_arrivals_is_asked_about(seconds):
    ahead = {"detections": {"now": -seconds}, "own ship": {"own_ship": 0.1 + seconds}}
    for name, given in ahead.items():
        said = asked_of(noisy(), **{"now": 0.1, **given}, late=0.05)
        sentence = said[f"clock of {name}"]
        assert f"{seconds:.3g} s ahead" in sentence
        assert ("GPS" in sentence) is (seconds < 40.0)


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
    left_out = np.any(list(no_returns(ranges, limit).values()), axis=0)
    assert np.flatnonzero(~left_out).tolist() == list(range(100, 110))


def test_echoes_of_a_wall_or_of_a_large_object_are_no_code():
    """Ranges in steps of 0.1 m: a wall ahead, a basin's end, and an object alone."""
    angle = np.radians(np.linspace(-60, 60, 241))
    wall = np.round(20.0 / np.cos(angle), 1)
    basin = np.round(np.minimum(25.0 / np.cos(angle), 6.0 / np.abs(np.sin(angle) + 1e-9)), 1)
    alone = np.full(241, np.inf)
    alone[50:90] = 42.1
    for ranges in (wall, basin, alone):
        found = no_returns(ranges, 50.0)
        assert not any(found[name].any() for name in found if name != "inf")
