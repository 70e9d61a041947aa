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
"""Content of the page: rows of tracks, health, land and a recorded run."""

from __future__ import annotations

import base64
import dataclasses
import json
import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from support.builders import scan_at
from support.pages import confirmed_track
from support.sessions import session

from msg_adapters.ping import ReadingOptions
from tsepm_ros import Scan
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.replay.offline import offline_recording_results
from tsepm_ros.tools.replay.recording import simulated_recording
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tools.viewer.page_content import (
    MAX_LAND,
    MAX_POTENTIAL,
    PageRecordedScene,
    encode_page_content,
    land_frame,
    make_page_frame,
    page_geographic_terms,
    page_health_of_message,
    page_health_of_run,
    page_potential_rows,
    page_track_facts,
    page_track_rows,
)
from tsepm_ros.tracker.maintenance.track_maintenance import ENDS
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import TrackArrays, TrackStatus


def potential(x: float, score: float, newest: int, threshold: float = 10.0):
    return confirmed_track(
        0, x, 0.0, score=score, evaluation=score - threshold, hits=((0, 0), (1, newest))
    )


def test_a_track_s_row_has_its_state_ellipse_speed_error_last_detection_status_and_existence():
    track = confirmed_track(
        12,
        *(1000.126, -2000.0, 3.0, 4.0),
        time_since_hit=2.5,
        status=TrackStatus.COASTING,
        existence_probability=0.25,
    )
    ((track_id, *numbers),) = page_track_rows([track])
    # Along (0.6, 0.8): 0.36 * 1 + 0.64 * 4 = 2.92 m^2/s^2.
    axes = 2.4477 * 30.0, 2.4477 * 20.0
    expected = [1000.126, -2000.0, 3.0, 4.0, *axes, math.pi / 2, math.sqrt(2.92), 2.5, 1, 0.25]
    units = [100, 100, 1000, 1000, 100, 100, 1000, 1000, 1000, 1, 100]
    assert track_id == 12 and all(type(number) is int for number in numbers)
    assert np.abs(numbers) == pytest.approx(np.abs(expected) * units, abs=0.51)


def test_what_is_not_finite_is_left_out_and_what_is_far_beyond_any_sea_stays_a_number():
    broken = confirmed_track(1, math.nan, 0.0)
    blind = confirmed_track(
        2, 5.0, 6.0, covariance=np.full((4, 4), np.inf), time_since_hit=math.nan
    )
    frame = make_page_frame(
        3.0,
        "odom",
        detections=np.array([[1.0, 2.0], [np.nan, 1.0], [np.inf, 0.0]]),
        tracks=[broken, blind],
        potential=[broken],
        fixed=[broken],
        own_ship=(1.0, 2.0, math.nan),
    )
    assert json.loads(encode_page_content(frame)) == frame
    assert frame["detections"] == [100, 200]
    assert [row[0] for row in frame["tracks"]] == [2]
    assert frame["tracks"][0][5:] == [0, 0, 0, 0, 0, 0, 100]
    assert (frame["potential"], frame["fixed"]) == ([], [])
    assert frame["own_ship"] == [100, 200, None]
    assert make_page_frame(0.0, "", own_ship=(math.nan, 0.0, 0.0))["own_ship"] is None
    frame = make_page_frame(
        0.0, "", detections=np.array([[1e300, -1e300]]), tracks=[confirmed_track(1, 1e200, 0.0)]
    )
    assert frame["detections"] == [10**15, -(10**15)]
    assert frame["tracks"][0][1] == 10**15


def test_potential_tracks_are_drawn_with_their_evidence_and_only_the_nearest_to_confirmation():
    tracks = [
        potential(1.0, 4.0, 0),
        potential(2.0, 4.0 - math.log(3.0), 0),
        potential(3.0, 2.0, 1),
    ]
    rows = page_potential_rows(tracks)
    assert [row[0] for row in rows] == [300, 100], "one per newest detection"
    # log(exp(4) + exp(4) / 3) = 4 + log(4 / 3)
    assert [row[4] for row in rows] == [20, 43]
    rows = page_potential_rows(
        [potential(1.0, 0.001 * k + 1.0, k) for k in range(MAX_POTENTIAL + 50)]
    )
    assert len(rows) == MAX_POTENTIAL
    assert rows[-1][4] == max(row[4] for row in rows)


def test_facts_of_a_message_say_why_as_far_as_it_tells():
    facts = page_track_facts([confirmed_track(4, 0.0, 0.0)], None)["4"]
    assert facts == {
        "first": 64.0,
        "confirmed": None,
        "hits": [],
        "reason": "3 hits in 4 pings; log-likelihood ratio 10.5, threshold 10.0",
        "revision": 0,
    }
    (track,) = TrackArrays.from_tracks([confirmed_track(4, 0.0, 0.0, hits=(), age=math.nan)])
    facts = page_track_facts([track], None)["4"]
    assert (facts["reason"], facts["first"]) == ("", None)


@pytest.mark.parametrize(
    ("score", "evaluation", "reason"),
    [
        (math.nan, 1.234, "3 hits in 4 pings; evaluation 1.23"),
        (math.nan, math.nan, "3 hits in 4 pings"),
    ],
)
def test_facts_of_other_methods(score, evaluation, reason):
    track = confirmed_track(4, 0.0, 0.0, score=score, evaluation=evaluation)
    assert page_track_facts([track], 100.0)["4"]["reason"] == reason


def test_the_sector_is_from_the_bow_and_own_ship_s_velocity_in_mm_per_s_or_null():
    assert make_page_frame(0.0, "", own_ship=(0.0, 0.0, 0.0, 1.5, -2.0))["own_ship"][3:] == [
        1500,
        -2000,
    ]
    assert (
        make_page_frame(0.0, "", own_ship=(0.0, 0.0, 0.0, math.nan, 1.0))["own_ship"][3:]
        == [None] * 2
    )
    sensor = SensorModel(min_range=2.0, max_range=80.0, azimuth_min=-1.0, azimuth_max=1.0)
    for yaw, begin, end in ((0.5, -0.5, 1.5), (None, -1.0, 1.0)):
        recorded = PageRecordedScene("", True, mounting_yaw=yaw, sensor=sensor).document({})
        assert json.loads(recorded)["info"]["sector"] == [2.0, 80.0, begin, end]


@pytest.mark.parametrize("origin", ["0,0", "59.65,10.63", "-75,-179.99", "80,179.9", "-89,10"])
def test_places_on_the_earth_are_those_of_geodesics_within_a_metre(origin):
    pytest.importorskip("pyproj")
    from pyproj import Geod

    from tsepm_ros.tools.bridge.geographic import GeographicReference

    info = page_geographic_terms(origin)
    known = info["geographic"]
    reach = known["reach"]
    assert info["north"] and reach >= 11_000.0
    points = np.random.default_rng(1).uniform(-reach, reach, (200, 2))
    latitude, longitude = np.array(known["origin"])[:, None] + sum(
        np.outer([a, b], (points[:, 0] / reach) ** i * (points[:, 1] / reach) ** j)
        for i, j, a, b in known["terms"]
    )
    truth = GeographicReference.read(origin).geographic(points)
    away = Geod(ellps="WGS84").inv(longitude, latitude, truth[:, 1], truth[:, 0])[2]
    assert away.max() < 1.0


def test_an_origin_needs_its_library_and_without_one_there_are_no_places(monkeypatch):
    assert page_geographic_terms("") == {}
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(ValueError, match="pip install pyproj"):
        page_geographic_terms("59.65,10.63")


def status(name: str, level, message: str = "fine", **values: str):
    pairs = [SimpleNamespace(key=key, value=value) for key, value in values.items()]
    node = name.rpartition(": ")[0]
    return SimpleNamespace(name=name, level=level, message=message, values=pairs, hardware_id=node)


def array(*statuses):
    return SimpleNamespace(status=list(statuses))


def test_health_has_entries_of_the_track_initiator_and_an_error_is_worse_than_stale():
    health = page_health_of_message(
        array(
            status("boat: track initiation", b"\x00", "3 scans", scans="3", empty=""),
            status("boat: own ship", b"\x01", "no data yet"),
            status("boat: overall", b"\x01", "own ship: no data yet"),
            status("detector: overall", b"\x02", "no image"),
            status("battery: charge", b"\x02", "empty"),
        )
    )
    assert [(node, found["node"], found["level"]) for node, found in health.items()] == [
        *(("boat", "boat", 1), ("detector", "detector", 2))
    ]
    assert health["detector"]["entries"][0]["message"] == "no image"
    assert health["boat"]["entries"] == [
        {"task": "track initiation", "level": 0, "message": "3 scans", "values": [["scans", "3"]]},
        {"task": "own ship", "level": 1, "message": "no data yet", "values": []},
    ]
    levels = [("detections", 3), ("latency", 2), ("clutter", 0)]
    health = page_health_of_message(array(*(status(f"n: {task}", level) for task, level in levels)))
    assert health["n"]["level"] == 2


def test_a_row_has_the_closest_approach_where_own_ship_is_known():
    track = confirmed_track(7, 1000.0, 50.0, -8.0, 0.0)
    ship = (0.0, 0.0, 1.0, 0.0, 0.0, 0.5)
    ((*_, time, distance, std),) = page_track_rows([track], ship)
    assert (time, distance) == (125_000, 5000)  # ms and cm
    assert std == pytest.approx(100.0 * math.hypot(30.0, 2.0 * 125.0), rel=1e-3)
    frames = (
        make_page_frame(0.0, "map", tracks=[track], own_ship=known, resting=resting)
        for known, resting in ((None, ship), (ship, None), (ship, (1e4, *ship[1:])))
    )
    assert [frame["tracks"] for frame in frames] == [page_track_rows([track], ship)] * 3
    plain = page_track_rows([track])
    for unknown in (None, (0.0, 0.0, 1.0), (0.0, 0.0, 1.0, math.nan, math.nan, 9.0)):
        assert page_track_rows([track], unknown) == plain


def test_land_is_made_coarse_without_losing_a_cell_and_is_of_the_axes_of_its_frame():
    rows, columns = 3, 2 * MAX_LAND + 2
    cells = np.zeros((rows, columns), np.int8)
    cells[2, 0], cells[0, columns - 1] = 100, 100
    origin = SimpleNamespace(
        position=SimpleNamespace(x=1.0, y=2.0),
        orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
    )
    info = SimpleNamespace(width=columns, height=rows, resolution=2.0, origin=origin)

    def shown(frame_id):
        header = SimpleNamespace(frame_id=frame_id)
        land = land_frame(SimpleNamespace(header=header, info=info, data=cells.ravel()))
        bits = np.unpackbits(np.frombuffer(base64.b64decode(land["bits"]), np.uint8))
        places = np.flatnonzero(bits).tolist()
        return land, [(place % land["width"], place // land["width"]) for place in places]

    land, places = shown("odom")
    assert (land["cell"], land["origin"]) == (6.0, (1.0, 2.0, 0.0))
    assert places == [(0, 0), ((columns - 1) // 3, 0)]
    land, places = shown("odom_ned")
    assert land["origin"][:2] == (2.0, 1.0) and places == [(0, 0), (0, (columns - 1) // 3)]


def test_a_run_says_what_it_dropped_and_what_helps_and_without_scans_it_is_a_warning():
    health = page_health_of_run(5, {"heading_unknown": 2, "of_an_adapter": 1}, ["gap before 3 s"])
    assert health["level"] == 1
    sentences = [entry["message"] for entry in health["entries"]]
    assert sentences[0] == "5 scans processed"
    assert any(s.startswith("2 scans dropped: ") and "Remedy: " in s for s in sentences)
    assert "1 detection dropped: of_an_adapter" in sentences
    assert "gap before 3 s" in sentences
    assert page_health_of_run(0, {}, [])["level"] == 1
    assert page_health_of_run(1, {}, [])["level"] == 0


SCENARIO = load_scenario("four_targets")


def recorded(scenario=SCENARIO, seed: int = 1):
    """The page's recording of a run, and the new tracks of the run."""
    recording, _ = simulated_recording(Simulator(scenario, seed))
    options = SessionOptions(method="score", own_ship_source="odometry")
    run = Session(Settings(session=options, sensor=scenario.sensor))
    scene = PageRecordedScene("four targets", True, recording.truth)
    tracks = []
    for result in offline_recording_results([(recording, run, ReadingOptions("bow"))]):
        scene.add(result, run.tracker)
        tracks += result.new
    return json.loads(scene.document(run.dropped)), tracks, run


def test_a_track_that_ends_says_when_and_why():
    run, scene, ended = (
        session(own_ship_source="none", method="score"),
        PageRecordedScene("", True),
        {},
    )
    seen = [UnregisteredScan(scan_at(12.0 * k, [(3000.0, 0.0)]), "sonar") for k in range(16)]
    gone = [UnregisteredScan(Scan(12.0 * k, [], []), "sonar") for k in range(16, 90)]
    for scan in seen + gone:
        run.add_scan(scan, 0.0)
        for result in run.process():
            scene.add(result, run.tracker)
            ended |= {key: [result.stamp, ENDS[end]] for key, end in result.ended.items()}
    facts = json.loads(scene.document(run.dropped))["facts"]
    assert ended
    assert {int(key): fact["ended"] for key, fact in facts.items()} == ended


def test_a_track_s_hits_and_reason_are_its_own():
    page, tracks, run = recorded()
    for track in tracks:
        facts = page["facts"][str(track.track_id)]
        assert facts["confirmed"] == track.stamp
        assert facts["reason"] == run.tracker.reason(track)
        assert len(facts["hits"]) == len(track.hits)
        for (stamp, x, y), (scan, detection) in zip(facts["hits"], track.hits, strict=True):
            frame = page["frames"][scan]
            assert stamp == frame["stamp"]
            cm = frame["detections"][2 * detection : 2 * detection + 2]
            assert [100.0 * x, 100.0 * y] == pytest.approx(cm, abs=0.1)
            predicted = track.predicted(stamp).position
            assert np.hypot(x - predicted[0], y - predicted[1]) < 1500.0


def test_after_a_restart_hits_are_those_of_the_new_run():
    quiet = dataclasses.replace(SCENARIO, scans=8)
    recording, _ = simulated_recording(Simulator(quiet, 3))
    run = session(own_ship_source="none")
    scene = PageRecordedScene("twice", False)
    results = []
    for _ in range(2):
        for result in offline_recording_results([(recording, run, ReadingOptions("bow"))]):
            scene.add(result, run.tracker)
            results.append(result)
    page = json.loads(scene.document(run.dropped))
    restart = [k for k, frame in enumerate(page["frames"]) if frame.get("restart")]
    assert len(restart) == 1 and restart[0] > 0
    again = [track for result in results[restart[0] :] for track in result.new]
    assert again
    for track in again:
        first = page["facts"][str(track.track_id)]["hits"][0]
        (scan, detection), frames = track.hits[0], page["frames"][restart[0] :]
        cm = frames[scan]["detections"][2 * detection : 2 * detection + 2]
        assert [100.0 * value for value in first[1:]] == pytest.approx(cm, abs=0.1)


def test_the_velocity_of_own_ship_is_that_of_the_recorded_poses():
    page, *_ = recorded(load_scenario("square_path"))
    frames = page["frames"][1:]
    x, y, vx, vy = np.array([[*f["own_ship"][:2], *f["own_ship"][3:]] for f in frames], float).T
    stamps = np.array([frame["stamp"] for frame in frames])
    # cm and mm/s; by the difference from the scan before.
    np.testing.assert_allclose(vx[1:], 10.0 * np.diff(x) / np.diff(stamps), atol=2.0)
    np.testing.assert_allclose(vy[1:], 10.0 * np.diff(y) / np.diff(stamps), atol=2.0)
    assert np.hypot(vx, vy).max() > 1000.0
