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
"""Scans of several sensors: their order, how long they wait, clocks that go back, frames."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from support.sessions import NotedSession, arrived

from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.session.session import ScanResult
from tsepm_ros.session.shared_picture import (
    ScanDeliveries,
    SharedPicture,
    sensor_sentence,
    share_picture,
)
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel

MODEL = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=0.02, max_range=500.0)
PERIODS = {"fast": 0.25, "slow": 2.0}


class Deck:
    """Sensors of one picture with a clock: each scan arrives so long after its stamp."""

    def __init__(self, names: tuple[str, ...] = ("fast", "slow"), **options) -> None:
        self.sessions = {
            name: NotedSession(
                Settings(sensor=MODEL, session=SessionOptions(**{"sweep": "off"} | options))
            )
            for name in names
        }
        self.picture: SharedPicture = share_picture(self.sessions)
        self.results: list[tuple[float, ScanResult]] = []

    def hear(self, name: str, stamp: float, now: float, frame: str = "sonar", **scan) -> None:
        """A scan, else empty, which arrives at a time."""
        given = {"range": [], "azimuth": []} | scan
        self.sessions[name].add_scan(arrived(Scan(stamp, **given), frame), now)

    def process(self, now: float, **more) -> list[tuple[str, float]]:
        """Names and stamps of the scans that are processed at a time."""
        found = list(self.picture.process(now, **more))
        self.results += [(now, one) for one in found]
        return [(one.scan.sensor, one.stamp) for one in found]

    def play(self, events: list[tuple[float, str, float]]) -> None:
        """Scans by the times of their arrivals, names and stamps; and 20 looks a second."""
        looks = np.arange(0.0, max(now for now, _, _ in events) + 12.0, 0.05).tolist()
        for now, name, stamp in sorted([*events, *((look, "", 0.0) for look in looks)]):
            if name:
                self.hear(name, stamp, now)
            self.process(now)

    def waits(self, name: str) -> np.ndarray:
        """Times from arrival to processing of a sensor's scans."""
        return np.array([one.waiting for _, one in self.results if one.scan.sensor == name])


def stream(name: str, period: float, until: float, late: float, begin: float = 0.0) -> list:
    return [
        (stamp + late, name, stamp)
        for stamp in (begin + period * np.arange(round((until - begin) / period))).tolist()
    ]


def stamps_of(deck: Deck, name: str = "") -> list[float]:
    return [one.stamp for _, one in deck.results if name in ("", one.scan.sensor)]


@pytest.mark.parametrize("expected", [True, False])
def test_scans_are_processed_by_their_stamps_and_wait_as_long_as_the_slower_sensor_takes(expected):
    deck = Deck((*PERIODS, "dead"))
    for one in deck.sessions.values() if expected else ():
        one.deliveries.expected = 0.0  # it has a publisher
    deck.sessions["dead"].deliveries.expected = -math.inf
    deck.play([*stream("fast", 0.25, 40.0, 0.02), *stream("slow", 2.0, 40.0, 1.0, 0.05)])
    assert stamps_of(deck) == sorted(stamps_of(deck))
    assert sum(deck.sessions["fast"].dropped.values()) == 0
    # Of the slow one the first is late if its driver is not known: how late it is was not known.
    assert deck.sessions["slow"].dropped == ({} if expected else {"scan_late": 1})
    waits = deck.waits("fast")
    assert 0.9 <= waits.max() <= 1.1, "as long as the other one takes, not max_wait"


def test_at_the_start_a_sensor_with_a_publisher_that_sends_nothing_is_waited_for_once():
    deck = Deck(max_wait=3.0)
    deck.sessions["slow"].deliveries.expected = 0.0
    deck.play(stream("fast", 0.25, 20.0, 0.0))
    waits = deck.waits("fast")
    assert 2.9 <= waits[0] <= 3.1 and waits[13:].max() == 0.0


def test_no_scan_waits_for_a_silent_sensor_and_one_that_is_back_is_waited_for_again():
    deck = Deck()
    slow = stream("slow", 0.5, 60.0, 0.8, 0.05)
    deck.play(
        [*stream("fast", 0.25, 60.0, 0.0), *(one for one in slow if not 20.0 < one[2] < 40.0)]
    )
    of_fast = [(one.stamp, one.waiting) for _, one in deck.results if one.scan.sensor == "fast"]
    assert max(wait for stamp, wait in of_fast if 24.0 < stamp < 39.0) == 0.0
    assert max(wait for stamp, wait in of_fast if stamp > 50.0) > 0.5
    assert deck.sessions["slow"].dropped["scan_late"] <= 5, "the first, and after the silence"
    assert stamps_of(deck) == sorted(stamps_of(deck))


@pytest.mark.parametrize(("max_wait", "lost"), [(10.0, False), (2.0, True), (0.0, True)])
def test_a_scan_waits_at_most_max_wait_and_what_comes_later_is_late_and_said(max_wait, lost):
    deck = Deck(max_wait=max_wait)
    deck.play([*stream("fast", 0.25, 33.0, 0.0), *stream("slow", 1.0, 30.0, 3.0, 0.05)])
    assert deck.waits("fast").max() <= max_wait + 0.06
    late = deck.sessions["slow"].dropped["scan_late"]
    assert late >= 25 if lost else late <= 4
    _, values = deck.picture.figures_of("slow", 33.0)
    sentence = deck.picture.figures_of("slow", 33.0)[0].findings["late"]
    assert bool(sentence) == lost
    if lost:
        assert sentence.startswith("scans come 3 s later after their stamps than those of other")
        assert f"wait {max_wait:g} s: raise max_wait" in sentence
    assert deck.picture.figures_of("fast", 33.0)[0].findings["late"] == ""
    assert values["last_scan"] == pytest.approx(1.0, abs=0.06)


def test_a_sensor_that_was_late_is_said_no_more_once_it_is_silent_or_in_time():
    deck = Deck(max_wait=1.0)
    deck.play([*stream("fast", 0.25, 23.0, 0.0), *stream("slow", 1.0, 20.0, 3.0, 0.05)])
    assert deck.picture.figures_of("slow", 23.0)[0].findings["late"]
    deck.play(stream("fast", 0.25, 60.0, 0.0, 23.0))
    assert deck.picture.figures_of("slow", 60.0)[0].findings["late"] == ""
    deck.play(stream("slow", 1.0, 90.0, 0.1, 60.05) + stream("fast", 0.25, 90.0, 0.0, 60.0))
    assert deck.picture.figures_of("slow", 90.0)[0].findings["late"] == ""


def test_live_and_offline_the_same_scans_in_the_same_order_give_equal_tracks_to_the_bit():
    deck, other = Deck(), Deck()
    rng = np.random.default_rng(3)
    events = stream("fast", 0.25, 30.0, 0.0) + stream("slow", 2.0, 30.0, 1.0, 0.05)
    for now, name, stamp in sorted(events):
        noise = rng.standard_normal(2)
        seen = {"range": [200.0 + stamp + noise[0], 100.0], "azimuth": [0.1 + 0.02 * noise[1], 2.0]}
        deck.hear(name, stamp, now, **seen)
        deck.process(now)
    deck.process(math.inf, last=True)
    for _, one in deck.results:
        name = one.scan.sensor
        other.hear(name, one.stamp, -math.inf, range=one.scan.range, azimuth=one.scan.azimuth)
        [found] = other.sessions[name].process()
        np.testing.assert_array_equal(found.current.state, one.current.state)
        np.testing.assert_array_equal(found.current.covariance, one.current.covariance)
    assert len(deck.results[-1][1].current)


@pytest.mark.parametrize("back_to", [0.0, 1010.0])
def test_where_the_clock_of_all_goes_back_the_picture_is_reset_once(back_to):
    deck = Deck(names=(*PERIODS, "dead"))
    events = [
        (now, name, stamp)
        for run, begin in ((0.0, 1000.0), (20.0, back_to))
        for name, period in PERIODS.items()
        for now, name, stamp in [
            (run + one + (0.3 if name == "slow" else 0.0), name, begin + one)
            for one in np.arange(0.0, 20.0, period).tolist()
        ]
    ]
    deck.play(events)
    assert deck.picture.restarts == deck.picture.ends_of_all == 1
    assert sum(one.heard.count("restart") for one in deck.sessions.values()) == 2
    stamps = stamps_of(deck)
    assert sum(a > b for a, b in pairwise(stamps)) == 1
    assert len(stamps_of(deck, "fast")) >= 150 and len(stamps_of(deck, "slow")) >= 16


def test_where_one_clock_alone_goes_back_its_scans_are_late_and_the_picture_stays():
    deck = Deck()
    first = [(now, name, stamp + 1000.0) for now, name, stamp in stream("fast", 0.25, 75.0, 0.0)]
    slow = stream("slow", 2.0, 60.0, 0.3)
    deck.play([*first, *((now, name, s + 1000.0 if s < 20.0 else s) for now, name, s in slow)])
    assert deck.picture.restarts == 0
    assert len(stamps_of(deck, "fast")) == 300
    assert stamps_of(deck, "slow")[-1] < 1020.0
    assert deck.sessions["slow"].dropped["scan_late"] >= 15
    assert "scan_late" in deck.sessions["slow"].heard


def test_a_sensor_whose_clock_did_not_go_back_is_refused_after_the_others_did():
    deck = Deck(names=(*PERIODS, "third"))
    events = [(now, "third", 1000.0 + stamp) for now, _, stamp in stream("", 1.0, 10.0, 0.0)]
    events += [(now, "third", 1000.0 + now) for now in (60.0, 61.0, 62.0)]
    for name, period in PERIODS.items():
        for stamp in np.arange(0.0, 70.0, period).tolist():
            events.append((stamp, name, stamp + (1000.0 if stamp < 30.0 else 0.0)))
    deck.play(events)
    assert deck.picture.restarts == 1
    assert deck.sessions["third"].dropped == {"scan_late": 3}
    assert max(stamps_of(deck)[-60:]) < 71.0


def test_a_single_bad_stamp_of_a_sensor_is_dropped_and_costs_the_others_nothing():
    deck = Deck()
    events = stream("fast", 0.25, 20.0, 0.0) + stream("slow", 2.0, 20.0, 0.0, 0.05)
    events = [(now, name, 0.0 if (name, now) == ("slow", 10.05) else s) for now, name, s in events]
    deck.play([(now, name, stamp and 1000.0 + stamp) for now, name, stamp in events])
    assert deck.sessions["slow"].dropped == {"stamp_not_set": 1}
    assert deck.sessions["fast"].dropped in ({}, {"stamp_not_set": 1})
    assert deck.picture.restarts == 0


def test_the_frame_of_another_sensor_is_refused_and_named():
    deck = Deck(own_ship_source="odometry")
    deck.hear("fast", 1.0, 1.0, "bow")
    deck.hear("slow", 1.0, 1.0, "stern")
    deck.hear("slow", 3.0, 3.0, "bow")
    assert deck.sessions["slow"].dropped == {"unknown_frame": 1}
    deck.hear("slow", 5.0, 5.0, "keel")
    assert deck.sessions["slow"].dropped == {"unknown_frame": 2}
    assert not deck.sessions["fast"].dropped


def test_a_frame_that_is_given_to_a_sensor_is_refused_of_another_from_the_first_message_on():
    sessions = {
        name: NotedSession(Settings(session=SessionOptions(own_ship_source="odometry", **own)))
        for name, own in (("port", {"sensor_frame": "port"}), ("starboard", {}))
    }
    share_picture(sessions)
    sessions["starboard"].add_scan(arrived(Scan(1.0, [], []), "port"), 0.0)
    assert sessions["starboard"].dropped == {"unknown_frame": 1}
    sessions["starboard"].add_scan(arrived(Scan(1.0, [], []), "other"), 0.0)
    sessions["port"].add_scan(arrived(Scan(1.0, [], []), "port"), 0.0)
    assert sum((one.dropped for one in sessions.values()), start=sessions["port"].dropped) == {
        "unknown_frame": 1
    }


def test_sensors_with_mountings_may_share_the_name_of_a_frame():
    sessions = {
        name: NotedSession(
            Settings(
                session=SessionOptions(own_ship_source="odometry"),
                mounting=Mounting(yaw=yaw),
            )
        )
        for name, yaw in (("port", 0.5), ("starboard", -0.5))
    }
    picture = share_picture(sessions)
    for name, one in sessions.items():
        for stamp in (0.0, 2.0, 4.0):
            one.add_own_ship(PoseSample(stamp, 3.0, 4.0, 0.25, frame_id="odom"))
        one.add_scan(arrived(Scan(1.0, [100.0], [0.0]), "sonar"), 0.0)
        assert not one.dropped, name
    assert [one.scan.sensor for one in picture.process()] == ["port", "starboard"]
    poses = [picture.figures_of(name, 1.0)[1]["pose"] for name in sessions]
    assert poses == ["3 4 0.75", "3 4 -0.25"]
    assert picture.figures_of("port", 1.0)[1]["coverage"] == "0 9000 -3.14159265 3.14159265"


def test_at_rest_all_sensors_are_in_one_frame():
    deck = Deck()
    deck.hear("fast", 1.0, 1.0, "bow")
    deck.hear("slow", 1.0, 1.0, "stern")
    assert deck.sessions["slow"].dropped == {"unknown_frame": 1}


def test_counts_of_poses_are_those_of_one_sensor_and_those_of_scans_of_all():
    deck = Deck(own_ship_source="odometry")
    for one in deck.sessions.values():
        for stamp in (1.0, 0.5):
            one.add_own_ship(PoseSample(stamp, 0.0, 0.0, 0.0, frame_id="odom"))
    for name in deck.sessions:
        for stamp in (1.0, 1.0):
            deck.hear(name, stamp, stamp)
    deck.process(math.inf, last=True)
    figures = deck.picture.figures()
    assert figures.dropped == {"own_ship_late": 1, "scan_same_stamp": 2}


@pytest.mark.parametrize("max_wait", [10.0, 600.0])
def test_poses_are_kept_as_long_as_a_scan_may_need_them_and_no_longer(max_wait):
    deck = Deck(own_ship_source="odometry", max_wait=max_wait)
    for stamp in range(2000):
        deck.sessions["fast"].add_own_ship(PoseSample(stamp, 0.0, 0.0, 0.0, frame_id="odom"))
    assert 300.0 + max_wait <= len(deck.sessions["fast"].own_ship.poses) < 320.0 + max_wait


def test_a_wrong_mounting_is_said_with_its_angle_and_no_more_once_it_is_corrected():
    deck = Deck(own_ship_source="odometry")
    for one in deck.sessions.values():
        for stamp in np.arange(0.0, 130.0, 1.0).tolist():
            one.add_own_ship(PoseSample(stamp, 0.0, 0.0, 0.0, frame_id="odom"))
    rng, news = np.random.default_rng(2), []
    turns = np.array([0.3, 1.5, 2.7, 4.0, 5.2])
    begin, velocity = 300.0 * np.exp(1j * turns), np.exp(1j * turns**2)
    for k in range(120):
        name = ("fast", "slow")[k % 2]
        place = begin + 0.5 * k * velocity
        noise = rng.standard_normal((2, 5))
        wrong = 0.05 * (name == "fast") * (k < 70)
        azimuth = np.angle(place) + 0.005 * noise[1] + wrong
        deck.hear(name, 0.5 * k, 0.5 * k, range=np.abs(place) + noise[0], azimuth=azimuth)
        deck.process(0.5 * k + 20.0)
        said = deck.picture.figures_of("fast", 0.5 * k)[0].findings["misalignment"]
        news += deck.picture.alignment_news()
        if k == 10:
            known = deck.picture.figures_of("slow", 0.5 * k)[1]["alignment"]
            assert known == "not compared yet, 15 of 60 detections; shared tracks now: 5"
        if k == 69:
            assert said.startswith("fast sees targets 2.86 +- 0.04 degrees left of where the")
            assert "set fast.mounting.yaw to -0.05" in said and "(now 0.0000)" in said
            known = deck.picture.figures_of("fast", 0.5 * k)[1]["alignment"]
            assert known.startswith("compared, +2.86 +- 0.04 degrees, ")
            assert known.endswith(" s beside the others; shared tracks now: 5")
            assert [subject for subject, _ in news] == ["misalignment"]
            other = deck.picture.figures_of("slow", 35.0)[0].findings["misalignment"]
            assert other == "", "both would turn too far"
            session = deck.sessions["fast"]
            session.configure(replace(session.settings, mounting=Mounting(yaw=1e-9)))
            assert not deck.picture.figures_of("fast", 35.0)[0].findings["misalignment"]
            assert deck.picture.alignment_news() == [], "unknown is not in line"
    assert said == ""
    (_, _), (over, sentence) = news
    assert over == "alignment" and sentence.startswith("fast is in line again: -0.0")


def test_a_sentence_of_a_sensor_names_its_parameters():
    said = "set sensor.max_range to 40, mounting.yaw; see port.sensor.range_std"
    assert sensor_sentence("", said) == said
    named = "set port.sensor.max_range to 40, port.mounting.yaw; see port.sensor.range_std"
    assert sensor_sentence("port", said) == named
    assert sensor_sentence("port", "another sensor.") == "another sensor."


def test_one_bad_stamp_does_not_make_a_sensor_slow():
    one = ScanDeliveries()
    for stamp in (100.0, 101.0, 0.0, 102.0, 103.0):
        one.note(stamp, max(stamp, 101.5) + 0.2)
    assert one.latency < 2.0


def test_no_scan_waits_for_a_sensor_that_is_too_late_in_any_case():
    deck = Deck(max_wait=2.0)
    deck.play([*stream("fast", 0.25, 40.0, 0.0), *stream("slow", 1.0, 22.0, 18.0, 0.05)])
    assert deck.waits("fast")[-20:].max() == 0.0
    assert deck.picture.figures_of("slow", 39.9)[0].findings["late"].startswith("scans come 18 s")


def test_deliveries_tell_latency_interval_and_silence():
    one = ScanDeliveries()
    assert one.is_silent(0.0, 10.0), "without a publisher"
    one.expected = 1.0, 100.0
    assert not one.is_silent((11.0, 110.0), 10.0) and one.may_deliver(99.0, (11.0, 110.0))
    assert one.is_silent((11.1, 110.1), 10.0)
    for stamp in (10.0, 12.0, 14.0):
        one.note(stamp, (stamp + 100.0, stamp + 0.7))
    assert one.latency == pytest.approx(0.7)
    assert one.interval == 2.0
    assert not one.is_silent((123.0, 23.0), 1.0) and one.is_silent((124.9, 24.9), 1.0)
    assert not one.may_deliver(14.9, (114.9, 14.9)), "it has no other so soon"
    assert one.may_deliver(15.1, (115.2, 15.2)) and not one.may_deliver(15.1, (115.9, 15.9))
    assert one.may_deliver(15.1, (115.9, math.nan)), "a clock that stands still"


def test_a_single_sensor_with_a_name_is_not_compared():
    deck = Deck(names=("one",))
    assert "no other sensor" in deck.picture.figures_of("one", 5.0)[1]["alignment"]
