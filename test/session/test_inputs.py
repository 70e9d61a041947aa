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
"""What scans wait for: the order of stamps, own-ship data, frames, tracker reports and charts."""

import dataclasses
import math
from collections import Counter, deque

import numpy as np
import pytest
from support.sessions import (
    arrived,
    current_ids,
    moving,
    ping,
    play,
    play_empty,
    sail,
    session,
    settings,
)

from tsepm_ros import ConfirmedTrack, LandMask, Scan
from tsepm_ros.methods.score import Score
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import Mounting, UnregisteredScan
from tsepm_ros.session.drop_reasons import MAX_SENTENCE
from tsepm_ros.session.inputs import (
    MAX_INTERVAL,
    MAX_NOTICED,
    Arrival,
    InputFrames,
    ScanInputOrder,
    TrackerReport,
)
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays

NEXT, SAME, LATE = Arrival.NEXT, Arrival.SAME_STAMP, Arrival.LATE

RESTART, GAP = Arrival.RESTART, Arrival.GAP


class Order(ScanInputOrder):
    """The order of scans that are all processed, but for those that come late.

    Those that are far back are taken as confirmed.
    """

    def __init__(self, window: int = 8, restart_jump: float = 60.0, max_gap: float = 0.0) -> None:
        session = SessionOptions(restart_jump=restart_jump, max_gap=max_gap)
        super().__init__(Settings(session, methods={"score": Score.Options(window=window)}))

    def classify(self, stamp: float) -> Arrival:
        arrival = super().classify(stamp)
        arrival = RESTART if arrival is Arrival.FAR_BACK else arrival
        if arrival not in (SAME, LATE):
            self.accept(stamp, arrival)
        return arrival


def classified(stamps, **options) -> list[Arrival]:
    one = Order(**options)
    return [one.classify(stamp) for stamp in stamps]


TENS = [0.0, 10.0, 20.0, 30.0, 40.0]

FALLING = [*TENS, 25.0, 15.0, 5.0]

LOOP = [0.0, 12.0, 24.0]

LETTERS = {"n": NEXT, "s": SAME, "l": LATE, "r": RESTART, "g": GAP}

CASES = {
    "any first stamp is the next": ([-5.0, -4.9], "nn"),
    "an equal stamp is the same scan again": ([10.0, 10.0, 10.0, 22.0], "nssn"),
    "a step back of the jump is late": ([100.0, 40.0], "nl"),
    "beyond the jump it is a restart": ([100.0, 39.999], "nr"),
    "a late scan is forgotten": ([40.0, 20.0, 30.0, 41.0], "nlln"),
    "after a restart stamps count from there": ([1000.0, 10.0, 22.0, 9.0], "nrnl"),
    "a restart is said once": ([*LOOP, 100.0, *LOOP], "nnnnrnn"),
    "the window of median intervals is no gap": ([*TENS, 120.0], "nnnnnn"),
    "a gap is longer than that": ([*TENS, 120.1], "nnnnng"),
    "a shorter window has shorter gaps": ([*TENS, 70.1], "nnnnng", {"window": 3}),
    "the first intervals are too few": ([0.0, 1.0, 2.0, 1000.0], "nnnn"),
    "no sonar pings so seldom": ([0.0, 1.0, 2.0, 1e6], "nnng"),
    "three intervals are enough": ([0.0, 1.0, 2.0, 3.0, 1000.0], "nnnng"),
    "one long interval does not move the median": (
        [0.0, 10.0, 20.0, 90.0, 100.0, 180.0, 260.1],
        "nnnnnng",
    ),
    "a given gap holds from the first scan": ([0.0, 30.0, 60.1], "nng", {"max_gap": 30}),
    "scanning goes on after a gap": ([*TENS, 500.0, 510.0, 520.0], "nnnnngnn"),
    "a restart forgets the intervals": ([1000.0, 1001.0, 1002.0, 1003.0, 0.0, 500.0], "nnnnrn"),
    "late scans that follow one another are a restart": ([*TENS, *TENS], "nnnnnllrnn"),
    "a loop of three scans is a restart at its third": (LOOP * 2, "nnnllr"),
    "a stamp far ahead costs two scans": ([0.0, 10.0, 55.0, 20.0, 30.0, 40.0, 50.0], "nnnllrn"),
    "falling stamps are no restart": ([*FALLING, 1.0], "nnnnnllll"),
    "until they rise": ([*FALLING, 6.0, 7.0], "nnnnnllllr"),
    "single late scans never restart": (
        [0.0, 10.0, 5.0, 20.0, 6.0, 30.0, 7.0, 40.0],
        "nnlnlnln",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_stamp_is_classified_by_those_before(case):
    stamps, letters, *options = CASES[case]
    assert classified(stamps, **dict(*options)) == [LETTERS[letter] for letter in letters]


@pytest.mark.parametrize(
    ("following", "confirmed"),
    [
        (10.0, False),  # the same again
        (9.0, False),
        (10.001, True),
        (10.0 + MAX_INTERVAL, True),
        (10.1 + MAX_INTERVAL, False),
        (100_012.0, False),  # of the run before
    ],
)
def test_a_stamp_far_back_is_confirmed_by_one_that_follows_it_before_the_last(following, confirmed):
    one = Order()
    one.classify(100_000.0)
    back = ScanInputOrder.classify(one, 10.0)
    assert back is Arrival.FAR_BACK
    assert one.settled(back, 10.0, following) is (RESTART if confirmed else back)
    one.settings = Order(max_gap=2 * MAX_INTERVAL).settings
    assert one.settled(back, 10.0, 10.0 + 2 * MAX_INTERVAL) is RESTART


@pytest.mark.parametrize(
    ("stamp", "since", "doubted"),
    [
        (55.0, 110.0, False),
        (55.1, 110.0, True),
        (55.1, math.inf, True),  # no clock
        (100.0, 140.1, False),  # a pause
        (100.0, 139.9, True),
        (100.0, (139.9, 145.0), True),
    ],
)
def test_a_stamp_ahead_is_doubted_by_the_intervals_of_stamps_and_of_arrivals(stamp, since, doubted):
    one = Order()
    assert not one.leaps(stamp, math.nan, since)
    for known in TENS:
        assert not one.leaps(known, math.nan, since)
        one.classify(known)
    assert one.leaps(stamp, 100.0, since) is doubted


@pytest.mark.parametrize(
    ("following", "arrival"),
    [(50.0, Arrival.AHEAD), (99.9, Arrival.AHEAD), (100.0, NEXT), (110.0, NEXT), (40.0, NEXT)],
)
def test_a_stamp_ahead_is_wrong_if_the_next_goes_on_from_before(following, arrival):
    one = Order()
    for known in TENS:
        one.classify(known)
    assert one.settled(NEXT, 100.0, following) is arrival


def test_a_sonar_that_changes_to_a_long_period_is_followed():
    # From a 1 s range scale to a 12 s one: one gap, then the new period is known.
    stamps = [*range(10), *range(21, 141, 12)]
    arrivals = classified([float(stamp) for stamp in stamps])
    assert arrivals.count(GAP) <= 3
    assert arrivals[-5:] == [NEXT] * 5


def test_another_window_has_the_latest_intervals():
    one = Order(window=8)
    for stamp in (0.0, 100.0, 200.0, 300.0, 310.0, 320.0, 330.0):
        one.classify(stamp)
    one.settings = Order(window=3).settings
    assert one.gap_limit == 3 * 10.0
    one.classify(340.0)
    one.settings = Order(window=8).settings
    assert one.gap_limit == 8 * 10.0


def test_a_scan_that_is_not_accepted_leaves_no_trace():
    one = Order(max_gap=100.0)
    one.classify(0.0)
    for stamp, arrival in [(1e6, GAP), (12.0, NEXT), (-1e6, Arrival.FAR_BACK), (12.0, NEXT)]:
        assert ScanInputOrder.classify(one, stamp) is arrival
    assert one.classify(12.0) is NEXT


def test_a_scan_whose_echoes_are_sent_later_waits_for_and_uses_the_poses_of_then():
    one = moving()
    needed = []
    one.own_ship.look_up = lambda *span: needed.append(span[1:3])
    scan = Scan(30.0, [100.0, 100.0], [-0.5, -0.5], time_offset=[4.0, 8.0])
    one.add_scan(arrived(scan, transmit_offset=np.array([4.0, 7.0])), 0.0)
    sail(one, 0.0, 100.0)
    (result,) = one.process(0.0)
    assert needed == [(30.0, 39.0)]
    expected = [[68.0, 10.0, 0.5], [76.0, 10.0, 0.5]]
    np.testing.assert_allclose(result.scan.sensor_pose, expected, atol=1e-9)


@pytest.mark.internal_error
def test_a_look_up_that_fails_costs_one_scan():
    one = moving()
    sail(one, 0.0, 100.0)

    def fail(*span):
        raise LookupError("no transform")

    one.own_ship.look_up = fail
    assert play(one, [12], now=0.0) == []
    one.own_ship.look_up = None
    assert len(play(one, [24], now=0.0)) == 1
    assert one.dropped == {"internal_error": 1}


def test_a_scan_whose_own_ship_data_never_comes_is_dropped_after_the_timeout():
    one = moving(own_ship_timeout=2.0)
    one.add_scan(ping(0.0), 50.0)
    assert list(one.process(51.9)) == []
    assert one.dropped == Counter()
    assert list(one.process(52.0)) == []
    assert one.dropped == {"own_ship_missing": 1}
    assert one.heard == ["own_ship_missing"]
    assert one.figures().waiting == 0


def reader(one, *stamps):
    """Reads poses one by one, as a node does messages of odometry that wait."""
    unread = deque(stamps)

    def read() -> bool:
        if unread:
            sail(one, unread.popleft())
            return True
        return False

    one.own_ship.read_unread = read
    return unread


def test_own_ship_data_is_not_read_out_of_turn_for_a_scan_that_may_wait_or_is_covered():
    one = moving(own_ship_timeout=2.0)
    unread = reader(one, 4.0, -900.0)
    sail(one, 0.0, 2.0)
    one.add_scan(ping(3.0), 50.0)
    assert list(one.process(51.0)) == []
    sail(one, 4.0)
    assert [result.stamp for result in one.process(53.0)] == [3.0]
    assert len(unread) == 2


def test_a_scan_before_a_restart_is_not_placed_by_unread_own_ship_data_after_it():
    one = moving(own_ship_timeout=2.0)
    sail(one, 0.0, 69.0)
    one.add_scan(ping(69.5), 50.0)
    unread = reader(one, *np.arange(0.0, 80.0))
    assert list(one.process(60.0)) == []
    assert one.dropped == {"own_ship_stale": 1}
    while unread:
        one.own_ship.read_unread()
    for stamp in (4.0, 16.0, 28.0):
        one.add_scan(ping(stamp), 61.0)
    assert [result.stamp for result in one.process(61.0)] == [4.0, 16.0, 28.0]


def test_own_ship_data_is_extrapolated_after_the_wait_but_not_far_and_the_next_scan_is_processed():
    one = moving(own_ship_timeout=2.0, own_ship_max_extrapolation=0.5)
    sail(one, 0.0, 10.0)
    one.add_scan(ping(10.5), 0.0)
    assert list(one.process(1.9)) == []
    (result,) = one.process(2.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [21.0, 10.0, 0.5])
    one.add_scan(ping(10.6), 2.0)
    assert list(one.process(4.0)) == []
    assert one.dropped == {"own_ship_stale": 1}
    sail(one, 30.0)
    one.add_scan(ping(22.0), 14.0)
    assert [result.stamp for result in one.process(14.0)] == [22.0]


@pytest.mark.parametrize(
    ("options", "spans", "stamps", "used"),
    [
        ({"own_ship_max_extrapolation": 0.5}, [(10.0, 20.0)], [9.0, 12.0], [12.0]),
        ({"own_ship_max_gap": 60.0}, [(0.0, 1.0), (3601.0, 3602.0)], [1800.0], []),
    ],
    ids=["before the data", "in a hole of an hour"],
)
def test_a_scan_that_own_ship_data_will_never_cover_is_dropped_at_once(
    options, spans, stamps, used
):
    one = moving(**options)
    for span in spans:
        sail(one, *span)
    for stamp in stamps:
        one.add_scan(ping(stamp), 0.0)
    assert [result.stamp for result in one.process(0.0)] == used
    assert one.dropped == {"own_ship_stale": 1}


@pytest.mark.parametrize(("seconds", "question"), [(3.0, ""), (18.0, "is it GPS time")])
def test_a_scan_before_the_first_pose_is_told_how_long_before(seconds, question):
    sentences = []
    one = Session(moving().settings, lambda reason, sentence: sentences.append((reason, sentence)))
    sail(one, 100.0, 100.5)
    one.add_scan(ping(100.0 - seconds), 0.0)
    assert list(one.process(0.0)) == []
    ((reason, sentence),) = [said for said in sentences if said[0].startswith("own_ship")]
    assert reason == "own_ship_stale"
    assert f"the oldest is {seconds:g} s after its last echo" in sentence
    assert question in sentence


def test_a_pose_carried_off_the_earth_costs_its_ping_under_a_name():
    one = moving(own_ship_max_extrapolation=0.5)
    at_the_end = PoseSample(0.0, 1e9 - 1000.0, 0.0, 0.0, rates=(1e6, 0.0, 0.0), frame_id="odom")
    one.add_own_ship(at_the_end)
    assert play(one, [0.4]) == []
    sail(one, 40.0, 60.0)
    assert [result.stamp for result in play(one, [50])] == [50.0]
    assert one.dropped == {"own_ship_jump": 1}


def test_a_restart_before_the_own_ship_follows_is_one_and_poses_before_it_place_no_scans():
    one = moving()
    sail(one, 1000.0, 1100.0)
    play(one, [1000, 1012], now=0.0)
    one.add_scan(ping(0.0), 0.0)
    assert list(one.process()) == [], "dropped: no own-ship data of the new run"
    sail(one, 1.0, 50.0)
    results = play(one, [12, 24, 36], now=0.0)
    assert [len(result.new) for result in results] == [0, 0, 1]
    assert one.heard.count("restart") == 1
    one = moving()
    for stamp in range(0, 1100, 20):
        one.add_own_ship(PoseSample(float(stamp), 5e5, 5e5, 0.0, frame_id="odom"))
    play(one, [1000], now=0.0)
    one.add_scan(ping(50.0), 0.0)
    one.add_scan(ping(62.0), 0.0)
    assert list(one.process(0.0)) == []
    sail(one, 0.0, 100.0)
    result, _ = one.process(0.1)
    np.testing.assert_allclose(result.scan.sensor_pose, [100.0, 10.0, 0.5])


@pytest.mark.parametrize(
    ("frame", "from_north", "yaw"),
    [("sonar_ned", False, 90.0), ("sonar_ned", True, 0.0), ("sonar", False, 0.0)],
)
def test_the_bow_of_a_sonar_at_rest_is_north_where_its_frame_says_so(frame, from_north, yaw):
    one, heard = session(fixed_frame=frame), dataclasses.replace(ping(5.0), frame_id=frame)
    one.add_scan(dataclasses.replace(heard, north_referenced=from_north), 0.0)
    (result,) = one.process()
    assert math.degrees(result.scan.sensor_pose[2]) == pytest.approx(yaw)


def test_the_own_ship_source_stays_as_it_is_when_settings_change():
    one = moving()
    sail(one, 0.0, 10.0)
    one.configure(settings())
    one.add_scan(ping(5.0), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [10.0, 10.0, 0.5])


def test_the_newest_scan_and_own_ship_stamps_are_told_also_after_a_restart_of_poses():
    one = moving()
    sail(one, 900.0, 1020.0)
    play(one, [1000, 1012], now=0.0)
    sail(one, 0.0, 12.0)
    assert (one.figures().scan_stamp, one.figures().own_ship_stamp) == (None, 12.0)
    play(one, [5], now=0.0)
    assert one.figures().scan_stamp == 5.0
    one = moving()
    sail(one, 0.0, 20.0)
    one.add_scan(ping(30.0), 0.0)
    one.add_scan(ping(42.0), 0.0)
    figures = one.figures()
    assert (figures.waiting, figures.scan_stamp, figures.own_ship_stamp) == (2, 42.0, 20.0)


def test_a_scan_that_cannot_be_placed_costs_itself_and_no_track():
    one = moving(common=CommonOptions(hold_time=1e6), own_ship_max_extrapolation=12.0)
    sail(one, 0.0, 30.0)
    confirmed = play(one, [0, 12, 24])[2].new
    # At the edge of what is taken, and beyond it where the newest velocity carries it.
    for stamp in (31.0, 32.0):
        one.add_own_ship(PoseSample(stamp, 1e9, 0.0, 0.0, rates=(10.0, 0.0, 0.0), frame_id="odom"))
    assert play(one, [36]) == []
    assert (one.dropped, one.figures().waiting) == ({"own_ship_jump": 1}, 0)
    sail(one, 40.0, 60.0)
    (result,) = play(one, [48])
    assert current_ids(result) == [track.track_id for track in confirmed]


def fix(one, first, last, *, north=0.0, turn=0.0):
    """Poses every second of a vessel that goes at 2 m/s, as a fix and a compass state them."""
    for stamp in np.arange(first, last):
        pose = PoseSample(stamp, 2.0 * stamp, north, turn, rates=(2.0, 0.0, 0.0), frame_id="odom")
        one.add_own_ship(pose)


@pytest.mark.parametrize("jump", [{"north": 100.0}, {"turn": 2.0}])
def test_after_a_jump_of_own_ship_nothing_is_held_as_if_nothing_had_been(jump):
    one = moving(common=CommonOptions(hold_time=1e6))
    fix(one, 0.0, 40.0)
    confirmed = play(one, [0, 12, 24])[2].new
    assert len(confirmed) == 1
    fix(one, 40.0, 80.0, **jump)
    results = play(one, [36, 39.5, 48])
    assert [result.stamp for result in results] == [36.0, 48.0], "none is placed in the jump"
    assert len(results[0].current) == 1 and len(results[1].current) == 0
    assert one.dropped == {"own_ship_jump": 1}
    assert sum(subject == "own_ship_jump" for subject in one.heard) >= 1


@pytest.mark.parametrize("times", [1, 2])
def test_a_single_pose_elsewhere_is_left_out_and_costs_no_track(times):
    """Also where it comes again, as tf is asked again while its scan waits."""
    one = moving(common=CommonOptions(hold_time=1e6))
    fix(one, 0.0, 30.0)
    confirmed = play(one, [0, 12, 24])[2].new
    for _ in range(times):
        fix(one, 30.0, 31.0, north=100.0)
    fix(one, 31.0, 60.0)
    result = play(one, [36])[0]
    assert current_ids(result) == [track.track_id for track in confirmed]
    assert one.dropped == {"own_ship_outlier": 1}


TURN = math.radians(10.0)


def circling(stamp, *, at=None, states=True, north=0.0):
    """Pose of a vessel at 5 m/s that turns, at a time if not at the stamp."""
    yaw = TURN * ((stamp if at is None else at) - 1000.0)
    x, y = 5.0 / TURN * math.sin(yaw), 5.0 / TURN * (1.0 - math.cos(yaw))
    rates = (5.0 * math.cos(yaw), 5.0 * math.sin(yaw), TURN) if states else None
    return PoseSample(stamp, x, y + north, math.remainder(yaw, math.tau), rates=rates)


def placed(one, stamp):
    """Where a buoy is by the scans that were processed since, m."""
    pose = circling(stamp)
    x, y = 300.0 - pose.x, 100.0 - pose.y
    azimuth = math.remainder(math.atan2(y, x) - pose.yaw, math.tau)
    one.add_scan(arrived(Scan(stamp, [math.hypot(x, y)], [azimuth])), stamp)
    for result in one.process(stamp):
        seen = result.scan.azimuth + result.scan.sensor_pose[2]
        way = result.scan.range * np.array([np.cos(seen), np.sin(seen)]).T
        yield (result.scan.sensor_pose[:2] + way[0]).tolist()


@pytest.mark.parametrize("states", [True, False])
@pytest.mark.parametrize("ahead", [0.5, 1.0, 5.0, 100.0])
def test_a_single_pose_stamped_ahead_is_left_out_and_places_no_scan(ahead, states):
    one, found = moving(fixed_frame="odom"), []
    for k in range(80):
        stamp = 1000.0 + 0.1 * k
        one.add_own_ship(circling(stamp + ahead * (k == 50), at=stamp, states=states))
        found += placed(one, stamp + 0.05)
    np.testing.assert_allclose(found, [(300.0, 100.0)] * len(found), atol=0.1)
    assert len(found) == 79 and one.dropped == {"own_ship_outlier": 1}


@pytest.mark.parametrize("ahead", [1.0, 30.0])
def test_of_a_vessel_at_rest_a_pose_stamped_ahead_is_left_out_too(ahead):
    one, stamps = moving(fixed_frame="odom"), list[float]()
    for k in range(80):
        time = 1000.0 + 0.1 * k
        one.add_own_ship(PoseSample(time + ahead * (k == 50), 7.0, 8.0, 0.5))
        one.add_scan(ping(time - 0.01), time)
        stamps += [result.stamp for result in one.process(time)]
    assert len(stamps) == 80 and one.dropped == {"own_ship_outlier": 1}


def test_a_clock_that_steps_forward_and_poses_that_were_lost_in_a_turn_cost_none():
    for late in (0.0, 1.0):
        one = moving(fixed_frame="odom")
        for k in [*range(50), *range(55, 99)]:
            stamp = 1000.0 + 0.1 * k
            one.add_own_ship(circling(stamp + late * (k > 50), at=stamp))
        assert one.dropped == {} and len(one.own_ship.poses) == 94


@pytest.mark.parametrize("north", [0.0, 5.0])
def test_of_a_second_publisher_the_late_poses_are_dropped_also_where_the_first_loses_one(north):
    one = moving(fixed_frame="odom")
    for k in range(50):
        stamp = 1000.0 + 0.1 * k
        if k % 10 != 7:
            one.add_own_ship(circling(stamp))
        one.add_own_ship(circling(stamp - 0.15, north=north))
    # After one that the first loses, one of the second may come in time.
    assert set(one.dropped) == {"own_ship_late"} and one.dropped["own_ship_late"] >= 44


def test_a_heading_that_is_not_renewed_is_found_and_ends():
    one = moving()
    for stamp in range(200):
        x, y = 100.0 * np.sin(0.02 * stamp), 100.0 * np.cos(0.02 * stamp)
        one.add_own_ship(PoseSample(float(stamp), x, y, 0.3, frame_id="odom"))
    assert "to the last bit" in one.figures().findings["own_ship_frozen"]
    assert one.heard.count("own_ship_frozen") == 1
    one.add_own_ship(PoseSample(200.0, x, y, 0.31, frame_id="odom"))
    assert one.figures().findings["own_ship_frozen"] == ""


def test_a_negative_time_offset_is_placed_where_poses_are_known():
    one = moving()
    sail(one, 0.0, 30.0)
    scan = Scan(20.0, [1000.0], [-0.5], time_offset=[-3.0])
    one.add_scan(arrived(scan), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [[34.0, 10.0, 0.5]], atol=1e-9)


def test_frames_of_own_ship_data_that_do_not_fit_are_refused_and_change_nothing():
    one = moving(fixed_frame="odom")
    sail(one, 1.0, 100.0)
    one.add_own_ship(PoseSample(101.0, 0.0, 0.0, 0.0, frame_id="map", child_frame_id="base_link"))
    play(one, [12], now=0.0)
    assert one.heard == ["own_ship_frame"]
    one = moving()
    sail(one, 0.0, frame_id="odom")
    sail(one, 1.0, frame_id="map")
    assert one.dropped == {"own_ship_frame": 1}


def test_a_name_as_long_as_a_message_is_reported_without_its_middle():
    sentences = []
    one = Session(
        Settings(session=SessionOptions(own_ship_source="odometry", fixed_frame="map")),
        report=lambda _, sentence: sentences.append(sentence),
    )
    sail(one, 0.0, frame_id="x" * 65536 + "end")
    (sentence,) = sentences
    assert len(sentence) == MAX_SENTENCE
    assert sentence.startswith("own-ship data is in frame 'xxx")
    assert sentence.endswith("xend', the fixed frame is 'map'")


@pytest.mark.parametrize(
    ("options", "first", "bad"),
    [
        ({}, "sonar", "radar"),
        ({"sensor_frame": "sonar"}, "radar", "radar"),
        ({"fixed_frame": "sonar"}, "radar", "radar"),
        ({"own_ship_source": "odometry", "fixed_frame": "odom"}, "sonar", "odom"),
    ],
)
def test_detections_in_an_unknown_frame_are_dropped(options, first, bad):
    one = session(own_ship_max_gap=3600.0, **options)
    if "own_ship_source" in options:
        sail(one, 0.0, 100.0)
    frames = [first, "sonar", bad, "sonar"]
    for stamp, frame_id in enumerate(frames):
        one.add_scan(dataclasses.replace(ping(float(stamp)), frame_id=frame_id), 0.0)
    assert len(list(one.process())) == frames.count("sonar")
    assert one.dropped["unknown_frame"] == 4 - frames.count("sonar")


@pytest.mark.parametrize(
    ("options", "frame"),
    [
        pytest.param({}, None, id="nothing given"),
        ({"sensor_frame": "sonar"}, "sonar"),
        ({"fixed_frame": "map"}, "map"),
        ({"own_ship_source": "odometry", "sensor_frame": "sonar"}, "odom"),
        pytest.param({"own_ship_source": "odometry", "fixed_frame": "odom"}, None, id="moves"),
    ],
)
def test_a_scan_that_names_no_frame_needs_one_that_is_given(options, frame):
    one = session(**options)
    if "own_ship_source" in options:
        sail(one, 0.0, 10.0)
    one.add_scan(dataclasses.replace(ping(5.0), frame_id=""), 0.0)
    assert [result.frame_id for result in one.process()] == ([] if frame is None else [frame])
    assert one.dropped == ({"empty_frame": 1} if frame is None else {})


@pytest.mark.parametrize("given", ["", "odom"])
def test_own_ship_data_that_names_no_frame_needs_one_that_is_given(given):
    one = moving(fixed_frame=given)
    sail(one, 0.0, frame_id="")
    assert one.dropped == ({} if given else {"own_ship_empty_frame": 1})
    assert (one.fixed_frame, one.own_ship.poses.last_stamp) == (given, 0.0 if given else None)


def test_the_frames_that_were_noticed_are_bounded():
    """A source that names another frame with each message neither grows nor repeats for ever."""
    frames = InputFrames(SessionOptions(own_ship_source="odometry"))
    frames.admit(UnregisteredScan(Scan(0.0, [], []), "sonar"), 10)
    noticed = 0
    for number in range(10 * MAX_NOTICED):
        frames.take_pose(
            PoseSample(1.0, 0.0, 0.0, 0.0, frame_id="map", child_frame_id=f"f{number}")
        )
        noticed += len(frames.notices(Mounting()))
        assert frames.notices(Mounting()) == []
        assert len(frames._noticed) <= MAX_NOTICED
    assert noticed == 10 * MAX_NOTICED


def tracked(stamp: float, /, *ids: int, **values) -> TrackArrays:
    """Targets 1 km apart as a downstream tracker knows them; values replace those of each."""
    tracks = [
        ConfirmedTrack(
            track_id=track_id,
            stamp=stamp,
            state=np.array([7000.0, 0.0, 1000.0 * place, 0.0]),
            covariance=np.diag([50.0, 1.0, 50.0, 1.0]) ** 2,
            hits=(),
            evaluation=0.0,
        )
        for place, track_id in enumerate(ids)
    ]
    return TrackArrays.from_tracks([dataclasses.replace(track, **values) for track in tracks])


def tell(one: Session, stamp: float, *listed: int, frame_id: str = "sonar") -> None:
    """Give a downstream tracker's report."""
    one.add_tracked(TrackerReport(stamp, frame_id, tracked(stamp, *listed)))


def test_a_report_counts_before_a_scan_that_waited_and_one_older_than_the_last_is_dropped():
    one = moving()
    one.add_scan(ping(10.0), 0.0)
    tell(one, 14.0, 70, frame_id="odom")
    sail(one, 0.0, 20.0)
    (result,) = one.process(0.0)
    assert current_ids(result) == [70]
    assert result.current[0].stamp == 10.0
    one = session()
    play(one, [0])
    tell(one, 5.0, 70)
    tell(one, 4.0, 71)
    (result,) = play(one, [6])
    assert (current_ids(result), one.dropped) == ([70], {"tracked_late": 1})


def test_a_report_on_the_last_scan_before_a_pause_is_used():
    one = session()
    play(one, [0])
    tell(one, 0.5, 70)
    (result,) = play(one, [100])
    assert (current_ids(result), one.dropped, one.heard) == ([70], {}, [])
    assert (one.figures().tracker, one.figures().tracker_silence) == ("alive", -0.5)


@pytest.mark.parametrize("stamp", [939.0, 1060.5])
def test_a_report_of_another_time_is_dropped_and_the_next_is_used(stamp):
    one = session()
    tell(one, stamp, 70)
    (result,) = play(one, [1000])
    assert (current_ids(result), one.dropped) == ([], {"tracked_stale": 1})
    tell(one, 1001.0, 71)
    (result,) = play(one, [1012])
    assert current_ids(result) == [71]


GOOD_COVARIANCE = np.diag([50.0, 1.0, 50.0, 1.0]) ** 2

BAD_TRACKED = {
    "state": ({"state": np.array([math.nan, 0.0, 0.0, 0.0])}, "not_finite"),
    "far": ({"state": np.array([0.0, 0.0, -1e10, 0.0])}, "not_finite"),
    "stamp": ({"stamp": math.inf}, "not_finite"),
    "infinite": ({"covariance": np.full((4, 4), math.inf)}, "not_finite"),
    "huge": ({"covariance": GOOD_COVARIANCE * 1e300}, "not_finite"),
    "nan": ({"covariance": np.full((4, 4), math.nan)}, "not_finite"),
    "asymmetric": ({"covariance": GOOD_COVARIANCE + 20.0 * np.eye(4, k=1)}, "bad_covariance"),
    "zero": ({"covariance": np.zeros((4, 4))}, "bad_covariance"),
    "negative": ({"covariance": -GOOD_COVARIANCE}, "bad_covariance"),
    "indefinite": ({"covariance": np.eye(4) - 2 * np.eye(4)[::-1]}, "bad_covariance"),
    "singular": ({"covariance": np.full((4, 4), 100.0)}, "bad_covariance"),
    "tiny": ({"covariance": GOOD_COVARIANCE * 1e-300}, "bad_covariance"),
    "duplicate": ({"track_id": 70}, "duplicate_id"),
}


@pytest.mark.parametrize("fault", BAD_TRACKED)
def test_a_bad_tracked_target_is_dropped_and_the_others_are_kept(fault):
    values, reason = BAD_TRACKED[fault]
    one = session()
    tracks = TrackArrays.joined(tracked(0.0, 70), tracked(0.0, 71, 72, **values), tracked(0.0, 73))
    one.add_tracked(TrackerReport(0.0, "sonar", tracks))
    assert one.dropped == {f"tracked_{reason}": 2}
    assert one.heard == [f"tracked_{reason}"]
    (result,) = play_empty(one, [0])
    assert current_ids(result) == [70, 73]
    np.testing.assert_array_equal(result.current.state, tracks.where(np.array([0, 3])).state)
    assert np.isfinite(result.current.covariance).all()


def test_the_tracker_s_timeout_may_change_and_another_method_keeps_what_it_tracks():
    one = session()
    tell(one, 0.0, 70)
    play_empty(one, [0])
    one.configure(settings(CommonOptions(tracked_timeout=20.0), method="score"))
    (result,) = play_empty(one, [12])
    assert (current_ids(result), one.figures().tracker) == ([70], "alive")
    play_empty(one, [24, 36])
    assert (one.figures().tracker, one.figures().tracker_lag) == ("silent", 36.0)
    one.configure(settings(CommonOptions(tracked_timeout=40.0), method="score"))
    tell(one, 24.0, 70)
    play_empty(one, [60])
    assert one.figures().tracker == "alive"


AHEAD = LandMask(np.ones((10, 10)), 10.0, (2950.0, -50.0, 0.0))

ASTERN = LandMask(np.ones((10, 10)), 10.0, (-2950.0, -50.0, 0.0))


def test_a_chart_in_another_frame_is_refused_also_where_it_came_before_the_frame():
    one = session()
    one.add_land(AHEAD, "sonar")
    play(one, [0])
    for frame in ("map", ""):
        one.add_land(ASTERN, frame)
        (result,) = play(one, [12.0 if frame else 24.0])
        assert result.statistics.on_land == 1
    assert one.dropped["land_frame"] == 2
    assert one.heard == ["land", "land_frame", "land_frame"]
    one = moving()
    one.add_land(AHEAD, "map")
    assert one.dropped == {}
    sail(one, 0.0, 60.0)
    play(one, [0, 12])
    assert one.dropped == {"land_frame": 1}


def test_a_chart_is_of_the_fixed_frame_not_the_sensor_s():
    one = moving()
    sail(one, 0.0, 60.0)
    one.add_land(LandMask([[True]], 20.0, (990.0, 0.0, 0.0)), "odom")
    distance = np.hypot(1000.0, 0.0)
    one.add_scan(arrived(Scan(0.0, [distance], [-0.5])), 0.0)
    (result,) = one.process(0.0)
    assert result.statistics.on_land == 1


def test_a_chart_stays_through_a_reset_for_its_frame_a_restart_and_another_method():
    one = session()
    one.add_land(AHEAD, "sonar")
    play(one, [0])
    one.reset()
    (result,) = play(one, [0])
    assert result.statistics.on_land == 1
    one.reset()
    one.add_scan(arrived(Scan(0.0, [3000.0], [0.0]), "other"), 0.0)
    (result,) = one.process()
    assert result.statistics.on_land == 0
    assert one.dropped == {"land_frame": 1}
    one = session()
    one.add_land(AHEAD, "sonar")
    results = play(one, [1000, 1012, 0, 12])
    assert [result.statistics.on_land for result in results] == [1] * 4
    one.configure(session(method="score").settings)
    (result,) = play(one, [24])
    assert result.statistics.on_land == 1
