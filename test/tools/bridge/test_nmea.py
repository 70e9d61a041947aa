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
"""Closest approach, NMEA sentences as another reader reads them, and Signal K deltas."""

from __future__ import annotations

import io
import json
import math
import re
import uuid
from dataclasses import replace
from datetime import datetime
from types import SimpleNamespace

import numpy as np
import pynmea2
import pytest
from pyproj import Geod

from tsepm_ros.tools.bridge import nmea
from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5, -2.0])
def test_the_approach_of_a_straight_passage_is_that_of_its_closed_form(turn):
    # d abeam at time t, at speed v: it began at v t before.
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    position, velocity = rotation @ (-50.0, 30.0), rotation @ (2.0, 0.0)
    time, distance = nmea.nmea_closest_approach(position[None], velocity[None])
    assert (distance[0], time[0]) == pytest.approx((30.0, 25.0))
    time, distance = nmea.nmea_closest_approach(position[None], -velocity[None])
    assert (distance[0], time[0]) == pytest.approx((30.0, -25.0))


def test_of_what_does_not_move_the_approach_is_now():
    time, distance = nmea.nmea_closest_approach(np.array([[3.0, 4.0]]), np.zeros((1, 2)))
    assert (distance[0], time[0]) == (5.0, 0.0)
    time, distance = nmea.nmea_closest_approach(np.array([[3.0, 4.0]]), np.array([[1e-16, 0.0]]))
    assert (distance[0], time[0]) == (5.0, 0.0), "velocities that differ by rounding"


STAMP = 1_700_000_000.26  # 22:13:20.26 UTC

AT_REST = np.zeros(2), np.zeros(2)


def tracks(*states, ids=None):
    ids = range(len(states)) if ids is None else ids
    return TrackArrays.from_tracks(
        [
            ConfirmedTrack(track_id, STAMP, np.array(state, float), np.eye(4), (), math.nan)
            for track_id, state in zip(ids, states, strict=True)
        ]
    )


def numbered(found):
    numbers = nmea.NmeaTargetNumbers()
    numbers.update(found.track_id.tolist())
    return numbers.of


def sent(reports):
    """Lines of the reports of tracks that are there."""
    return nmea.NmeaReports().texts(set(reports), STAMP, reports)


def parsed(reports):
    sentences = sent(reports)
    assert all(len(one) <= 82 and one.endswith("\r\n") for one in sentences)
    return [pynmea2.parse(one, check=True) for one in sentences]


def scene(rng):
    """Twenty tracks around own ship, to port and starboard of its course."""
    bearing, range_ = rng.uniform(0.0, 360.0, 20), rng.uniform(50.0, 9000.0, 20)
    velocity = rng.uniform(-8.0, 8.0, (20, 2))
    position = np.stack(
        [range_ * np.sin(np.radians(bearing)), range_ * np.cos(np.radians(bearing))], axis=1
    )
    return bearing, range_, position, velocity


def test_ttm_puts_twenty_tracks_at_their_bearings_and_ranges_from_own_ship():
    bearing, range_, position, velocity = scene(np.random.default_rng(1))
    own_ship = np.array([1000.0, -400.0]), np.array([3.0, 1.0])
    states = np.stack([position + own_ship[0], velocity], axis=2).reshape(20, 4)
    found = tracks(*states)
    messages = parsed(nmea.nmea_ttm("RA", found, numbered(found), own_ship))
    assert [int(one.data[0]) for one in messages] == list(range(20))
    for row, one in enumerate(messages):
        distance, angle, axis, speed, course = one.data[1:6]
        assert float(distance) * 1852.0 == pytest.approx(range_[row], abs=1.0)
        assert float(angle) == pytest.approx(bearing[row], abs=0.051)
        assert axis == "T"
        assert float(speed) * 1852.0 / 3600.0 == pytest.approx(np.hypot(*velocity[row]), abs=0.03)
        expected = math.degrees(math.atan2(*velocity[row])) % 360.0
        assert abs((float(course) - expected + 180.0) % 360.0 - 180.0) <= 0.051
        assert one.data[9] == "N"
        assert one.data[11] == "T"
        assert one.data[13] == "221320.3"


@pytest.mark.parametrize("longitude", [10.6, 179.99, -179.99])
@pytest.mark.parametrize("latitude", [59.65, -33.9, 0.01])
def test_tll_puts_twenty_tracks_where_they_are_on_the_earth(latitude, longitude):
    bearing, range_, position, velocity = scene(np.random.default_rng(2))
    found = tracks(*np.stack([position, velocity], axis=2).reshape(20, 4))
    places = GeographicReference(latitude, longitude).geographic(position)
    for row, one in enumerate(parsed(nmea.nmea_tll("RA", found, numbered(found), places))):
        angle, _, distance = Geod(ellps="WGS84").inv(
            longitude, latitude, one.longitude, one.latitude
        )
        assert distance == pytest.approx(range_[row], abs=0.3)
        assert abs((angle - bearing[row] + 180.0) % 360.0 - 180.0) * distance <= 20.0


def test_a_track_dead_ahead_of_a_sensor_without_north_is_at_the_relative_bearing_0():
    found = tracks([1852.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1852.0, 0.0])
    ahead, port = parsed(nmea.nmea_ttm("RA", found, numbered(found), AT_REST, from_north=False))
    assert (ahead.data[1], ahead.data[2], ahead.data[3]) == ("1.000", "0.0", "R")
    assert (port.data[1], port.data[2], port.data[3]) == ("1.000", "270.0", "R")


def test_the_approach_is_in_miles_and_minutes_and_now_without_a_minus():
    # 1 nautical mile east, half a mile north, westwards at 10 knots: abeam in 6 minutes.
    found = tracks([1852.0, -10.0 * nmea.KNOT, 926.0, 0.0], [1000.0, 0.0, 0.1, 1.0])
    one, now = parsed(nmea.nmea_ttm("RA", found, numbered(found), AT_REST))
    assert (one.data[7], one.data[8]) == ("0.500", "6.0")
    assert now.data[8] == "0.0"


def test_rounded_directions_stay_below_360_degrees_and_minutes_of_arc_below_60():
    found = tracks([-0.001, 0.0, 1000.0, 0.0])
    (one,) = parsed(nmea.nmea_ttm("RA", found, numbered(found), AT_REST))
    assert one.data[2] == "0.0" or one.data[1] == "0.0"
    found = tracks([0.0, 0.0, 0.0, 0.0])
    (text,) = sent(
        nmea.nmea_tll("RA", found, numbered(found), np.array([[9.9999999999, -0.0000001]]))
    )
    assert ",1000.0000,N,00000.0000,W," in text


@pytest.mark.parametrize("far", [-1.0, 1.8e6, 1.4e7])
def test_the_longest_sentences_have_at_most_82_characters(far):
    found = tracks([-far, -363.0, far, 363.0], ids=[2**32 - 1])  # 998 knots
    numbers = numbered(found)
    (one,) = parsed(nmea.nmea_ttm("RA", found, numbers, (np.zeros(2), np.array([-363.0, 400.0]))))
    assert float(one.data[1]) * 1852.0 == pytest.approx(abs(far) * math.sqrt(2.0), abs=186.0)
    assert one.data[4] == "997.9"
    parsed(nmea.nmea_tll("RA", found, numbers, np.array([[-59.123456, -179.654321]])))


def test_a_tracked_target_is_never_at_0_miles_which_means_lost():
    found = tracks([0.0, 1.0, 0.0, 0.0], [0.4, 0.0, 0.3, 0.0])
    messages = parsed(nmea.nmea_ttm("RA", found, numbered(found), AT_REST))
    assert [one.data[1] for one in messages] == ["0.001", "0.001"]


def test_tracks_on_no_place_of_the_earth_or_of_no_vessels_speed_are_not_written():
    found = tracks(
        [3e7, 0.0, 0.0, 0.0],
        [-1e9, 1e6, 1e9, -1e6],
        [9.0, 600.0, 9.0, 0.0],
        [1852.0, 1.0, 0.0, 0.0],
    )
    (one,) = parsed(nmea.nmea_ttm("RA", found, numbered(found), AT_REST))
    assert one.data[:2] == ["03", "1.000"]
    places = GeographicReference(59.65, 10.63).geographic(found.state[:, 0::2])
    assert np.isnan(places[:2]).all()
    assert [one.data[0] for one in parsed(nmea.nmea_tll("RA", found, numbered(found), places))] == [
        "02",
        "03",
    ]
    assert list(nmea.nmea_deltas(found, INSTANCE, places)) == [2, 3]


def opencpn(lines, own=(59.65, 10.63)):
    """Place and whether it is tracked, by number, as OpenCPN's decoder reads sentences.

    An empty field is 0; a distance of 0 is a lost target, whose place stays.
    """
    targets = {}
    for line in lines:
        fields = line.split("*")[0].split(",")
        numbers = [float(one) if one.replace(".", "").isdigit() else 0.0 for one in fields]
        number, place = int(numbers[1]), targets.get(int(numbers[1]), (None, False))[0]
        if fields[0].endswith("TLL"):
            latitude, longitude = (x // 100 + x % 100 / 60.0 for x in (numbers[2], numbers[4]))
            place = (
                latitude * (1 - 2 * (fields[3] == "S")),
                longitude * (1 - 2 * (fields[5] == "W")),
            )
            tracked = fields[8] != "L"
        else:
            tracked = fields[12] != "L" and numbers[2] != 0.0
            if numbers[2]:
                way = numbers[2] * 1852.0
                end = Geod(ellps="WGS84").fwd(own[1], own[0], numbers[3], way)
                place = end[1], end[0]
        targets[number] = place, tracked
    return targets


@pytest.mark.parametrize("kind", ["TTM", "TLL"])
@pytest.mark.parametrize("longitude", [10.6, 179.99, -179.99])
def test_twenty_tracks_end_where_they_were_last_under_their_numbers(kind, longitude):
    _, _, position, velocity = scene(np.random.default_rng(3))
    found = tracks(*np.stack([position, velocity], axis=2).reshape(20, 4))
    places = GeographicReference(-33.9, longitude).geographic(position)
    reports = {
        "TTM": nmea.nmea_ttm("RA", found, numbered(found), AT_REST),
        "TLL": nmea.nmea_tll("RA", found, numbered(found), places),
    }[kind]
    told = nmea.NmeaReports()
    first = opencpn(told.texts(set(range(20)), STAMP, reports), (-33.9, longitude))
    for number, place in enumerate(places):
        assert first[number][1], "tracked"
        ahead = (first[number][0][1] - place[1] + 180.0) % 360.0 - 180.0
        assert (first[number][0][0], ahead) == pytest.approx((place[0], 0.0), abs=2e-4)
    ends = told.texts({3, 4}, STAMP + 1.0, {})
    assert len(ends) == 18
    last = opencpn(ends, (-33.9, longitude))
    assert last == {
        number: (first[number][0], False) for number in range(20) if number not in (3, 4)
    }
    for one in map(pynmea2.parse, ends):
        assert one.data[{"TTM": 11, "TLL": 7}[kind]] == "L"
        assert one.data[{"TTM": 13, "TLL": 6}[kind]] == "221321.3"
    assert told.texts({3, 4}, STAMP + 2.0, {}) == [], "an end is told once"


def test_of_a_track_that_was_never_reported_no_end_is_told():
    assert nmea.NmeaReports().texts(set(), STAMP, {}) == []
    told = nmea.NmeaReports()
    told.texts({1}, STAMP, {})
    assert told.texts(set(), STAMP, {}) == []


INSTANCE = uuid.UUID("6ba7b810-9dad-41d1-80b4-00c04fd430c8")

VESSEL = re.compile(
    r"vessels\.urn:mrn:signalk:uuid:[0-9a-f]{8}-[0-9a-f]{4}-4[0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}"
)


def values_of(line):
    assert line.endswith("\n") and line.count("\n") == 1
    delta = json.loads(line)
    assert VESSEL.fullmatch(delta["context"])
    (update,) = delta["updates"]
    assert set(update) == {"$source", "timestamp", "values"}
    values = {one["path"]: one["value"] for one in update["values"]}
    return delta["context"], datetime.fromisoformat(update["timestamp"]).timestamp(), values


@pytest.mark.parametrize("longitude", [10.6, 179.99, -179.99])
def test_deltas_have_place_course_speed_and_name_and_null_at_the_end(longitude):
    _, _, position, velocity = scene(np.random.default_rng(4))
    found = tracks(*np.stack([position, velocity], axis=2).reshape(20, 4))
    places = GeographicReference(59.65, longitude).geographic(position)
    told, reports = nmea.NmeaReports(), nmea.nmea_deltas(found, INSTANCE, places)
    lines = told.texts(set(range(20)), STAMP, reports)
    vessels = []
    for row, line in enumerate(lines):
        vessel, stamp, values = values_of(line)
        vessels.append(vessel)
        place = values["navigation.position"]
        assert stamp == pytest.approx(STAMP, abs=1e-3)
        assert (place["latitude"], place["longitude"]) == pytest.approx(
            tuple(places[row]), abs=1e-7
        )
        assert -180.0 <= place["longitude"] < 180.0
        course, speed = (
            values[f"navigation.{x}"] for x in ("courseOverGroundTrue", "speedOverGround")
        )
        assert (speed * math.sin(course), speed * math.cos(course)) == pytest.approx(
            tuple(velocity[row]), abs=2e-3
        )
        assert values[""] == {"name": f"Track {row}"}
    assert len(set(vessels)) == 20
    assert list(nmea.nmea_deltas(found, INSTANCE, places).values()) == list(reports.values()), (
        "stable"
    )
    assert nmea.nmea_deltas(found, uuid.UUID(int=4), places)[0][0] != reports[0][0], "another run"
    (end,) = told.texts(set(range(1, 20)), STAMP + 1.0, {})
    vessel, stamp, values = values_of(end)
    assert (vessel, stamp) == (vessels[0], pytest.approx(STAMP + 1.0, abs=1e-3))
    assert values == {
        "navigation.position": None,
        "navigation.courseOverGroundTrue": None,
        "navigation.speedOverGround": None,
    }


@pytest.mark.parametrize("form", ["nmea", "signalk"])
def test_a_track_that_coasts_is_written_as_lost_once(form):
    found, file = tracks([10.0, 0.0, 0.0, 0.0]), io.StringIO()
    writer = nmea.nmea_report_writer(file, GeographicReference(10.0, 20.0), {}, form)
    for status in (0, 1, 1, 0):
        held = replace(found, status=np.array([status]))
        writer(SimpleNamespace(current=held, stamp_ns=round(STAMP * 1e9)))
    ends = [",L," in line or "null" in line for line in file.getvalue().splitlines()]
    assert ends == [False, True, False]


def test_numbers_are_free_at_a_tracks_end_and_beyond_100_tracks_that_is_noted():
    numbers = nmea.NmeaTargetNumbers()
    assert numbers.update([5, 6, 7]) == 0
    assert numbers.of == {5: 0, 6: 1, 7: 2}
    assert numbers.update([5, 7]) == 0
    numbers.update([5, 7, 8])
    assert numbers.of == {5: 0, 7: 2, 8: 3}, "the number that is free for the longest time"
    numbers.update([5, 6, 7, 8])
    assert numbers.of[6] == 1
    found = tracks(*[[10.0 * k, 0.0, 0.0, 0.0] for k in range(102)])
    file, notes = io.StringIO(), {}
    writer = nmea.nmea_report_writer(file, GeographicReference(10.0, 20.0), notes)
    for _ in range(3):
        writer(SimpleNamespace(current=found, stamp_ns=round(STAMP * 1e9)))
    assert len(file.getvalue().splitlines()) == 300
    assert notes["numbers"].startswith("6 positions of tracks beyond 100 at a time")
