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
"""The alarms as a table of events: what is seen at which time, and the states after it."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from support.pages import confirmed_track

from tsepm_ros.settings.node_options import AlarmOptions
from tsepm_ros.tools.viewer.alarms import (
    MAX_AGE,
    MAX_ALARMS,
    SILENCE_TIME,
    AlarmSupervisor,
    ObservedScan,
    closest_approaches,
)
from tsepm_ros.tracker.tracks import TrackArrays, TrackStatus

SHIP = (0.0, 0.0, math.pi / 2, 0.0, 0.0)
LIMITS = {"cpa_limit": 500.0, "lost_targets": True}
ZONE = {"guard_max_range": 1000.0, "lost_targets": False}
LOST = {"cpa_limit": 0.0, "lost_targets": True}


class Night:
    """A supervisor, what it sees, and the time."""

    def __init__(self, interval: float = 1.0, **limits) -> None:
        self.now, self.interval, self.stamp = 1000.0, interval, 50.0
        self.supervisor = AlarmSupervisor(AlarmOptions(**limits), lambda: 1e9 + self.now)

    def scan(self, *tracks, own_ship=SHIP, age: float = 0.1, first: float = 10.0, **more) -> None:
        """A scan after an interval; tracks have had their first hit at a stamp of `first`."""
        self.now += self.interval
        self.stamp += self.interval
        self.supervisor.tick(self.now)
        tracks = [replace(one, stamp=self.stamp, age=self.stamp - first) for one in tracks]
        arrays = TrackArrays.from_tracks(tracks)
        self.supervisor.observe(
            ObservedScan(self.stamp, arrays, own_ship=own_ship, **more), self.now, age
        )

    def scans(self, number: int, *tracks, **more) -> None:
        for _ in range(number):
            self.scan(*tracks, **more)

    def silence(self, seconds: float) -> None:
        """Time without any scan, with the ticks of a timer."""
        for _ in range(round(seconds)):
            self.now += 1.0
            self.stamp += 1.0
            self.supervisor.tick(self.now)

    def restart(self) -> Night:
        """The process is killed and started again, with the file that it has kept."""
        text = json.dumps(self.supervisor.kept())
        self.supervisor = AlarmSupervisor(self.supervisor.options, lambda: 1e9 + self.now)
        self.supervisor.restore(json.loads(text), self.now)
        return self

    @property
    def states(self) -> dict[str, str]:
        return {key: str(alarm.state(self.now)) for key, alarm in self.supervisor.alarms.items()}

    def sentence(self, key: str) -> str:
        return self.supervisor.alarms[key].sentence


def approaching(track_id: int = 7, x: float = 1000.0, y: float = 50.0, **more):
    return confirmed_track(track_id, x, y, -8.0, 0.0, **more)


def leaving(track_id: int = 7):
    return confirmed_track(track_id, 3000.0, 50.0, 8.0, 0.0)


def standing(track_id: int, x: float = 0.0):
    return confirmed_track(track_id, x, 300.0, 0.0, 0.0, status=TrackStatus.STANDS_STILL)


# ---- one condition ----


def test_an_alarm_goes_through_its_states():
    night = Night(**LIMITS)
    night.scan(leaving())
    assert night.states == {}
    night.scan(approaching())
    assert night.states == {"cpa 7": "unacknowledged"}
    night.supervisor.silence(night.now)
    assert night.states == {"cpa 7": "silenced"}
    night.scans(int(SILENCE_TIME) - 1, approaching())
    assert night.states == {"cpa 7": "silenced"}
    night.scan(approaching())
    assert night.states == {"cpa 7": "unacknowledged"}, "the sound comes back"
    night.supervisor.acknowledge()
    assert night.states == {"cpa 7": "acknowledged"}
    night.scans(20, approaching())
    assert night.states == {"cpa 7": "acknowledged"}, "one alarm for one approach"
    night.scans(20, leaving())
    assert night.states == {}
    night.scan(approaching())
    assert night.states == {"cpa 7": "unacknowledged"}, "another approach"


@pytest.mark.parametrize("interval", [1 / 30, 1.0, 12.0])
def test_what_nobody_acknowledges_stays_with_its_time(interval):
    night = Night(interval, **ZONE)
    night.scan(confirmed_track(7, 500.0, 0.0))
    begun = night.supervisor.alarms["zone 7"].time
    night.scans(math.ceil(60.0 / interval), confirmed_track(7, 5000.0, 0.0))
    assert night.states == {"zone 7": "rectified"}
    assert night.supervisor.alarms["zone 7"].time == begun
    assert night.supervisor.listed(night.now)[0]["sounds"]
    night.supervisor.silence(night.now)
    assert not night.supervisor.listed(night.now)[0]["sounds"]
    night.supervisor.acknowledge()
    assert night.states == {}


@pytest.mark.parametrize("interval", [0.1, 1.0, 12.0])
def test_a_cause_is_over_after_seconds_not_after_scans(interval):
    night = Night(interval, **ZONE)
    night.scans(10, confirmed_track(7, 500.0, 0.0))
    patience = max(5.0, 3.0 * interval)
    assert night.supervisor.patience == pytest.approx(patience)
    left = night.now
    while night.states == {"zone 7": "unacknowledged"}:
        night.scan(confirmed_track(7, 5000.0, 0.0))
    assert patience < night.now - left <= patience + 1.01 * interval


def test_a_cause_that_comes_back_before_the_acknowledgement_is_counted_in_its_alarm():
    night = Night(**ZONE)
    for _ in range(3):
        night.scan(confirmed_track(7, 500.0, 0.0))
        night.scans(10, confirmed_track(7, 5000.0, 0.0))
    night.scan(confirmed_track(7, 500.0, 0.0))
    [alarm] = night.supervisor.alarms.values()
    assert (alarm.count, alarm.time) == (4, 1e9 + 1001.0)
    night.supervisor.acknowledge({"zone 7": 3})
    assert night.states == {"zone 7": "unacknowledged"}, "a page had not yet shown the fourth"
    night.supervisor.acknowledge({"zone 7": 4, "cpa 9": 1})
    assert night.states == {"zone 7": "acknowledged"}


def test_the_most_urgent_comes_first_and_what_is_acknowledged_last():
    night = Night(**LIMITS, guard_max_range=300.0)
    night.scan(approaching(1, 4000.0), approaching(2, 2000.0), confirmed_track(3, 200.0, 0.0))
    assert [one["key"] for one in night.supervisor.listed(night.now)][:3] == [
        *("cpa 2", "cpa 1", "zone 3")
    ]
    night.supervisor.acknowledge({"cpa 2": 1})
    assert night.supervisor.listed(night.now)[-1]["key"] == "cpa 2"


# ---- closest approaches ----


def test_the_error_of_a_closest_approach_is_that_of_the_covariance():
    rng = np.random.default_rng(4)
    ship = (100.0, -50.0, 0.3, 2.0, -1.0)
    root = rng.normal(size=(4, 4)) * np.array([[20.0], [0.1], [20.0], [0.1]])
    covariance = root @ root.T
    state = np.array([2000.0, -7.0, 300.0, 1.0])
    track = confirmed_track(7, state[0], state[2], state[1], state[3], covariance=covariance)
    [[time, distance, std]] = closest_approaches(TrackArrays.from_tracks([track]), ship)
    relative = rng.multivariate_normal(state, covariance, 40_000) - (100.0, 2.0, -50.0, -1.0)
    position, velocity = relative[:, 0::2], relative[:, 1::2]
    times = -(position * velocity).sum(axis=1) / (velocity**2).sum(axis=1)
    then = position + times[:, None] * velocity
    middle = state - (100.0, 2.0, -50.0, -1.0)
    mean = middle[0::2] + time * middle[1::2]
    signed = then @ mean / distance  # the side on which it passes counts
    assert std == pytest.approx(np.std(signed), rel=0.05)


def test_a_track_that_hits_own_ship_or_moves_with_it_has_an_error_too():
    hits = confirmed_track(1, 1000.0, 0.0, -10.0, 0.0)
    along = confirmed_track(2, 0.0, 30.0, 0.0, 0.0)
    found = closest_approaches(TrackArrays.from_tracks([hits, along]), SHIP)
    assert found[0] == pytest.approx([100.0, 0.0, math.sqrt(900.0 + 100.0**2 * 4.0)])
    assert found[1] == pytest.approx([0.0, 30.0, 30.0])


def test_the_value_at_the_alarm_stands_beside_the_value_now():
    night = Night(**LIMITS)
    night.scan(approaching(y=480.0))
    night.scan(approaching(y=600.0))
    alarm = night.supervisor.alarms["cpa 7"]
    assert alarm.onset.startswith("track 7, 480 ± ") and alarm.onset.endswith(" m in 2.1 min")
    assert alarm.sentence.startswith("track 7, 600 ± ")
    assert night.states == {"cpa 7": "unacknowledged"}, "within its error it may be below 500 m"


def test_an_approach_is_over_once_it_exceeds_the_limit_by_its_error_or_has_passed():
    exact = np.diag([1.0, 1e-4, 1.0, 1e-4])
    night = Night(**LIMITS)
    night.scan(approaching(y=480.0, covariance=exact))
    night.scans(7, approaching(y=982.0, covariance=exact))
    assert night.states == {"cpa 7": "rectified"}
    night.scans(2, approaching(x=10.0))
    night.scans(7, confirmed_track(7, -300.0, 50.0, -8.0, 0.0))
    assert night.states == {"cpa 7": "unacknowledged"}, "it passed, and is still near"
    night.scans(7, confirmed_track(7, -600.0, 50.0, -8.0, 0.0))
    assert night.states == {"cpa 7": "rectified"}


def test_an_approach_ends_with_its_limit_whatever_its_error():
    for limits in ({"cpa_limit": 0.0}, {"cpa_limit": 500.0, "tcpa_limit": 60.0}):
        night = Night(**LIMITS)
        night.scan(approaching(x=2000.0))
        night.supervisor.options = AlarmOptions(**limits)
        night.scans(7, approaching(x=2000.0))
        assert night.states == {"cpa 7": "rectified"}


def test_a_track_near_own_ship_that_moves_with_it_or_whose_speed_is_unknown_has_not_passed():
    for own_ship in (SHIP, (*SHIP[:3], math.nan, math.nan)):
        night = Night(**LIMITS)
        night.scans(3, confirmed_track(7, 0.0, 300.0, 0.0, 0.0), own_ship=own_ship)
        [alarm] = night.supervisor.listed(night.now)
        assert alarm["sentence"] == "track 7, 300 ± 30 m"
        night.scans(7, approaching(), own_ship=own_ship)
        assert night.states["cpa 7"] == ("rectified" if own_ship != SHIP else "unacknowledged")


@pytest.mark.parametrize("speed", [0.1, 0.0, -0.1])
def test_an_approach_within_the_limit_does_not_end_however_slow_it_is(speed):
    night = Night(**LIMITS)
    night.scans(2, confirmed_track(7, 0.0, 300.0, 0.0, -1.0))
    night.scans(20, confirmed_track(7, 0.0, 300.0, 0.0, -speed))
    assert night.states == {"cpa 7": "unacknowledged"}


def test_an_approach_after_the_time_limit_and_without_a_limit_raises_none():
    for limits in ({"cpa_limit": 500.0, "tcpa_limit": 60.0}, {"cpa_limit": 0.0}):
        night = Night(lost_targets=False, **limits)
        night.scans(3, approaching())
        assert night.states == {}


# ---- the guard zone ----


def test_the_guard_zone_is_the_sector_of_the_closed_form():
    rng = np.random.default_rng(5)
    places = rng.uniform(-1500.0, 1500.0, (200, 2))
    tracks = [confirmed_track(k, *place) for k, place in enumerate(places)]
    for begin, end, heading in rng.uniform((-3.0, 0.3, -3.0), (0.0, 3.0, 3.0), (8, 3)):
        limits = {"guard_azimuth_min": begin, "guard_azimuth_max": end, "guard_min_range": 200.0}
        night = Night(**ZONE, **limits)
        night.scan(*tracks, own_ship=(10.0, 20.0, heading, 0.0, 0.0))
        way = (places - (10.0, 20.0)) @ (1.0, 1.0j)
        bearing = np.angle(way * np.exp(-1j * (heading + 0.5 * (begin + end))))
        inside = (np.abs(bearing) <= 0.5 * (end - begin)) & (np.abs(way) >= 200.0)
        wanted = np.flatnonzero(inside & (np.abs(way) <= 1000.0)).tolist()
        assert set(night.states) == {f"zone {k}" for k in wanted}


def test_without_north_a_target_18_degrees_to_starboard_is_at_18_degrees_and_in_its_sector():
    angle = math.radians(-18.0)  # counter-clockwise from the bow, which is x
    target = confirmed_track(7, 500.0 * math.cos(angle), 500.0 * math.sin(angle))
    sector = {"guard_azimuth_min": math.radians(-30.0), "guard_azimuth_max": math.radians(-5.0)}
    night = Night(**ZONE, **sector)
    night.scan(target, own_ship=(0.0,) * 5, north=False)
    assert night.sentence("zone 7") == "track 7, 500 m, 018°R"
    night.scan(target, own_ship=(0.0,) * 5, north=True)
    assert night.sentence("zone 7") == "track 7, 500 m, 108°T"


# ---- what stands still and what is lost ----


def test_what_stands_still_raises_no_alarm_unless_the_zone_asks_for_it():
    for asks in (False, True):
        night = Night(cpa_limit=900.0, guard_max_range=1000.0, guard_standing=asks)
        night.scans(3, standing(7))
        night.scans(20)
        assert set(night.states) == ({"zone 7"} if asks else set())


@pytest.mark.parametrize("interval", [0.1, 1.0, 12.0])
@pytest.mark.parametrize("coasts", [False, True])
def test_a_track_that_is_missing_or_coasts_is_lost_after_the_patience(interval, coasts):
    night = Night(interval, **LOST)
    track = confirmed_track(7, 600.0, 800.0, 0.0, 1.0)
    after = [replace(track, status=TrackStatus.COASTING)] if coasts else []
    night.scans(10, track)
    left = night.now
    while not night.states:
        night.scan(*after)
    patience = max(5.0, 3.0 * interval)
    assert patience < night.now - left <= patience + 1.01 * interval
    assert night.states == {"lost 7": "unacknowledged"}
    assert night.sentence("lost 7") == "track 7, 1000 m, 037°T"
    assert night.supervisor.listed(night.now)[0]["places"] == {"7": (600.0, 800.0)}
    night.scans(30, *after)
    assert night.states == {"lost 7": "unacknowledged"}
    night.supervisor.acknowledge()
    night.scans(30, *after)
    assert night.states == {}


def test_a_lost_track_that_comes_back_by_its_id_or_in_its_place_is_rectified():
    for back in (confirmed_track(7, 0.0, 0.0), confirmed_track(9, 600.0, 800.0, 0.0, 1.0)):
        night = Night(**LOST)
        night.scan(confirmed_track(7, 600.0, 800.0, 0.0, 0.0))
        night.scans(8)
        assert night.states == {"lost 7": "unacknowledged"}
        night.scan(back)
        assert night.states == {"lost 7": "rectified"}


def test_what_has_become_a_fixed_echo_or_another_s_is_not_lost():
    night = Night(**LOST)
    tracks = [confirmed_track(k, 1000.0 * k, 0.0, 1.0, 0.0) for k in range(1, 5)]
    night.scan(*tracks)
    other = confirmed_track(9, 2000.0, 0.0, 1.0, 0.0)
    night.scans(9, other, standing(3), fixed=frozenset({1}))
    assert set(night.states) == {"lost 4"}


def test_lost_tracks_count_within_the_range_that_is_set_or_with_an_alarm_of_their_own():
    night = Night(lost_targets=True, lost_range=1500.0, cpa_limit=100.0)
    near, far = confirmed_track(1, 1000.0, 0.0, 0.0, 0.0), confirmed_track(2, 3000.0, 0.0, 0.0, 0.0)
    night.scan(near, far, approaching(3, 4000.0))
    night.scans(8)
    assert set(night.states) == {"cpa 3", "lost 1", "lost 3"}


# ---- data ----


def test_lost_tracks_are_one_alarm_when_data_had_stopped_and_those_that_stand_are_none():
    night = Night(**LOST)
    moving = [confirmed_track(k, 1000.0 * k, 0.0, 1.0, 0.0) for k in range(1, 6)]
    night.scans(10, *moving, *(standing(k, 10.0 * k) for k in range(10, 70)))
    night.silence(60.0)
    assert night.states == {"data": "unacknowledged"}
    assert night.sentence("data") == "no scan for 60 s"
    night.supervisor.acknowledge()
    night.scan()
    assert set(night.states) <= {"data"}, "they have the patience to come back"
    night.scans(10)
    assert night.states == {"lost when data stopped": "unacknowledged"}
    assert night.sentence("lost when data stopped") == "5 when data stopped: 1, 2, 3, 4, 5"
    night.scan(*moving[:2])
    assert len(night.supervisor.alarms["lost when data stopped"].places) == 3
    night.scan(*moving[2:])
    assert night.states == {"lost when data stopped": "rectified"}


@pytest.mark.parametrize("interval", [1 / 30, 1.0, 12.0])
def test_data_is_missing_after_5_s_or_three_intervals(interval):
    night = Night(interval)
    night.scan()
    night.supervisor.tick(night.now + 59.0)
    assert night.states == {}, "the interval is not known"
    night.scans(9)
    patience = max(5.0, 3.0 * interval)
    night.supervisor.tick(night.now + 0.99 * patience)
    assert night.states == {}
    night.supervisor.tick(night.now + 1.01 * patience)
    assert night.states == {"data": "unacknowledged"}


def test_stamps_that_are_20_s_late_are_said_and_those_of_another_time_are_not():
    for age, words in (
        (21.0, "stamps are 21 s old, or the clocks differ"),
        (-21.0, "stamps are 21 s ahead, or the clocks differ"),
        (0.5, ""),
        (1.1 * MAX_AGE, ""),
    ):
        night = Night()
        night.scans(8, age=age)
        assert night.states == ({"age": "unacknowledged"} if words else {})
        assert not words or night.sentence("age") == words


def test_one_scan_that_is_late_or_stamped_as_the_clock_stepped_is_no_old_data():
    night = Night()
    for step in (30.0, -30.0, 600.0):
        night.scans(8, age=0.2)
        night.scan(age=step)
        night.scans(8, age=0.2)
        assert night.states == {}


def test_a_slow_sonar_whose_turns_last_longer_than_5_s_has_no_old_data():
    night = Night(12.0)
    night.scans(8, age=14.0)
    assert night.states == {}


def test_what_the_limits_need_of_own_ship_is_said_once_it_is_missing_for_the_patience():
    blind, still = (0.0, 0.0, math.nan, 1.0, 0.0), (0.0, 0.0, 0.0, math.nan, math.nan)
    sector = {"guard_azimuth_min": 0.0, "guard_azimuth_max": 1.0}
    for limits, ship, words in (
        (LIMITS, None, "no own ship"),
        (LIMITS, still, "no speed of own ship"),
        (LIMITS, blind, ""),
        ({**ZONE, **sector}, blind, "no heading"),
        (ZONE, blind, ""),
        (LOST, None, ""),
    ):
        night = Night(**limits)
        night.scans(5, own_ship=ship)
        assert night.states == {}
        night.scans(3, own_ship=ship)
        assert night.states == ({"watch": "unacknowledged"} if words else {})
        assert not words or night.sentence("watch") == words
        night.scans(8)
        assert night.states == ({"watch": "rectified"} if words else {})


# ---- restarts ----


def test_a_restart_keeps_states_and_raises_nothing_twice():
    night = Night(**LIMITS, guard_max_range=300.0)
    night.scans(3, approaching(1), approaching(2), confirmed_track(3, 0.0, 200.0, 0.0, 0.0))
    night.supervisor.acknowledge({"cpa 1": 1})
    before = night.states
    assert sorted(before.values()) == ["acknowledged", *["unacknowledged"] * 3]
    night.restart()
    assert night.states == before
    night.scans(10, approaching(1), approaching(2), confirmed_track(3, 0.0, 200.0, 0.0, 0.0))
    assert night.states == before
    assert {alarm.count for alarm in night.supervisor.alarms.values()} == {1}
    night.restart()
    night.scans(10, leaving(1), leaving(2), leaving(3))
    assert set(night.states.values()) == {"rectified"} and "cpa 1" not in night.states


def test_a_restart_while_there_is_no_data_leaves_the_alarm():
    night = Night()
    night.scans(3)
    night.silence(60.0)
    night.restart().silence(60.0)
    assert night.states == {"data": "unacknowledged"}
    night.scans(10)
    assert night.states == {"data": "rectified"}


def test_the_ids_of_a_track_initiator_that_starts_again_are_of_another_run():
    night = Night(**LOST)
    night.scans(3, confirmed_track(5, 3000.0, 0.0, 0.0, 0.0), first=20.0)
    night.scans(8, first=20.0)
    assert night.states == {"lost 5": "unacknowledged"}
    begun = night.stamp + 1.0
    night.scans(5, confirmed_track(5, -3000.0, 0.0, 0.0, 0.0), first=begun)
    assert night.states == {"lost 5": "unacknowledged"}, "the 5 of now is another"
    assert night.supervisor.run == 2
    night.restart()
    night.scans(8, first=begun)
    assert night.supervisor.run == 2
    night.scans(3, confirmed_track(6, 0.0, 3000.0, 0.0, 0.0), first=begun)
    night.scans(8, first=begun)
    assert set(night.states) == {"lost 5", "lost 6 (run 2)"}


def test_ids_given_again_to_stamps_that_go_back_are_of_another_run():
    night = Night()
    night.scans(3, confirmed_track(5, 3000.0, 0.0, 0.0, 0.0))
    night.stamp = 0.0
    night.scans(3, confirmed_track(5, -3000.0, 0.0, 0.0, 0.0), first=-10.0)
    assert night.supervisor.run == 2


def test_where_there_are_too_many_alarms_the_oldest_of_lost_tracks_give_way_and_are_counted():
    night = Night(**LIMITS)
    for track_id in range(MAX_ALARMS):
        night.supervisor.judge(f"lost {track_id}", True, "", night.now)
    night.scans(2, approaching(MAX_ALARMS + 1))
    assert f"cpa {MAX_ALARMS + 1}" in night.states and "lost 0" not in night.states
    assert night.supervisor.watched() == "CPA 500 m, lost targets (1 older alarms left out)"
    night.supervisor.acknowledge()
    assert night.supervisor.watched() == "CPA 500 m, lost targets"


def test_what_is_watched_is_named():
    for limits, words in (
        ({"lost_targets": False}, ""),
        ({}, "lost targets"),
        ({"lost_range": 300.0}, "lost targets within 300 m"),
        ({**LIMITS, **ZONE, "lost_targets": True}, "CPA 500 m, guard zone, lost targets"),
    ):
        assert Night(**limits).supervisor.watched() == words


def test_a_file_of_another_content_is_refused():
    for kept in ({}, {"run": 1, "newest": [0], "alarms": []}, {"alarms": [{"key": 1}]}):
        with pytest.raises((KeyError, TypeError, ValueError)):
            Night().supervisor.restore(kept, 0.0)


def test_a_night_loses_no_alarm_and_raises_none_twice_for_one_cause():
    """300 tracks, 20 outages, restarts of viewer and node, steps of the clock, two pages."""
    rng = np.random.default_rng(7)
    places = 1000.0 * np.stack(np.divmod(np.arange(300.0), 20.0), axis=1) + (3000.0, -9000.0)
    moving = [confirmed_track(k, *place, 0.0, 0.0) for k, place in enumerate(places[:240], 1)]
    still = [
        confirmed_track(k, *place, 0.0, 0.0, status=TrackStatus.STANDS_STILL)
        for k, place in enumerate(places[240:], 241)
    ]
    near = confirmed_track(400, 1000.0, 50.0, -2.0, 0.0)
    night, first = Night(**LIMITS), 10.0

    def page(keys):  # a second page sends what the first has sent
        for _ in range(2):
            night.supervisor.acknowledge({key: 1000.0 for key in keys})

    for outage in range(20):
        night.scans(8, *moving, *still, near, first=first)
        cpa = "cpa 400" if night.supervisor.run == 1 else f"cpa 400 (run {night.supervisor.run})"
        assert night.states[cpa] in ("unacknowledged", "acknowledged")
        assert set(night.states.values()) <= {"unacknowledged", "acknowledged", "rectified"}
        if outage % 3 == 0:
            page([cpa])
        night.scan(*moving, *still, near, first=first, age=rng.choice([-3000.0, 40.0, 3000.0]))
        if outage % 4 == 1:
            before = night.states
            night.restart()
            assert night.states == before
        night.silence(float(rng.integers(8, 60)) + 60.0 * (outage % 4 == 1))
        assert night.states["data"] == "unacknowledged"
        if outage % 2:
            page(["data"])
            assert night.states["data"] == "acknowledged"
        if outage in (6, 14):  # the node is started again, and confirms the same targets again
            first = night.stamp + 1.0
            night.scans(3, first=first)
        night.scans(12, *moving, *still, near, first=first)
        assert night.states.get("data") == (None if outage % 2 else "rectified")
        page(["data"])
        assert not [key for key in night.states if key.startswith(("lost", "age", "zone"))], outage
    assert night.supervisor.run == 3
    [approach] = night.supervisor.alarms.values()
    assert (approach.key, approach.count) == ("cpa 400 (run 3)", 1), "the same target all night"
    assert approach.time == 1e9 + 1001.0
    night.scans(8, *still, near, first=first)
    lost = [key for key in night.states if key.startswith("lost")]
    assert len(lost) == 240, "each by itself while data comes"
