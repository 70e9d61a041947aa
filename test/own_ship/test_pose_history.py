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
"""Where the sensor was: interpolation, rates, attitude and coverage, and poses of echoes."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from tsepm_ros.own_ship.pose_history import (
    MIN_SAMPLE_PERIOD,
    FrozenCheck,
    PoseCoverage,
    PoseHistory,
    PoseSample,
    echo_poses,
    known_pose_rates,
    pose_jump,
)

YES, NOT_YET, NEVER = PoseCoverage.YES, PoseCoverage.NOT_YET, PoseCoverage.NEVER


def history(*samples, **options) -> PoseHistory:
    poses = PoseHistory(**options)
    for stamp, x, y, yaw in samples:
        assert poses.add(PoseSample(stamp, x, y, yaw))
    return poses


def circling(times, **options) -> PoseHistory:
    """A circle of 100 m at 0.05 rad/s, 5 m/s, from samples that know no rates."""
    turn = 0.05 * np.asarray(times)
    path = (times, 100 * np.sin(turn), -100 * np.cos(turn), turn)
    return history(*np.transpose(path).tolist(), **options)


def circle_rates(times):
    turn = 0.05 * np.asarray(times)
    return np.transpose([5.0 * np.cos(turn), 5.0 * np.sin(turn), np.full(len(turn), 0.05)])


def test_rates_that_the_samples_do_not_know_are_differences_of_the_poses():
    # Sampled at 10 Hz; the chord of 2 s is 0.04 % short.
    poses = circling(np.arange(0.0, 60.0, 0.1), max_extrapolation=3.0)
    times = np.array([5.0, 20.0, 33.3, 58.0])
    np.testing.assert_allclose(poses.rates(times, 59.0), circle_rates(times), atol=0.005)
    # Where the history begins, of the next second there is; what is beyond the last echo is not
    # used, and what is beyond the history is not there.
    for time, last, at in (
        (0.0, 59.0, 0.5),
        (20.0, 20.0, 19.0),
        (59.9, 59.9, 58.9),
        (62, 62, 58.9),
    ):
        found = poses.rates(np.array([time]), last)
        np.testing.assert_allclose(found, circle_rates([at]), atol=0.005)


def test_velocity_and_yaw_rate_that_samples_know_are_interpolated_each_by_itself():
    poses = PoseHistory(max_extrapolation=5.0)
    for stamp, rates in ((0.0, (1.0, 2.0, 0.1)), (10.0, (3.0, -2.0, 0.3)), (20.0, None)):
        poses.add(PoseSample(stamp, 100.0 * stamp, 0.0, 0.0, rates=rates))
    found = poses.rates(np.array([0.0, 2.5, 10.0, 15.0, 22.0]), 22.0)
    drawn = [100.0, 0.0, 0.0]
    expected = [[1.0, 2.0, 0.1], [1.5, 1.0, 0.15], [3.0, -2.0, 0.3], drawn, drawn]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    poses = PoseHistory(max_extrapolation=1.0)
    for stamp in (0.0, 1.0):
        rates = known_pose_rates(3.0, 4.0, 0.0)
        poses.add(PoseSample(stamp, 100.0 * stamp, 0.0, 0.2 * stamp, rates=rates))
    np.testing.assert_allclose(poses.rates(np.array([0.5]), 1.0), [[3.0, 4.0, 0.2]])
    np.testing.assert_allclose(poses.poses(np.array([1.5]))[:, :3], [[101.5, 2.0, 0.3]])
    np.testing.assert_array_equal(known_pose_rates(0.0, 0.0, 0.1), [math.nan, math.nan, 0.1])
    assert known_pose_rates(0.0, -1.0, 0.1) == (0.0, -1.0, 0.1)


def test_rates_are_not_taken_across_a_gap_nor_from_poses_of_a_moment():
    samples = ((0.0, 0, 0, 0), (100.0, 5000, 0, 0), (100.5, 5001, 0, 0), (102.0, 5004, 0, 0))
    poses = history(*samples, max_gap=10.0)
    found = poses.rates(np.array([100.0, 100.2, 102.0]), 102.0)
    np.testing.assert_allclose(found, [[2, 0, 0]] * 3, atol=1e-9)
    poses = history(*((0.1 * k, 0.3 * k, 0.0, 0.0) for k in range(20)))
    found = poses.rates(np.array([0.2, 0.35]), 0.35)
    assert np.isnan(found).all(), "of 0.4 s"
    found = poses.rates(np.array([0.2, 0.35]), 0.55)
    np.testing.assert_allclose(found, [[3.0, 0.0, 0.0]] * 2, atol=1e-12)


def test_rates_of_which_nothing_is_known_are_nan():
    poses = PoseHistory()
    assert np.isnan(poses.rates(np.array([3.0]), 3.0)).all()
    assert poses.rates(np.zeros(0), 0.0).shape == (0, 3)
    poses.add(PoseSample(1.0, 5.0, 6.0, 0.0))
    assert np.isnan(poses.rates(np.array([1.0]), 1.0)).all()
    poses.clear()
    poses.add(PoseSample(1.0, 5.0, 6.0, 0.0, rates=(1.5, -2.0, 0.1)))
    assert poses.rates(np.array([1.0, 2.0]), 2.0).tolist() == [[1.5, -2.0, 0.1]] * 2


@pytest.mark.parametrize(
    ("rate", "known"), [(3.0, True), (10.0, False), (10.0, True), (150.0, False), (1000.0, True)]
)
def test_what_is_covered_is_answered_to_the_bit_as_with_all_later_samples(rate, known):
    rng = np.random.default_rng([8, int(rate), known])
    stamps = 1.7e9 + np.cumsum(rng.uniform(0.2, 1.8, int(40 * rate)) / rate)
    noisy = rng.normal(0.0, 3.0, (len(stamps), 6)).tolist()
    samples = [
        PoseSample(stamp, *values[:3], rates=tuple(values[3:]) if known else None)
        for stamp, values in zip(stamps.tolist(), noisy, strict=True)
    ]
    growing, whole = PoseHistory(max_extrapolation=0.1), PoseHistory(max_extrapolation=0.1)
    for sample in samples:
        whole.add(sample)
    spans = [(stamps[0] - 0.05, stamps[0] - 0.01), (stamps[0], stamps[1])]
    for last in rng.choice(stamps[len(stamps) // 2 : -4], 20).tolist():
        spans += [(last - 12.0, last), (last - 0.4 / rate, last - 0.3 / rate)]
    for first, last in sorted(spans, key=lambda span: span[1]):
        while growing.coverage(first, last) is NOT_YET and samples:
            growing.add(samples.pop(0))
        inside = stamps[(stamps >= first) & (stamps <= last)]
        times = np.concatenate([rng.uniform(first, last, 20), [first, last], inside])
        for find in ("poses", "rates"):
            more = (last,) if find == "rates" else ()
            found, expected = (getattr(one, find)(times, *more) for one in (growing, whole))
            np.testing.assert_array_equal(found, expected, err_msg=find)
    assert samples, "the last spans end before the samples do"


@pytest.mark.parametrize(
    ("before", "after", "middle"),
    [
        (3.1, -3.1, math.pi),
        (-3.1, 3.1, math.pi),
        (3.0, -3.0 + 4 * math.pi, math.pi),
        (0.1, 6.2, 0.1 - (0.1 - (6.2 - 2 * math.pi)) / 2),
    ],
)
def test_the_yaw_turns_the_short_way_across_pi(before, after, middle):
    (pose,) = history((0.0, 0, 0, before), (10.0, 0, 0, after)).poses([5.0])[:, :3]
    assert math.remainder(pose[2] - middle, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)


TWO = ((10.0, 0.0, 100.0, 0.0), (20.0, 50.0, 80.0, 1.0))


@pytest.mark.parametrize(("time", "ends"), [(22.0, True), (22.001, False), (8.0, True)])
def test_extrapolation_ends_where_it_may(time, ends):
    poses = history(*TWO, max_extrapolation=2.0)
    if ends:
        expected = np.array(TWO[0][1:]) + (time - 10.0) / 10.0 * np.array([50.0, -20.0, 1.0])
        np.testing.assert_allclose(poses.poses([time])[:, :3], [expected])
        return
    with pytest.raises(ValueError, match="no pose is known"):
        poses.poses([time])


def test_the_oldest_samples_give_way():
    poses = history(
        *((float(k), float(k), 0.0, 0.0) for k in range(20)), min_samples=5, min_span=3.0
    )
    assert len(poses) == 5
    assert poses.coverage(14.9, 16.0) is NEVER
    assert poses.coverage(15.0, 19.0) is YES
    poses = history(*((float(k), float(k), 0.0, 0.0) for k in range(20)), min_samples=5, min_span=7)
    assert len(poses) == 8, "not while they are young"


def kilohertz(last: float, **options) -> PoseHistory:
    poses = PoseHistory(**options)
    for k in range(round(1000 * last) + 1):
        assert poses.add(PoseSample(k / 1000, k / 1000, 0.0, 0.0))
    return poses


def test_the_newest_of_thinned_samples_is_the_newest_given_at_any_rate():
    assert len(kilohertz(30.0, min_samples=10, min_span=2.0)) < 2.0 / MIN_SAMPLE_PERIOD + 2
    poses = kilohertz(30.0)
    assert len(poses) < 30.0 / MIN_SAMPLE_PERIOD
    assert poses.coverage(17.0, 29.0) is YES
    np.testing.assert_allclose(poses.poses([17.0, 29.0])[:, 0], [17.0, 29.0])
    poses = kilohertz(5.004, max_extrapolation=1.0)
    assert poses.last_stamp == 5.004
    assert poses.can_extrapolate(6.004)
    assert not poses.can_extrapolate(6.005)
    np.testing.assert_allclose(poses.poses([5.003, 5.004, 6.0])[:, 0], [5.003, 5.004, 6.0])


def test_a_second_run_is_as_long_as_it_is_at_any_rate():
    poses = history((100.0, 0, 0, 0), min_samples=10, min_span=2.0)
    for k in range(20_000):
        assert not poses.add(PoseSample(k / 1000, 5.0, 0.0, 0.0))
    assert poses.late_span == pytest.approx(19.999)
    poses.start_over()
    assert poses.last_stamp == 19.999
    assert poses.late_span == 0.0
    assert poses.coverage(18.5, 19.5) is YES


def test_poses_wait_for_a_second_sample_and_never_for_a_gap_before_the_newest():
    poses = history((10.0, 0.0, 0.0, 0.0), max_extrapolation=1.0)
    assert poses.coverage(9.5, 9.6) is NOT_YET
    assert poses.coverage(10.0, 10.0) is YES
    poses.add(PoseSample(11.0, 2.0, 0.0, 0.0))
    assert poses.coverage(9.5, 9.6) is YES
    poses = history((0.0, 0.0, 0.0, 0.0), (130.0, 10.0, 0.0, 0.0), max_gap=60.0)
    assert poses.coverage(120.0, 130.05) is NEVER
    assert poses.coverage(130.0, 130.05) is NOT_YET
    assert poses.coverage(131.0, 132.0) is NOT_YET


@pytest.mark.parametrize(
    ("first", "last"),
    [(4.0, 9.0), (10.0, 10.0), (171.0, 171.0), (171.0, 175.0)],
    ids=["before", "up to its begin", "at its end", "from its end"],
)
def test_a_gap_beside_the_asked_for_span_does_no_harm(first, last):
    samples = ((0.0, 0, 0, 0), (10.0, 10, 0, 0), (171.0, 171, 0, 0), (180.0, 180, 0, 0))
    poses = history(*samples, max_gap=60.0)
    assert poses.coverage(first, last) is YES
    np.testing.assert_allclose(poses.poses([first, last])[:, 0], [first, last])


def test_the_covariance_is_that_of_the_nearest_sample():
    poses = PoseHistory()
    poses.add(PoseSample(0.0, 0, 0, 0, covariance=np.eye(3)))
    poses.add(PoseSample(10.0, 0, 0, 0, covariance=2 * np.eye(3)))
    poses.add(PoseSample(20.0, 0, 0, 0))
    assert poses.covariance(4.9)[0, 0] == 1.0
    assert poses.covariance(5.1)[0, 0] == 2.0
    assert poses.covariance(16.0) is None
    assert PoseHistory().covariance(0.0) is None


def tilted(*samples, **options) -> PoseHistory:
    """Samples of stamp, yaw, roll and pitch."""
    poses = PoseHistory(**options)
    for stamp, yaw, roll, pitch in samples:
        assert poses.add(PoseSample(stamp, 0.0, 0.0, yaw, roll=roll, pitch=pitch))
    return poses


def test_roll_and_pitch_are_interpolated_like_the_yaw_and_the_last_ones_extrapolated():
    poses = tilted((0.0, 3.1, 0.1, -0.2), (10.0, -3.1, -0.1, 0.2), (20.0, -3.0, 3.1, 0.0))
    found = poses.poses(np.array([2.5, 5.0, 10.0]))
    np.testing.assert_allclose(found[:, 3:], [[0.05, -0.1], [0.0, 0.0], [-0.1, 0.2]], atol=1e-15)
    # Upside down: the short way round from 3.1 to -3.1.
    upside = tilted((0.0, 0.0, 3.1, 0.0), (10.0, 0.0, -3.1, 0.0)).poses([5.0])
    assert abs(math.remainder(upside[0, 3], 2 * math.pi)) == pytest.approx(math.pi)
    poses = tilted((0.0, 0.0, 0.0, 0.1), (1.0, 0.2, 0.2, 0.0), max_extrapolation=0.5)
    found = poses.poses(np.array([-0.5, 1.5]))
    np.testing.assert_allclose(found[:, 2:], [[-0.1, 0.0, 0.1], [0.3, 0.2, 0.0]])


@pytest.mark.parametrize("offset", [None, np.zeros(3), np.zeros(0)], ids=["none", "zero", "empty"])
def test_without_time_offsets_there_is_one_pose_for_the_scan(offset):
    asked = []

    def poses_at(times):
        asked.extend(times.tolist())
        return np.array([[1.0, 2.0, 0.3]])

    n = 0 if offset is None else len(offset)
    assert echo_poses(poses_at, 7.0, offset, np.zeros(n)).tolist() == [1.0, 2.0, 0.3]
    assert asked == [7.0]


def test_an_echo_may_be_sent_after_the_stamp():
    asked = []

    def poses_at(times):
        asked.append(times.tolist())
        return np.stack([times, np.zeros(len(times)), np.zeros(len(times))], axis=1)

    delay = np.array([0.5, 2.0])
    offset = np.array([1.5, 2.0])
    found = echo_poses(poses_at, 100.0, offset, np.zeros(2), transmit_offset=delay)
    assert asked == [[100.5, 102.0], [102.5, 102.0]]  # what is sent when it arrives is seen at once
    np.testing.assert_allclose(found, [[101.5, 0.0, 0.0], [102.0, 0.0, 0.0]])


def way(seconds, *, rate=1.0, speed=0.0, turn=0.0, noise=0.0, states=True, seed=0):
    """Poses of a vessel at a rate (1/s), speed and turn rate (rad/s), and errors of a fix, m."""
    rng, poses = np.random.default_rng(seed), []
    place, yaw = 0j, 0.0
    for k in range(round(seconds * rate)):
        x, y = np.array([place.real, place.imag]) + noise * rng.standard_normal(2)
        velocity = speed * complex(math.cos(yaw), math.sin(yaw))
        rates = (velocity.real, velocity.imag, turn) if states else None
        poses.append(PoseSample(k / rate, x, y, math.remainder(yaw, 2.0 * math.pi), rates=rates))
        place, yaw = place + velocity / rate, yaw + turn / rate
    return poses


def jumps_of(poses):
    return [jump for pair in itertools.pairwise(poses) if (jump := pose_jump(*pair))]


@pytest.mark.parametrize("states", [True, False])
@pytest.mark.parametrize("rate", [0.5, 1.0, 10.0])
@pytest.mark.parametrize(
    "vessel",
    [{"speed": 20.0}, {"speed": 3.0, "turn": math.radians(40.0)}, {"speed": 20.0, "noise": 5.0}],
)
def test_no_vessel_that_there_is_jumps(vessel, rate, states):
    assert jumps_of(way(500.0, rate=rate, states=states, **vessel)) == []


@pytest.mark.parametrize("states, words", [(True, "rates make 2 of it"), (False, "no rate is st")])
def test_a_jump_of_the_position_is_named_with_its_figures(states, words):
    poses = way(20.0, speed=2.0, states=states)
    moved = [dataclasses.replace(pose, y=pose.y + 100.0) for pose in poses[10:]]
    (jump,) = jumps_of(poses[:10] + moved)
    assert "position jumps by 100 m in 1 s at 10.000 s" in jump and words in jump


def test_a_jump_of_the_heading_is_named_and_one_that_its_rate_makes_is_none():
    poses = way(20.0, speed=2.0)
    turned = [dataclasses.replace(pose, yaw=math.radians(-170.0)) for pose in poses[10:]]
    (jump,) = jumps_of(poses[:10] + turned)
    assert "heading jumps by 170 degrees in 1 s at 10.000 s" in jump
    assert jumps_of(way(20.0, turn=math.radians(170.0))) == []


def finding(poses):
    check = FrozenCheck()
    said = [words for pose in poses if (words := check.take(pose))]
    assert len(said) <= 1, "once"
    return check.finding


def test_a_heading_that_stays_while_the_course_turns_is_named_until_it_is_renewed():
    poses = way(400.0, speed=2.0, turn=0.01)
    frozen = [dataclasses.replace(pose, yaw=0.75) for pose in poses]
    assert finding(poses) == ""
    assert "heading is 0.75 rad to the last bit for" in finding(frozen)
    assert finding([*frozen, dataclasses.replace(poses[-1], stamp=401.0)]) == ""


def test_a_position_that_stays_while_its_velocity_goes_on_is_named_until_it_is_renewed():
    poses = [PoseSample(0.2 * k, 0.4 * k, 0.0, 0.1, rates=(2.0, 0.0, 0.0)) for k in range(200)]
    frozen = [dataclasses.replace(pose, x=5.0) for pose in poses]
    once_in_two_seconds = [
        dataclasses.replace(pose, x=poses[k - k % 10].x) for k, pose in enumerate(poses)
    ]
    at_rest = [
        dataclasses.replace(pose, rates=(0.1 * (-1) ** k, 0.0, 0.0))
        for k, pose in enumerate(frozen)
    ]
    assert "position is the same to the last bit for 11.8 s" in finding(frozen[:60])
    assert finding([*frozen, dataclasses.replace(frozen[-1], stamp=40.0, x=60.0)]) == ""
    assert finding(poses) == finding(once_in_two_seconds) == finding(at_rest) == ""
    unstated = [dataclasses.replace(pose, rates=None) for pose in frozen]
    set_clock = [dataclasses.replace(pose, stamp=pose.stamp - 9e3) for pose in frozen[:9]]
    assert finding(unstated) == finding([*frozen[:9], *set_clock, *frozen[9:18]]) == ""


def test_a_heading_that_is_rightly_constant_is_no_finding():
    straight = way(600.0, speed=5.0, noise=5.0)
    there = [dataclasses.replace(pose, x=abs(1500.0 - pose.x)) for pose in straight]
    assert finding(straight) == finding(there) == "", "ahead, and back astern"
    assert finding(way(600.0, noise=5.0)) == "", "at rest, the errors of a fix have no course"
