"""A scan as the page draws it."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from support.pages import held

from tsepm_ros.tools.viewer.page_frames import (
    MAX_POTENTIAL,
    encode,
    geographic_terms,
    make_frame,
    potential_rows,
    sector,
    track_facts,
    track_rows,
)
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import TrackArrays


def potential(x: float, score: float, newest: int, threshold: float = 10.0):
    return held(0, x, 0.0, score=score, evaluation=score - threshold, hits=((0, 0), (1, newest)))


def test_a_track_s_row_has_its_state_ellipse_speed_error_and_time_since_the_last_detection():
    track = replace(held(12, 1000.126, -2000.0, 3.0, 4.0), time_since_hit=2.5)
    ((track_id, *numbers),) = track_rows([track])
    # Along (0.6, 0.8): 0.36 * 1 + 0.64 * 4 = 2.92 m^2/s^2.
    axes = 2.4477 * 30.0, 2.4477 * 20.0
    expected = [1000.126, -2000.0, 3.0, 4.0, *axes, math.pi / 2, math.sqrt(2.92), 2.5]
    units = [100, 100, 1000, 1000, 100, 100, 1000, 1000, 1000]
    assert track_id == 12 and all(type(number) is int for number in numbers)
    assert np.abs(numbers) == pytest.approx(np.abs(expected) * units, abs=0.51)


def test_what_is_not_finite_is_left_out_and_the_frame_is_json():
    broken = held(1, math.nan, 0.0)
    blind = held(2, 5.0, 6.0, covariance=np.full((4, 4), np.inf), time_since_hit=math.nan)
    frame = make_frame(
        3.0,
        "odom",
        detections=np.array([[1.0, 2.0], [np.nan, 1.0], [np.inf, 0.0]]),
        tracks=[broken, blind],
        potential=[broken],
        fixed=[broken],
        own_ship=(1.0, 2.0, math.nan),
    )
    assert json.loads(encode(frame)) == frame
    assert frame["detections"] == [100, 200]
    assert [row[0] for row in frame["tracks"]] == [2]
    assert frame["tracks"][0][5:] == [0, 0, 0, 0, 0]
    assert (frame["potential"], frame["fixed"]) == ([], [])
    assert frame["own_ship"] == [100, 200, None]
    assert make_frame(0.0, "", own_ship=(math.nan, 0.0, 0.0))["own_ship"] is None


def test_what_is_far_beyond_any_sea_stays_a_number():
    frame = make_frame(
        0.0, "", detections=np.array([[1e300, -1e300]]), tracks=[held(1, 1e200, 0.0)]
    )
    assert frame["detections"] == [10**15, -(10**15)]
    assert frame["tracks"][0][1] == 10**15


def test_evidence_is_summed_over_the_hypotheses_of_a_detection_and_the_best_is_drawn_last():
    tracks = [
        potential(1.0, 4.0, 0),
        potential(2.0, 4.0 - math.log(3.0), 0),
        potential(3.0, 2.0, 1),
    ]
    rows = potential_rows(tracks)
    assert [row[0] for row in rows] == [300, 100], "one per newest detection"
    # log(exp(4) + exp(4) / 3) = 4 + log(4 / 3)
    assert [row[4] for row in rows] == [20, 43]


def test_only_the_nearest_to_confirmation_are_drawn():
    rows = potential_rows([potential(1.0, 0.001 * k + 1.0, k) for k in range(MAX_POTENTIAL + 50)])
    assert len(rows) == MAX_POTENTIAL
    assert rows[-1][4] == max(row[4] for row in rows)


def test_facts_of_a_message_say_why_as_far_as_it_tells():
    facts = track_facts([held(4, 0.0, 0.0)], None)["4"]
    assert facts == {
        "first": 64.0,
        "confirmed": None,
        "hits": [],
        "reason": "3 hits in 4 pings; log-likelihood ratio 10.5, threshold 10.0",
        "revision": 0,
    }


@pytest.mark.parametrize(
    ("score", "evaluation", "reason"),
    [
        (math.nan, 1.234, "3 hits in 4 pings; evaluation 1.23"),
        (math.nan, math.nan, "3 hits in 4 pings"),
    ],
)
def test_facts_of_other_methods(score, evaluation, reason):
    track = held(4, 0.0, 0.0, score=score, evaluation=evaluation)
    assert track_facts([track], 100.0)["4"]["reason"] == reason


def test_a_tracker_s_own_track_has_no_reason():
    (track,) = TrackArrays.of([held(4, 0.0, 0.0, hits=(), age=math.nan)])
    facts = track_facts([track], None)["4"]
    assert (facts["reason"], facts["first"]) == ("", None)


def test_the_velocity_of_own_ship_is_in_mm_per_s_and_null_where_it_is_not_known():
    assert make_frame(0.0, "", own_ship=(0.0, 0.0, 0.0, 1.5, -2.0))["own_ship"][3:] == [1500, -2000]
    assert (
        make_frame(0.0, "", own_ship=(0.0, 0.0, 0.0, math.nan, 1.0))["own_ship"][3:] == [None] * 2
    )


def test_the_sector_is_from_the_bow():
    sensor = SensorModel(min_range=2.0, max_range=80.0, azimuth_min=-1.0, azimuth_max=1.0)
    assert sector(sensor, 0.5) == [2.0, 80.0, -0.5, 1.5]
    assert sector(sensor, None) == [2.0, 80.0, -1.0, 1.0]


@pytest.mark.parametrize("origin", ["0,0", "59.65,10.63", "-75,-179.99", "80,179.9", "-89,10"])
def test_places_on_the_earth_are_those_of_geodesics_within_a_metre(origin):
    pytest.importorskip("pyproj")
    from tsepm_ros.tools.bridge.geographic import WGS84, GeographicReference

    info = geographic_terms(origin)
    known = info["geographic"]
    reach = known["reach"]
    assert info["north"] and reach >= 11_000.0
    points = np.random.default_rng(1).uniform(-reach, reach, (200, 2))
    latitude, longitude = np.array(known["origin"])[:, None] + sum(
        np.outer([a, b], (points[:, 0] / reach) ** i * (points[:, 1] / reach) ** j)
        for i, j, a, b in known["terms"]
    )
    truth = GeographicReference.read(origin).geographic(points)
    away = WGS84.inv(longitude, latitude, truth[:, 1], truth[:, 0])[2]
    assert away.max() < 1.0


def test_without_an_origin_there_are_no_places_and_nothing_is_needed():
    assert geographic_terms("") == {}


def test_an_origin_without_its_library_says_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "tsepm_ros.tools.bridge.geographic", None)
    with pytest.raises(ValueError, match="pip install pyproj"):
        geographic_terms("59.65,10.63")
