"""Places of tracks on the earth, and their closest approach."""

from __future__ import annotations

import io
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from pyproj import Geod

from tsepm_ros.tools.bridge.closest_approach import closest_approach
from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tools.bridge.geojson import TrackLines
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays


def test_a_position_is_found_by_the_geodesic_from_the_reference():
    reference = GeographicReference(59.65, 10.63, east=500.0, north=-200.0)
    (latitude, longitude), *_ = reference.geographic(np.array([[500.0, 1800.0]])).tolist()
    azimuth, _, distance = Geod(ellps="WGS84").inv(10.63, 59.65, longitude, latitude)
    assert (azimuth, distance) == pytest.approx((0.0, 2000.0), abs=1e-6)


def test_longitudes_go_on_across_180_degrees():
    east = GeographicReference(10.0, 179.999).geographic(np.array([[1000.0, 0.0]]))[0, 1]
    assert -180.0 <= east < -179.98


@pytest.mark.parametrize(
    ("latitude", "longitude", "words"),
    [(89.5, 0.0, "near a pole"), (math.nan, 0.0, "latitude"), (0.0, math.inf, "longitude")],
)
def test_a_reference_near_a_pole_or_nowhere_is_refused_with_a_sentence(latitude, longitude, words):
    with pytest.raises(ValueError, match=words):
        GeographicReference(latitude, longitude)


@pytest.mark.parametrize("text", ["59.6", "59.6,10.6,3", "north,east", ""])
def test_a_text_that_is_no_origin_is_refused_with_an_example(text):
    with pytest.raises(ValueError, match=r"such as 59.65,10.63"):
        GeographicReference.read(text)


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5, -2.0])
def test_the_approach_of_a_straight_passage_is_that_of_its_closed_form(turn):
    # d abeam at time t, at speed v: it began at v t before.
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    position, velocity = rotation @ (-50.0, 30.0), rotation @ (2.0, 0.0)
    distance, time = closest_approach(position[None], velocity[None])
    assert (distance[0], time[0]) == pytest.approx((30.0, 25.0))
    distance, time = closest_approach(position[None], -velocity[None])
    assert (distance[0], time[0]) == pytest.approx((30.0, -25.0))


def test_of_what_does_not_move_the_approach_is_now():
    distance, time = closest_approach(np.array([[3.0, 4.0]]), np.zeros((1, 2)))
    assert (distance[0], time[0]) == (5.0, 0.0)
    distance, time = closest_approach(np.array([[3.0, 4.0]]), np.array([[1e-16, 0.0]]))
    assert (distance[0], time[0]) == (5.0, 0.0), "velocities that differ by rounding"


def lines(steps):
    """The collection of one track at positions, a scan each."""
    file = io.StringIO()
    made = TrackLines(file, GeographicReference(10.0, 179.99))
    made.__enter__()
    for number, (east, north) in enumerate(steps):
        state = np.array([east, 1.0, north, 0.0])
        track = ConfirmedTrack(4, float(number), state, np.eye(4), (), 0.0)
        result = SimpleNamespace(current=TrackArrays.of([track]), stamp_ns=number * 10**9, ended={})
        made.write(result)
    made.write(SimpleNamespace(current=TrackArrays.of([]), stamp_ns=10**10, ended={4: "missed"}))
    made.__exit__(None)
    return json.loads(file.getvalue())["features"]


def test_geojson_has_a_line_for_each_track_with_times_course_and_end():
    (feature,) = lines([(0.0, 0.0), (10.0, 0.0)])
    assert feature["geometry"]["type"] == "LineString"
    assert feature["geometry"]["coordinates"][0] == [179.99, 10.0]
    found = feature["properties"]
    assert found["times"] == ["1970-01-01T00:00:00+00:00", "1970-01-01T00:00:01+00:00"]
    assert (found["course"], found["speed"], found["ended"]) == (90.0, 1.0, "missed")


def test_a_track_of_one_ping_is_a_point():
    (feature,) = lines([(0.0, 0.0)])
    assert feature["geometry"] == {"type": "Point", "coordinates": [179.99, 10.0]}


def test_a_run_that_fails_leaves_no_collection_and_unknown_ends_are_none():
    file = io.StringIO()
    with pytest.raises(OSError, match="full"), TrackLines(file, GeographicReference(0, 0)) as made:
        made.write(SimpleNamespace(current=TrackArrays.of([]), stamp_ns=0, ended={9: "missed"}))
        raise OSError("full")
    assert file.getvalue() == ""


def test_a_line_across_180_degrees_is_cut_there():
    (feature,) = lines([(0.0, 0.0), (2000.0, 0.0)])
    assert feature["geometry"]["type"] == "MultiLineString"
    west, east = feature["geometry"]["coordinates"]
    assert west[-1][0] == 180.0
    assert east[0][0] == -180.0
    assert west[-1][1] == east[0][1]
