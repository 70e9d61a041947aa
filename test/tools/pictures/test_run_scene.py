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
"""Content of a picture of a run: ships, hits, ways of tracks, and the headline."""

from dataclasses import replace

import numpy as np
import pytest

from msg_adapters.ping import ReadingOptions
from tsepm_ros import Scan
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.evaluation.simulated_run import Judged, Outcome
from tsepm_ros.tools.pictures.run_scene import (
    RunScene,
    SceneScan,
    scene_headline,
    scene_vessel_pose,
)
from tsepm_ros.tools.replay.offline import offline_recording_results
from tsepm_ros.tools.replay.recording import simulated_recording
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

MOVING = Settings(session=SessionOptions(own_ship_source="odometry"))

SAILING = {"own_ship": {"x": 100.0, "y": -50.0, "yaw_deg": 40.0, "speed": 5.0}, "scans": 6}


@pytest.fixture(scope="module")
def simulated():
    simulator = Simulator(load_scenario("four_targets", SAILING), 3, start=50.0)
    return simulator, *simulated_recording(simulator)


def test_starts_of_several_sensors_are_judged_by_the_scans_of_each_at_equal_stamps_too():
    simulator = Simulator(load_scenario("radar_and_sonar"), 2)
    recording, origins = simulated_recording(simulator)
    assert [scan.time for scan in recording.scans[:2]] == [0.0, 0.0]
    # The first scan was dropped; a track has every hit of a target in the others.
    scans = [replace(view(0), stamp=one.time, name=one.sensor) for one in recording.scans[1:]]
    hits = [
        (scan, int(np.flatnonzero(origin == 0)[0]))
        for scan, origin in enumerate(origins[1:])
        if 0 in origin
    ]
    track = track_at(1, 0.0, tuple(hits))
    scans[-1] = replace(scans[-1], new=TrackArrays.from_tracks([track]))
    scene = RunScene("run", scans)
    scene.judge(simulator, recording, origins)
    assert [(one.target, one.pure) for one in scene.judged] == [(0, True)]


def test_a_sensor_that_looks_abeam_does_not_turn_the_ship(simulated):
    _, recording, _ = simulated
    mounting = Mounting(yaw=np.pi / 2)
    session = Session(Settings(session=MOVING.session, mounting=mounting))
    result = next(iter(offline_recording_results([(recording, session, ReadingOptions("bow"))])))
    assert result.scan.sensor_pose[0, 2] == pytest.approx(np.radians(130.0))
    view = SceneScan.of(result, MOVING.sensor, mounting.yaw)
    assert view.sensor[2] == pytest.approx(np.radians(40.0))


def track_at(track_id, x, hits=()):
    return ConfirmedTrack(
        track_id=track_id,
        stamp=0.0,
        state=np.array([x, 1.0, 0.0, 0.0]),
        covariance=np.diag([400.0, 1.0, 400.0, 1.0]),
        hits=hits,
        evaluation=0.0,
    )


def view(number, new=(), held=(), restart=False):
    detections = np.array([[number, 0.0], [number, 1.0]])
    tracks = (TrackArrays.from_tracks(list(new)), TrackArrays.from_tracks(list(held)))
    return SceneScan(float(number), detections, None, *tracks, restart=restart)


def test_hits_are_those_of_the_scans_since_the_last_restart():
    scans = [view(1), view(2), view(3, restart=True), view(4, [track_at(7, 0.0, ((0, 1), (1, 0)))])]
    hits = RunScene("run", scans).hits
    assert list(hits) == [7]
    np.testing.assert_array_equal(hits[7], [[3, 3.0, 1.0], [4, 4.0, 0.0]])


def test_a_way_says_where_the_track_was_missed_and_not_held():
    missed = replace(track_at(7, 6.0), time_since_hit=0.1)
    held = [[track_at(7, 5.0)], [missed], [], [track_at(7, 8.0)]]
    scene = RunScene("run", [view(number, held=held[number]) for number in range(4)])
    gap = [np.nan] * 3
    expected = [[5.0, 0.0, 0.0], [6.0, 0.0, 0.1], gap, [8.0, 0.0, 0.0]]
    np.testing.assert_array_equal(scene.ways()[7], expected)


OUTCOMES = {
    ("true", "true"): "2 of 2 targets in 3 pings, no false track",
    ("true",): "1 of 2 targets in 1 pings, no false track",
    (): "0 of 2 targets in 4 pings, no false track",
    ("true", "false", "false"): "1 of 2 targets in 1 pings, 2 false tracks",
    ("true", "misplaced", "redundant"): (
        "1 of 2 targets in 1 pings, no false track, 1 misplaced, 1 redundant"
    ),
}


@pytest.mark.parametrize("outcomes", OUTCOMES, ids=str)
def test_the_headline_has_the_result(outcomes):
    tracks = [track_at(number, 0.0) for number in range(len(outcomes))]
    starts = {0: tracks[:1], 2: tracks[1:]}  # in the first scan, and in the third
    scans = [view(number, starts.get(number, ())) for number in range(4)]
    judged = [
        Judged(track, Outcome(outcome), target, True, 0.0, 0.0, 0.0)
        for target, (track, outcome) in enumerate(zip(tracks, outcomes, strict=True))
    ]
    truth = [np.array([[0.0, 0.0, 0.0], [4.0, 1.0, 1.0]])] * 2
    scene = RunScene("run", scans, truth, judged)
    assert scene_headline(scene) == OUTCOMES[outcomes].replace("1 pings", "1 ping")


def test_the_headline_of_a_recording_counts_tracks():
    scans = [view(1, [track_at(1, 0.0)]), view(2, held=[track_at(1, 1.0)])]
    assert scene_headline(RunScene("run", scans)) == "1 track in 2 pings, 1 held at the end"


POSES = np.array([[10.0, 20.0, 0.5], [30.0, 40.0, 0.7]])


@pytest.mark.parametrize(("offsets", "row"), [([2.0, 1.0], 1), ([1.0, 2.0], 0), (None, 0)])
def test_the_pose_is_that_of_the_nearest_echo(offsets, row):
    scan = Scan(0.0, [100.0, 200.0], [0.0, 0.1], time_offset=offsets, sensor_pose=POSES)
    np.testing.assert_allclose(scene_vessel_pose(scan, 0.2), POSES[row] - [0.0, 0.0, 0.2])


def test_without_a_heading_or_without_detections_a_pose_is_unknown():
    pose = scene_vessel_pose(Scan(0.0, [100.0], [0.0], sensor_pose=POSES[0]), None)
    assert pose[:2].tolist() == [10.0, 20.0] and np.isnan(pose[2])
    assert scene_vessel_pose(Scan(0.0, [], [], sensor_pose=np.zeros((0, 3))), 0.0) is None
