"""A run as the page replays it."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from support.builders import scan_at
from support.sessions import session

from tsepm_ros import Scan
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.replay.offline import recording_results
from tsepm_ros.tools.replay.recording import simulated_recording
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tools.viewer.page_content import RecordedScene
from tsepm_ros.tracker.maintenance.track_maintenance import ENDS

SCENARIO = load_scenario("four_targets")


def recorded(scenario=SCENARIO, seed: int = 1):
    """The page's recording of a run, and the new tracks of the run."""
    recording, _ = simulated_recording(Simulator(scenario, seed))
    options = SessionOptions(method="score", own_ship_source="odometry")
    run = Session(Settings(session=options, sensor=scenario.sensor))
    scene = RecordedScene("four targets", True, recording.truth)
    tracks = []
    for result in recording_results(recording, run, "bow"):
        scene.add(result, run.tracker)
        tracks += result.new
    return json.loads(scene.document(run.dropped)), tracks, run


def test_a_track_that_ends_says_when_and_why():
    run, scene, ended = session(own_ship_source="none", method="score"), RecordedScene("", True), {}
    seen = [SensorScan(scan_at(12.0 * k, [(3000.0, 0.0)]), "sonar") for k in range(16)]
    gone = [SensorScan(Scan(12.0 * k, [], []), "sonar") for k in range(16, 90)]
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
    scene = RecordedScene("twice", False)
    results = []
    for _ in range(2):
        for result in recording_results(recording, run, "bow"):
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
