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
"""A session: the order of scans, changed options and methods, failures, limits, and imports."""

import dataclasses
import math
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from support.builders import assert_same_tracks
from support.sessions import (
    BOX,
    NotedSession,
    arrived,
    current_ids,
    failing_at,
    moving,
    moving_settings,
    ping,
    play,
    play_empty,
    sail,
    session,
    settings,
    simulated,
)

from tsepm_ros import Scan, SensorModel
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session import inputs
from tsepm_ros.session.inputs import Arrival
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.method import ScanStatistics
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackStatus


@pytest.mark.internal_error
def test_a_scan_at_which_the_initiator_fails_forgets_the_tracks():
    one = NotedSession(failing_at(36.0, settings()))
    (track,) = play(one, [0, 12, 24])[2].new
    assert play(one, [36]) == []
    assert one.dropped == {"internal_error": 1}
    results = play(one, [48, 60, 72])
    assert (current_ids(results[0]), results[0].ended) == ([], {track.track_id: "cleared"})
    assert len(results[2].new) == 1


def test_changed_times_and_limits_count_at_the_next_scan():
    one = session(CommonOptions(hold_time=1000.0))
    play(one, [0, 12, 24])
    one.configure(settings(CommonOptions(hold_time=5.0), restart_jump=10.0, max_gap=20.0))
    (result,) = play_empty(one, [36])
    assert result.ended == {0: "not_detected"}
    assert [result.arrival for result in play(one, [57, 58, 40, 41])] == [
        Arrival.GAP,
        Arrival.NEXT,
        Arrival.RESTART,
        Arrival.NEXT,
    ]


def unusable_settings(**options) -> Settings:
    """Settings that pass all checks, and of which no initiator can be made."""
    sensor = SensorModel()
    object.__setattr__(sensor, "max_range", 0.0)  # as if its bound had been forgotten
    wanted = settings(CommonOptions(hold_time=1.0), TsepmOptions(min_hits=2, window=3), **options)
    return dataclasses.replace(wanted, sensor=sensor)


@pytest.mark.parametrize("method", ["tsepm", "score"])
@pytest.mark.parametrize("change", [Session.configure, Session.validate])
def test_a_change_that_fails_leaves_all_as_it_was(method, change):
    one, other = session(), session()
    play(one, [0, 12])
    play(other, [0, 12])
    before = one.settings
    with pytest.raises(ZeroDivisionError):
        change(one, unusable_settings(method=method, max_gap=5.0, restart_jump=1.0))
    assert one.settings is before
    found, expected = play(one, [24, 36, 22, 48]), play(other, [24, 36, 22, 48])
    assert [len(result.new) for result in expected] == [1, 0, 0]
    for a, b in zip(found, expected, strict=True):
        assert_same_tracks(a.new, b.new)
        assert_same_tracks(a.current, b.current)
        assert (a.arrival, a.ended) == (b.arrival, b.ended)
    assert one.dropped == other.dropped
    assert one.totals == other.totals


@pytest.mark.parametrize("method", ["tsepm", "score"])
def test_a_rehearsal_changes_nothing(method):
    one = session()
    play(one, [0, 12])
    one.validate(
        settings(CommonOptions(hold_time=1.0), TsepmOptions(min_hits=2, window=3), method=method)
    )
    assert [len(result.new) for result in play(one, [24])] == [1]
    (held,) = play_empty(one, [36])
    assert len(held.current) == 1


@pytest.mark.internal_error
def test_figures_count_on_through_restarts_failures_and_another_method():
    one = NotedSession(failing_at(36.0, settings()))
    play(one, [1000, 1012, 1024])
    play(one, [0, 12, 24, 36, 48])
    one.configure(settings(method="score"))
    play(one, [60])
    totals = one.figures().totals
    assert (totals.scans, totals.detections, totals.confirmed) == (8, 8, 2)
    one.reset()
    assert one.figures().totals == ScanStatistics()


@pytest.mark.parametrize("live", [False, True])
def test_the_time_limit_holds_only_live(live):
    one = Session(settings(max_scan_time=3.0), live=live)
    play(one, [0])
    assert one.tracker.max_scan_time == (3.0 if live else math.inf)
    one.configure(settings(max_scan_time=4.0))
    play(one, [12])
    assert one.tracker.max_scan_time == (4.0 if live else math.inf)


def fed(one: Session, scans) -> Session:
    for scan in scans:
        one.add_scan(UnregisteredScan(scan, "sonar"), 0.0)
        list(one.process())
    return one


@pytest.mark.parametrize("used", ["given", "estimated"])
def test_the_reported_area_is_that_to_which_the_density_in_use_refers(used):
    """Clutter within a third of the range: a ninth of the coverage is seen."""
    one, rng = Session(settings(CommonOptions(clutter_density=used))), np.random.default_rng(1)
    sensor = one.tracker.sensor.model
    fed(
        one,
        (
            Scan(
                12.0 * index,
                sensor.max_range / 3.0 * np.sqrt(rng.random(60)),
                rng.uniform(-3.1, 3.1, 60),
            )
            for index in range(10)
        ),
    )
    figures = one.figures()
    share = figures.coverage_area / sensor.coverage_area
    assert share == pytest.approx(1.0 if used == "given" else 1.0 / 9.0, rel=0.1)
    if used == "given":
        assert figures.clutter_density == sensor.clutter_density


@pytest.mark.parametrize(("most", "said"), [(100, False), (5, True)])
def test_hypotheses_that_a_limit_cuts_are_noticed(most, said):
    rng, sentences = np.random.default_rng(1), []
    one = Session(
        settings(CommonOptions(max_potential_tracks=most)),
        lambda reason, sentence: sentences.append(sentence),
    )
    fed(one, [Scan(12.0, rng.uniform(500.0, 5000.0, 20), rng.uniform(-3.0, 3.0, 20))])
    assert ("a limit cut 15 hypotheses at 12.000 s" in sentences) is said


def test_a_notice_says_once_that_amplitudes_count_and_that_they_no_longer_do():
    rng, said = np.random.default_rng(1), []
    one = Session(settings(method="score"), lambda *one: said.append(one))
    found = []
    for index in range(8):
        range_, azimuth = rng.uniform(500.0, 5000.0, 40), rng.uniform(-3.0, 3.0, 40)
        features = {"intensity": rng.exponential(size=40)} if index < 5 else {}
        fed(one, [Scan(12.0 * index, range_, azimuth, features=features)])
        found += [(index, sentence) for subject, sentence in said if subject == "intensity"]
        said.clear()
    assert [index for index, _ in found] == [1, 5]
    assert "used: compared with" in found[0][1] and "no amplitudes" in found[1][1]
    assert one.figures().intensity == "not used: no amplitudes"


HEAVY = "scipy.stats", "scipy.ndimage", "scipy.optimize", "matplotlib", "rclpy"


def test_a_session_with_every_method_imports_no_heavy_module_that_it_does_not_use():
    code = (
        "import sys, tsepm_ros.session.session, tsepm_ros.methods.registry; "
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


QUEUE_LENGTH = 32

# Scans that must leave no trace: after the third of ten scans.
HARMLESS = {
    "scan_same_stamp": lambda scan: arrived(scan),
    "scan_late": lambda scan: arrived(
        dataclasses.replace(scan, stamp=scan.stamp - 5.0, range=scan.range + 1.0)
    ),
    "unknown_frame": lambda scan: arrived(dataclasses.replace(scan, stamp=scan.stamp + 5.0), "x"),
    "too_many_detections": lambda scan: arrived(
        Scan(scan.stamp + 5.0, np.full(5001, 100.0), np.zeros(5001))
    ),
}


@pytest.mark.parametrize("reason", HARMLESS)
def test_a_bad_scan_in_between_leaves_the_others_as_they_were(reason):
    chosen = Settings(
        session=SessionOptions(method="tsepm"),
        sensor=BOX.sensor,
        common=CommonOptions(max_detections=5000),
    )
    clean, disturbed = Session(chosen), NotedSession(chosen)
    for index, scan in enumerate(simulated()):
        clean.add_scan(arrived(scan), 0.0)
        disturbed.add_scan(arrived(scan), 0.0)
        (expected,), (found,) = clean.process(), disturbed.process()
        assert_same_tracks(found.new, expected.new)
        assert_same_tracks(found.current, expected.current)
        assert found.statistics == expected.statistics
        assert found.arrival is Arrival.NEXT
        if index == 2:
            disturbed.add_scan(HARMLESS[reason](scan), 0.0)
            assert list(disturbed.process()) == []
            assert disturbed.dropped == {reason: 1}
            assert disturbed.heard == [reason]
    assert clean.tracker.totals.confirmed > 0


def test_the_queue_of_waiting_scans_is_bounded_also_over_a_restart(monkeypatch):
    monkeypatch.setattr(inputs, "QUEUE_LENGTH", QUEUE_LENGTH)
    one = NotedSession(moving_settings())
    for k in range(QUEUE_LENGTH + 3):
        one.add_scan(ping(float(k)), 0.0)
    assert one.figures().waiting == QUEUE_LENGTH
    assert one.dropped == {"queue_full": 3}
    sail(one, 0.0, 100.0)
    assert [result.stamp for result in one.process(0.0)] == [
        float(k) for k in range(3, QUEUE_LENGTH + 3)
    ]
    one = NotedSession(moving_settings())
    sail(one, 999.0, 1100.0)
    one.add_scan(ping(1000.0), 0.0)
    assert len(list(one.process(0.0))) == 1
    for k in range(QUEUE_LENGTH + 1):
        one.add_scan(ping(float(k)), 0.0)
    sail(one, 0.0, 100.0)
    assert len(list(one.process(0.0))) == QUEUE_LENGTH


def test_a_limit_lowered_while_a_scan_waits_drops_it():
    one = moving()
    one.add_scan(ping(5.0, n=4), 0.0)
    sail(one, 0.0, 20.0)
    one.configure(dataclasses.replace(one.settings, common=CommonOptions(max_detections=3)))
    one.add_scan(ping(12.0), 0.0)
    assert [result.stamp for result in one.process(0.0)] == [12.0]
    assert one.dropped == {"too_many_detections": 1}


def test_a_restart_resets_the_state_and_is_said_once():
    one = session()
    before = play(one, [1000, 1012, 1024])
    after = play(one, [0, 12, 24])
    assert [result.arrival for result in after] == [Arrival.RESTART, Arrival.NEXT, Arrival.NEXT]
    assert one.heard == ["restart"]
    assert after[0].ended == {before[2].new[0].track_id: "cleared"}
    assert len(after[0].current) == 0
    assert [len(result.new) for result in after] == [0, 0, 1]
    assert after[2].new[0].hits == ((0, 0), (1, 0), (2, 0)), "scans count from the restart"
    assert after[2].new[0].track_id == 1, "ids go on"


FAR_BACK = [
    pytest.param([0.0], "stamp_not_set", id="not set"),
    pytest.param([0.0, 0.0], "stamp_not_set", id="not set twice"),
    pytest.param([500.0], "scan_far_back", id="far back"),
    pytest.param([500.0, 400.0], "scan_far_back", id="not rising"),
]


def of_buoy(period: float, number: int, wrong=lambda k: 0.0):
    """Scans with their times, s, of which some have wrong stamps."""
    for k in range(number):
        time = 1000.0 + k * period
        yield time, ping(time + wrong(k))


def heard_by(one: Session, scans, live: bool) -> list:
    """Results of scans that arrive 0.2 s after their times, live or of a recording."""
    results = []
    for time, scan in scans:
        now = time + 0.2
        one.add_scan(scan, (now, now) if live else -math.inf)
        results += one.process((now, now)) if live else one.process()
    return results + list(one.process(last=True))


@pytest.mark.parametrize("live", [True, False])
@pytest.mark.parametrize("ahead", [1.0, 30.0, 1e6])
@pytest.mark.parametrize("period", [0.1, 12.0])
def test_a_single_stamp_ahead_costs_at_most_its_scan(period, ahead, live):
    one = session(method="score")
    results = heard_by(one, of_buoy(period, 30, lambda k: ahead * (k == 15)), live)
    late = ahead < 0.5 * period  # at 12 s, 1 s is no fault
    assert one.dropped == ({} if late else {"scan_ahead": 1})
    assert len(results) == 30 - (not late) and one.heard == ["scan_ahead"] * (not late)
    assert [current_ids(result) for result in results[14:]] == [[0]] * (len(results) - 14)


@pytest.mark.parametrize("live", [True, False])
@pytest.mark.parametrize(("step", "lost"), [(1.0, 0), (30.0, 0), (-1.0, 2), (-100.0, 0)])
def test_a_clock_that_was_set_is_followed(step, lost, live):
    one = session(method="score")
    results = heard_by(one, of_buoy(0.1, 30, lambda k: step * (k >= 15)), live)
    assert (len(results), one.dropped.total()) == (30 - lost, lost)
    assert len(results[-1].current) == 1
    assert one.heard.count("restart") == (step < 0.0)


def test_after_a_pause_no_scan_waits_for_the_next():
    """Live, the time of arrival tells the pause from a wrong stamp."""
    one = session()
    pause = 1132.0, ping(1132.0)
    for time, scan in [*of_buoy(12.0, 6), pause]:
        one.add_scan(scan, (time + 0.2, time + 0.2))
        assert [result.stamp for result in one.process((time + 0.2, time + 0.2))] == [time]


@pytest.mark.parametrize(("stamps", "reason"), FAR_BACK)
@pytest.mark.parametrize("source", ["none", "odometry"])
def test_stamps_far_back_that_none_follows_cost_only_themselves(source, stamps, reason):
    one = session(own_ship_source=source, own_ship_max_gap=3600.0)
    if source == "odometry":
        sail(one, 900.0, 2000.0)
    results = play(one, [1000, 1012, *stamps, 1024, 1036], now=0.0)
    assert [result.arrival for result in results] == [Arrival.NEXT] * 4
    assert [len(result.new) for result in results] == [0, 0, 1, 0]
    assert one.dropped == {reason: len(stamps)}


def test_of_a_restart_that_is_confirmed_nothing_is_lost_and_the_wait_is_not_counted():
    one = session()
    play(one, [1000])
    one.add_scan(ping(0.0), 10.0)
    assert list(one.process(20.0)) == []
    one.add_scan(ping(12.0), 22.0)
    results = list(one.process(22.5))
    assert [(one.stamp, one.waiting) for one in results] == [(0.0, 0.5), (12.0, 0.5)]
    assert one.dropped == Counter()


def test_the_last_scan_of_all_if_far_back_is_dropped_and_counted():
    one = session()
    play(one, [1000, 5])
    assert (list(one.process(last=True)), one.figures().waiting) == ([], 0)
    assert one.dropped == {"scan_far_back": 1}


def test_a_gap_drops_potential_tracks_and_keeps_the_held_also_before_a_dropped_scan():
    one = session(CommonOptions(hold_time=1e6))
    stamps = [0, 12, 24, 36, 48, 1000, 1012, 1024]
    results = play(one, stamps)
    assert results[5].arrival is Arrival.GAP
    assert one.heard == ["gap"]
    assert [len(result.new) for result in results] == [0, 0, 1, 0, 0, 0, 0, 1]
    # Its place is not known well enough after the gap, and then it is again.
    published = [[(track.track_id, track.status) for track in r.current] for r in results]
    sure, coasts = [(0, TrackStatus.CONFIRMED)], [(0, TrackStatus.COASTING)]
    assert published[4:7] == [sure, coasts, sure]
    assert results[7].new[0].scan_count == 3
    one = moving(max_gap=100.0)
    sail(one, 0.0, 30.0)
    play(one, [0, 12], now=0.0)
    one.add_scan(ping(500.0), 0.0)
    assert list(one.process()) == []
    sail(one, 505.0, 600.0)
    results = play(one, [512, 524, 536], now=0.0)
    assert [len(result.new) for result in results] == [0, 0, 1]


BAD_SAMPLES = {
    "x": {"x": math.nan},
    "y": {"y": math.inf},
    "far": {"x": 1e12},
    "yaw": {"yaw": math.nan},
    "roll": {"roll": math.nan},
    "pitch": {"pitch": math.nan},
    "stamp": {"stamp": math.nan},
    "fast": {"rates": (2e6, 0.0, 0.0)},
    "infinitely fast": {"rates": (0.0, -math.inf, 0.0)},
    "turns fast": {"rates": (0.0, 0.0, 1e7)},
    "covariance": {"covariance": -np.eye(3)},
    "nan covariance": {"covariance": np.full((3, 3), math.nan)},
    "shape of the covariance": {"covariance": np.eye(2)},
}


@pytest.mark.parametrize("fault", BAD_SAMPLES)
def test_a_bad_own_ship_sample_is_dropped_and_the_others_are_used(fault):
    one = moving()
    sail(one, 0.0)
    bad = dataclasses.replace(
        PoseSample(4.0, 8.0, 10.0, 0.5, frame_id="odom"), **BAD_SAMPLES[fault]
    )
    one.add_own_ship(bad)
    sail(one, 10.0)
    one.add_scan(ping(4.5), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [9.0, 10.0, 0.5])
    assert one.dropped == {"own_ship_invalid": 1}


def test_own_ship_delay_shifts_the_stamps_of_own_ship():
    places = []
    for delay, late in ((0.0, 0.0), (0.3, 0.3), (0.0, 0.3)):
        delayed = moving(own_ship_delay=delay)
        for time in np.arange(0.0, 3.0, 0.1):
            sample = PoseSample(time + late, 5.0 * time, 0.0, 0.1 * time)
            delayed.add_own_ship(
                dataclasses.replace(sample, frame_id="odom", child_frame_id="sonar")
            )
        (result,) = play(delayed, [1.0])
        places.append(result.scan.sensor_pose)
    np.testing.assert_allclose(places[1], places[0], atol=1e-9)
    assert not np.allclose(places[2], places[0])
