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
"""Several sensors make one picture: each looks at its own times, at its own coverage."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.methods.score import Score
from tsepm_ros.tracker.tracker import Tracker

FAST = SensorModel(
    range_std=2.0,
    range_std_fraction=0.0,
    azimuth_std=0.01,
    max_range=500.0,
    detection_probability=0.9,
    clutter_density=2e-7,
)
"""A sensor that sees 0.16 false detections a scan."""
SLOW = replace(FAST, max_range=1500.0, clutter_density=4e-7)
"""Another one, with 2.8."""


def seen(
    rng: np.random.Generator, model: SensorModel, stamp: float, targets: Sequence, name: str
) -> Scan:
    """A scan of targets (x, vx, y, vy) at time 0 and of clutter, uniform in area."""
    number = rng.poisson(model.clutter_density * model.coverage_area)
    range_ = model.max_range * np.sqrt(rng.uniform(1e-4, 1.0, number))
    azimuth = rng.uniform(-math.pi, math.pi, number)
    places = np.array([(x + stamp * vx, y + stamp * vy) for x, vx, y, vy in targets])
    places = places.reshape(-1, 2)[rng.random(len(targets)) < model.detection_probability]
    distance, direction = np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0])
    covered = model.covers(distance, direction)
    noise = rng.standard_normal((2, covered.sum()))
    return Scan(
        stamp,
        np.append(range_, np.abs(distance[covered] + model.range_std * noise[0])),
        np.append(azimuth, direction[covered] + model.azimuth_std * noise[1]),
        sensor=name,
    )


def scans_of(
    seed: int,
    models: Mapping[str, SensorModel],
    intervals: Mapping[str, float],
    duration: float,
    targets: Sequence = (),
    vanish: float = math.inf,
) -> list[Scan]:
    """The scans of sensors, in the order of their stamps; equal ones of two sensors too.

    The targets vanish at a time, s.
    """
    rng = np.random.default_rng(seed)
    times = sorted(
        (k * interval, name)
        for name, interval in intervals.items()
        for k in range(round(duration / interval))
    )
    return [
        seen(rng, models[name], stamp, targets if stamp < vanish else (), name)
        for stamp, name in times
    ]


def near(initiator: Tracker, target: Sequence, stamp: float) -> set[int]:
    """Ids of the current tracks within 30 m of a target."""
    x, vx, y, vy = target
    place = np.array([x + stamp * vx, y + stamp * vy])
    away = np.hypot(*(initiator.current.state[:, 0::2] - place).T)
    return set(initiator.current.track_id[away < 30.0].tolist())


BOTH = {"fast": FAST, "slow": SLOW}
TARGETS = ((300.0, -1.0, 100.0, 1.0), (900.0, 1.0, -600.0, -1.0))
"""One that both see, and one that only the slow sensor sees."""


def test_beside_a_fast_sensor_a_slow_one_finds_what_only_it_sees_and_a_track_keeps_its_id():
    found = []
    for seed in range(2):
        initiator = make_initiator("score", sensor=BOTH, max_speed=5.0, false_tracks_per_hour=10.0)
        ids = [set(), set()]
        for scan in scans_of(seed, BOTH, {"fast": 0.2, "slow": 6.0}, 50.0, TARGETS):
            initiator.process(scan)
            for known, target in zip(ids, TARGETS, strict=True):
                known |= near(initiator, target, scan.stamp)
        assert len(ids[0]) == 1, "no scan of another coverage ends a track or doubles it"
        found.append(len(ids[1]))
    assert found == [1, 1], "in 16 scans of the fast sensor the slow one has one at most"


def test_a_sensor_that_falls_silent_ends_no_track_of_another_and_its_own_end():
    models = {"near": replace(FAST, azimuth_min=-1.0, azimuth_max=1.0), "far": SLOW}
    target = (-900.0, 0.5, 400.0, 0.5)  # the near one never looks there
    both = scans_of(2, models, {"near": 2.0, "far": 2.0}, 240.0, [target])
    initiator = make_initiator("score", sensor=models, max_speed=5.0, false_tracks_per_hour=10.0)
    for scan in both:
        if scan.sensor == "near" or scan.stamp < 60.0:
            initiator.process(scan)
        if scan.stamp == 58.0:
            assert near(initiator, target, scan.stamp)
    assert not near(initiator, target, 240.0), "nobody looks there"
    assert initiator.sensor.number == 0
    assert initiator.sensors.picture(initiator.sensor, initiator.scan_index).living == (0,)


def test_equal_stamps_of_two_sensors_are_taken_and_stamps_rise_within_each():
    initiator = make_initiator("score", sensor=BOTH)
    for name in BOTH:
        initiator.process(Scan(5.0, [100.0], [0.0], sensor=name))
    with pytest.raises(ValueError, match=r"later than the last scan's; got 5\.0 after 5\.0"):
        initiator.process(Scan(5.0, [], [], sensor="fast"))
    initiator.process(Scan(7.0, [], [], sensor="slow"))
    with pytest.raises(ValueError, match=r"not be before the last scan of another sensor; got 6"):
        initiator.process(Scan(6.0, [], [], sensor="fast"))
    assert (initiator.scan_index, initiator.totals.scans) == (2, 3)
    assert [state.scans for state in initiator.sensors.values()] == [1, 2]


@pytest.mark.parametrize("name", ["", "other"])
def test_a_scan_of_an_unknown_sensor_is_refused_and_nothing_changes(name):
    initiator = make_initiator("score", sensor=BOTH)
    with pytest.raises(ValueError, match=r"sensor must be one of \['fast', 'slow'\]; got"):
        initiator.process(Scan(5.0, [100.0], [0.0], sensor=name))
    assert initiator.stamp is None and initiator.totals.scans == 0


def test_a_single_sensor_takes_scans_without_a_name_and_refuses_another_s():
    initiator = make_initiator("score", sensor={"sonar": FAST})
    initiator.process(Scan(0.0, [], []))
    initiator.process(Scan(1.0, [], [], sensor="sonar"))
    with pytest.raises(ValueError, match=r"one of \['sonar'\]; got 'radar'"):
        initiator.process(Scan(2.0, [], [], sensor="radar"))


def test_a_single_sensor_with_a_name_has_the_tracks_of_a_sensor_without_a_name():
    rng, targets = np.random.default_rng(4), [(100.0, 2.0, 50.0, 1.0), (-200.0, 1.0, 80.0, -2.0)]
    scans = [seen(rng, FAST, float(stamp), targets, "sonar") for stamp in range(30)]
    named = make_initiator("score", sensor={"sonar": FAST})
    plain = make_initiator("score", sensor=FAST)
    for scan in scans:
        named.process(scan)
        plain.process(scan.replaced(sensor=""))
    assert named.seen_by(named.current).tolist() == [1, 1]
    np.testing.assert_array_equal(named.current.state, plain.current.state)


@pytest.mark.long
@pytest.mark.parametrize("third", [{}, {"silent": SLOW}])
def test_things_that_one_sensor_sees_each_are_no_doubled_target(third):
    """A boat that both see, a rock for the sonar alone, a buoy for the radar, as far away."""
    sonar = replace(FAST, range_std=1.0, azimuth_min=-0.8, azimuth_max=0.8)
    sensors = {"sonar": sonar, "radar": replace(SLOW, range_std=5.0, azimuth_std=0.02)} | third
    initiator, rng, ended = make_initiator("score", sensor=sensors), np.random.default_rng(1), set()
    for stamp in range(200):
        boat = 250.0 + 30.0 * math.sin(0.06 * stamp), 0.0, -120.0, 0.0
        for name, turn in (("sonar", 0.18), ("radar", 0.3)):
            fixed = 200.0 * math.cos(turn), 0.0, 200.0 * math.sin(turn), 0.0
            late = 0.4 * (name == "radar")
            scan = seen(rng, sensors[name], float(stamp), [boat, fixed], name)
            initiator.process(scan.replaced(stamp=stamp + late))
            ended |= set(initiator.maintenance.ended.values())
    assert "duplicate" not in ended
    assert not any(one.sentence("a", 0.0) for one in initiator.misalignments.values())


@pytest.mark.long
@pytest.mark.parametrize(("late", "yaw_rate"), [(0.5, 0.0), (0.5, 0.05), (0.0, 0.05)])
def test_late_stamps_of_a_sensor_under_way_are_told_from_its_mounting(late, yaw_rate):
    """Own ship at 5 m/s, straight and on a turn, meets four targets."""
    sensors = {name: replace(FAST, range_std=1.0, max_range=3000.0) for name in ("a", "b")}
    initiator, rng = make_initiator("score", sensor=sensors), np.random.default_rng(2)
    targets = ((700.0, 100.0), (1500.0, 150.0), (1200.0, -150.0), (900.0, -80.0))
    for count in range(140):
        for name, shift, wrong in (("a", 0.0, 0.0), ("b", 0.4, late)):
            stamp = count + shift

            def pose(time: float) -> tuple[complex, float]:
                yaw = yaw_rate * time
                way = np.expm1(1j * yaw) / (1j * yaw_rate) if yaw_rate else time
                return 5.0 * complex(way), yaw

            at, yaw = pose(stamp - wrong)
            arms = np.array(
                [x - (stamp - wrong) * (1.0 + i) + 1j * y - at for i, (x, y) in enumerate(targets)]
            ) * np.exp(-1j * yaw)
            arms = arms[rng.random(4) < 0.9]
            position, stated = pose(stamp)
            initiator.process(
                Scan(
                    stamp,
                    np.abs(arms) + rng.standard_normal(len(arms)),
                    np.angle(arms) + 0.01 * rng.standard_normal(len(arms)),
                    sensor=name,
                    sensor_pose=(position.real, position.imag, stated),
                )
            )
    found = initiator.misalignments["b"]
    assert abs(found.time - late) < 4.0 * found.time_error < 0.5
    assert abs(found.azimuth) < 4.0 * found.azimuth_error
    assert ("later" in found.sentence("b", 0.0)) is (late > 0.0)
    assert "mounting" not in found.sentence("b", 0.0)


def test_a_method_that_takes_one_sensor_refuses_several_with_a_sentence():
    with pytest.raises(ValueError, match="'tsepm' takes one sensor; 'score' takes several"):
        make_initiator("tsepm", sensor=BOTH)
    with pytest.raises(ValueError, match="a sensor at least"):
        make_initiator("score", sensor={})
    assert make_initiator("tsepm", sensor={"sonar": FAST}).sensor.model is FAST


def test_what_is_learned_is_each_sensor_s_own_and_outlives_other_options():
    initiator = make_initiator("score", sensor=BOTH, max_speed=5.0)
    for scan in scans_of(3, BOTH, {"fast": 0.5, "slow": 3.0}, 120.0, TARGETS[:1]):
        initiator.process(scan)
    fast, slow = initiator.sensors.values()
    assert (fast.interval, slow.interval) == pytest.approx((0.5, 3.0))
    for state, model in ((fast, FAST), (slow, SLOW)):
        expected = model.clutter_density
        assert 0.4 * expected < state.learned.clutter_map.mean < 2.5 * expected
    other, kept = initiator.with_settings(
        Score(FAST, replace(initiator.common, max_speed=6.0), initiator.options)
    )
    with pytest.raises(ValueError, match="Tsepm takes one sensor, and there are several"):
        initiator.with_settings(make_initiator("tsepm", sensor=FAST).method)
    assert kept and [state.model for state in other.sensors.values()] == [FAST, SLOW]
    assert other.sensors["slow"].learned.clutter_map is slow.learned.clutter_map
    other.process(Scan(121.0, [], [], sensor="slow"))
    other.reset()
    assert [state.scans for state in other.sensors.values()] == [0, 0]


def test_the_threshold_counts_the_starts_of_all_living_sensors():
    initiator = make_initiator("score", sensor=BOTH, false_tracks_per_hour=1.0)
    scans = scans_of(4, BOTH, {"fast": 1.0, "slow": 2.0}, 200.0)
    shares = []
    for scan in scans:
        if scan.sensor == "fast" or scan.stamp < 150.0:
            initiator.process(scan)
        if scan.stamp in (148.0, 199.0) and scan.sensor == "fast":
            shares.append(initiator.method._threshold.false_share(1.0))
    areas = [model.clutter_density * model.coverage_area for model in (FAST, SLOW)]
    both, one = 3600.0 * (areas[0] + areas[1] / 2.0), 3600.0 * areas[0]
    assert 1.0 / shares[0] == pytest.approx(both, rel=0.35)
    assert 1.0 / shares[1] < 2.5 * one + 3600.0, "a silent sensor starts no tracks"


def test_in_clutter_alone_the_picture_keeps_the_rate_that_is_promised():
    false, hours = 0, 0.0
    models = {"fast": replace(FAST, clutter_density=3e-6), "slow": replace(SLOW)}
    for seed in range(2):
        initiator = make_initiator(
            "score", sensor=models, max_speed=5.0, false_tracks_per_hour=100.0
        )
        for scan in scans_of(seed, models, {"fast": 1.0, "slow": 2.5}, 300.0):
            false += len(initiator.process(scan))
        hours += 300.0 / 3600.0
    # Of a Poisson number of mean 16.7, more than 28 have a probability of 0.003.
    assert false <= 28, f"{false} in {hours} h"


@pytest.mark.long
def test_at_rates_twice_and_half_as_high_targets_are_found_and_end_at_the_same_times():
    """They vanish at 10 s."""
    times = []
    for factor in (1.0, 0.5, 2.0):
        initiator = make_initiator("score", sensor=BOTH, max_speed=5.0, false_tracks_per_hour=10.0)
        first, last = {}, {}
        intervals = {"fast": 0.1 * factor, "slow": 0.2 * factor}
        for scan in scans_of(7, BOTH, intervals, 22.0, TARGETS, vanish=10.0):
            initiator.process(scan)
            for row, target in enumerate(TARGETS):
                if near(initiator, target, scan.stamp):
                    first.setdefault(row, scan.stamp)
                    last[row] = scan.stamp
        times.append([first[0], first[1], last[0], last[1]])
    apart = np.abs(np.array(times) - times[0]).max(axis=0)
    # A target that one sensor sees may have faded. Each scan may see it then, by FADED_FACTOR.
    assert np.all(apart <= [1.5, 1.5, 1.5, 2.0]), times
    assert times[0][3] > 14.0, "of one sensor a target may have faded"


AROUND = tuple(
    (300.0 * math.cos(turn), math.cos(2.0 + turn**2), 300.0 * math.sin(turn), math.sin(turn**2))
    for turn in (0.3, 1.5, 2.7, 4.0, 5.2)
)
"""Five targets that two sensors see, within 450 m."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("turn", "longer", "late", "said"),
    [
        (0.0, 0.0, 0.0, ""),
        (0.5, 0.0, 0.0, "port sees targets"),
        (3.0, 0.0, 0.0, "port sees targets"),  # each target has two tracks first
        (0.0, 2.0, 0.0, "port measures ranges"),
        (0.0, 0.0, 2.0, "port has stamps"),
    ],
)
def test_a_sensor_that_lies_beside_another_is_said_with_its_size_and_is_not_corrected(
    turn, longer, late, said
):
    models = {"port": FAST, "starboard": replace(FAST, max_range=600.0)}
    initiator = make_initiator("score", sensor=models, max_speed=5.0, false_tracks_per_hour=30.0)
    assert initiator.misalignments == {}, "nothing is known yet"
    duration = 60.0 if turn < 3.0 else 110.0  # gates are too small for it until it is known
    scans = scans_of(5, models, {"port": 1.0, "starboard": 1.3}, duration, AROUND)
    for k, scan in enumerate(scans):
        if scan.sensor == "port":
            azimuth, stamp = scan.azimuth + math.radians(turn), scan.stamp + late
            scans[k] = scan.replaced(azimuth=azimuth, range=scan.range + longer, stamp=stamp)
    for scan in sorted(scans, key=lambda scan: scan.stamp):
        initiator.process(scan)
    found = initiator.misalignments["port"]
    assert math.degrees(found.azimuth) == pytest.approx(turn, abs=0.2 + 0.05 * turn)
    assert found.range == pytest.approx(longer, abs=0.6)
    assert found.time == pytest.approx(late, abs=0.6)
    assert found.azimuth == pytest.approx(-initiator.misalignments["starboard"].azimuth)
    sentence = found.sentence("port")
    assert sentence.startswith(said) and bool(sentence) == bool(said)
    assert initiator.sensors["port"].sensor_in_use.azimuth_std >= 0.5 * FAST.azimuth_std
    assert len(initiator.current) == len(AROUND), "of two tracks of a target the later one ended"


@pytest.mark.parametrize("turn", [0.0, 3.0])
def test_errors_are_followed_down_no_further_than_the_tracks_of_another_sensor_show(turn):
    """Of stated errors three times too large, 1.7 degrees, which hide a wrong mounting."""
    models = {"port": FAST, "starboard": replace(FAST, max_range=600.0)}
    stated = {name: replace(model, azimuth_std=0.03) for name, model in models.items()}
    initiator = make_initiator("score", sensor=stated, max_speed=5.0, false_tracks_per_hour=30.0)
    doubled = 0
    for scan in scans_of(5, models, {"port": 1.0, "starboard": 1.3}, 90.0, AROUND):
        if scan.sensor == "port":
            scan = scan.replaced(azimuth=scan.azimuth + math.radians(turn))
        initiator.process(scan)
        doubled += len(initiator.current) > len(AROUND)
    factors = [one.sensor_in_use.azimuth_std / 0.03 for one in initiator.sensors.values()]
    assert len(initiator.current) == len(AROUND)
    assert doubled == 0
    assert np.all(np.array(factors) >= 0.6) if turn else np.all(np.array(factors) <= 0.4)


@pytest.mark.parametrize("turn", [0.0, 6.0])
def test_a_wrong_mounting_is_known_where_it_turns_tracks_out_of_the_little_that_both_cover(turn):
    """Of a target that both see, the port track is beyond the starboard coverage of 5 degrees."""
    sectors = {"port": (-0.087, 1.5), "starboard": (-1.5, 0.087)}
    models = {
        name: replace(FAST, azimuth_min=first, azimuth_max=last)
        for name, (first, last) in sectors.items()
    }
    wrong = math.radians(turn)
    turned = models | {"port": replace(FAST, azimuth_min=-0.087 - wrong, azimuth_max=1.5 - wrong)}
    ships = [(distance, 0.3, 0.03 * distance, 0.0) for distance in (150.0, 250.0, 350.0)]
    initiator = make_initiator("score", sensor=models, max_speed=5.0, false_tracks_per_hour=30.0)
    for scan in scans_of(5, turned, {"port": 1.0, "starboard": 1.3}, 100.0, ships):
        if scan.sensor == "port":
            scan = scan.replaced(azimuth=scan.azimuth + wrong)
        initiator.process(scan)
    found = initiator.misalignments["port"]
    assert math.degrees(found.azimuth) == pytest.approx(turn, abs=0.4)
    assert bool(found.sentence("port")) == bool(turn)
    assert len(initiator.current) == len(ships)


def test_two_ships_that_each_sensor_sees_alone_are_no_wrong_mounting():
    """They sail alike, each where only one sensor looks."""
    models = {
        "port": replace(FAST, azimuth_min=0.05, azimuth_max=1.5),
        "starboard": replace(FAST, azimuth_min=-1.5, azimuth_max=-0.05),
    }
    ships = [(300.0, 1.0, 25.0, 0.0), (300.0, 1.0, -25.0, 0.0)]
    initiator = make_initiator("score", sensor=models, max_speed=5.0, false_tracks_per_hour=30.0)
    for scan in scans_of(6, models, {"port": 1.0, "starboard": 1.3}, 100.0, ships):
        initiator.process(scan)
    assert len(initiator.current) == 2
    assert initiator.misalignments == {}


def test_tracks_are_told_which_sensors_saw_them_lately_and_which_hit_their_start():
    initiator = make_initiator("score", sensor=BOTH, max_speed=5.0, false_tracks_per_hour=10.0)
    said, seen = {}, {}
    for scan in scans_of(3, BOTH, {"fast": 0.5, "slow": 2.0}, 60.0, TARGETS):
        if scan.sensor == "fast" and scan.stamp > 40.0:
            continue
        new = initiator.process(scan)
        said |= {track.track_id: initiator.reason(track) for track in new}
        assert all(initiator.seen_by(new)), "by its hits"
        current = initiator.current
        for number, target in enumerate(TARGETS):
            for track in near(initiator, target, scan.stamp):
                [row] = np.flatnonzero(current.track_id == track)
                seen.setdefault(number, {})[scan.stamp] = int(initiator.seen_by(current)[row])
    assert seen[0][39.5] == 0b11 and seen[1][39.5] == 0b10
    assert seen[0][58.0] == 0b10, "the fast one is silent since 40 s"
    assert any("; hits of fast" in one for one in said.values())
    assert any("; hits of slow" in one and "fast" not in one for one in said.values())


def test_to_ask_who_saw_a_track_changes_nothing():
    asked, other = (make_initiator("score", sensor=BOTH, max_speed=5.0) for _ in range(2))
    for scan in scans_of(3, BOTH, {"fast": 0.5, "slow": 2.0}, 40.0, TARGETS):
        asked.process(scan)
        other.process(scan)
        asked.seen_by(asked.current)
        assert asked.sensor.seen == other.sensor.seen
    np.testing.assert_array_equal(asked.current.state, other.current.state)
