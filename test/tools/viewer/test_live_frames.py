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
"""Frames from live messages."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.pages import confirmed_track

pytest.importorskip("sensor_msgs")

from msg_adapters import (
    PlacedDetections,
    make_header,
    odometry_message,
    placed_detections_cloud,
    track_cloud,
)
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.tools.viewer import live_frames
from tsepm_ros.tools.viewer.live_frames import (
    CLOUDS,
    DETECTIONS,
    FIXED,
    MAX_PENDING,
    NEW,
    POTENTIAL,
    TRACKS,
    LiveFrames,
)


def header(stamp: float, frame_id: str = "odom"):
    return make_header(round(stamp * 1e9), frame_id)


def tracks(stamp: float, *confirmed_tracks, frame_id: str = "odom"):
    return track_cloud(
        header(stamp, frame_id), [track.predicted(stamp) for track in confirmed_tracks]
    )


def detections(stamp: float, *positions, sensor: int | None = None):
    covariance = np.tile(np.eye(2), (len(positions), 1, 1))
    at = np.zeros(len(positions))
    placed = PlacedDetections(np.array(positions), covariance, at, sensor=sensor)
    return placed_detections_cloud(header(stamp), placed)


class Live(LiveFrames):
    def __init__(self) -> None:
        self.errors: list[tuple[str, str]] = []
        super().__init__(lambda topic, error: self.errors.append((topic, error.reason)))

    def frames(self):
        return [frame for frame, _, _ in self.take_frames()]


def test_the_messages_of_a_stamp_are_one_frame():
    live = Live()
    live.take(NEW, tracks(100.0, confirmed_track(2, 10.0, 20.0)))
    live.take(DETECTIONS, detections(100.0, [1.0, 2.0], [3.0, 4.0]))
    live.take(TRACKS, tracks(100.0, confirmed_track(1, 0.0, 0.0), confirmed_track(2, 10.0, 20.0)))
    live.take(POTENTIAL, tracks(100.0, confirmed_track(0, 50.0, 60.0, score=5.0, evaluation=-5.0)))

    ((frame, facts, observed),) = live.take_frames()
    assert observed.stamp == 100.0 and observed.tracks.track_id.tolist() == [1, 2]
    assert (frame["number"], frame["stamp"], frame["frame_id"]) == (1, 100.0, "odom")
    assert frame["detections"] == [100, 200, 300, 400]
    assert [row[0] for row in frame["tracks"]] == [1, 2]
    assert frame["potential"] == [[5000, 6000, 3000, 4000, 50]]
    assert (facts["1"]["confirmed"], facts["2"]["confirmed"]) == (None, 100.0)
    assert facts["2"]["reason"].startswith("3 hits in 4 pings; log-likelihood ratio 10.5")
    assert live.take_frames() == [] and not live.errors


def test_scans_of_several_sensors_at_one_time_are_one_frame_that_tells_them_apart():
    live = Live()
    live.take(DETECTIONS, detections(100.0, [1.0, 2.0], sensor=1))
    live.take(DETECTIONS, detections(100.0, [3.0, 4.0], [5.0, 6.0], sensor=0))
    one, two = (confirmed_track(number, 0.0, 0.0).predicted(100.0) for number in (4, 7))
    for bits in ([1, 2], [3, 2]):
        live.take(TRACKS, track_cloud(header(100.0), [one, two], np.array(bits, np.uint32)))
    (frame,) = live.frames()
    assert frame["detections"] == [100, 200, 300, 400, 500, 600]
    assert (frame["sensors"], frame["seen"]) == ([1, 0, 0], [3, 2])
    live.take(TRACKS, tracks(112.0, confirmed_track(4, 0.0, 0.0)))
    (frame,) = live.frames()
    assert not {"sensors", "seen"} & frame.keys(), "of a single sensor"


def test_a_track_stays_known_while_the_confirmed_tracks_of_a_scan_are_on_their_way():
    live = Live()
    live.take(NEW, tracks(100.0, confirmed_track(1, 0.0, 0.0)))
    live.take(TRACKS, tracks(100.0, confirmed_track(1, 0.0, 0.0)))
    assert live.take_frames()[0][1]["1"]["confirmed"] == 100.0
    live.take(DETECTIONS, detections(112.0, [1.0, 2.0]))
    assert live.take_frames() == [] and live.waits
    live.take(TRACKS, tracks(112.0, confirmed_track(1, 0.0, 0.0)))
    assert live.take_frames()[0][1] == {} and not live.waits


@pytest.mark.parametrize("seed", range(6))
def test_no_frame_is_without_the_tracks_in_whatever_order_the_messages_of_topics_come(seed):
    """Messages of a topic keep their order; a part of a scan may come after parts of the next."""
    live, rng = Live(), np.random.default_rng(seed)
    held = confirmed_track(1, 10.0, 20.0)
    live.take(TRACKS, tracks(99.0, held))
    due = [
        (100.0 + 0.1 * number + rng.uniform(0.0, 0.15), number, topic)
        for number in range(30)
        for topic in (DETECTIONS, NEW, TRACKS)
    ]
    last = dict.fromkeys((DETECTIONS, NEW, TRACKS), 0.0)
    frames = []
    for _, number, topic in sorted(due):
        stamp = 100.0 + 0.1 * number
        if stamp <= last[topic]:  # of one topic in order
            continue
        last[topic] = stamp
        message = detections(stamp, [1.0, 2.0]) if topic == DETECTIONS else tracks(stamp, held)
        live.take(topic, message)
        if rng.random() < 0.5:
            frames += live.frames()
    frames += live.frames()
    assert len(frames) > 15 and not live.errors
    assert all([row[0] for row in frame["tracks"]] == [1] for frame in frames)
    numbers = [frame["number"] for frame in frames]
    assert numbers == sorted(numbers)


def test_a_scan_whose_tracks_do_not_come_is_shown_with_the_last_after_a_while(monkeypatch):
    live = Live()
    live.take(DETECTIONS, detections(88.0, [1.0, 2.0]))
    assert live.frames()[0]["tracks"] == [], "without a source of tracks nothing waits"
    live.take(TRACKS, tracks(100.0, confirmed_track(1, 0.0, 0.0)))
    live.frames()
    live.take(DETECTIONS, detections(112.0, [1.0, 2.0]))
    assert live.frames() == []
    monkeypatch.setattr(live_frames, "TRACKS_WAIT", 0.0)
    (frame,) = live.frames()
    assert (frame["stamp"], [row[0] for row in frame["tracks"]]) == (112.0, [1])
    live.take(TRACKS, tracks(112.0))
    (frame,) = live.frames()
    assert (frame["number"], frame["tracks"]) == (3, [])


def test_what_arrives_after_the_next_scan_is_left_out():
    live = Live()
    live.take(TRACKS, tracks(100.0))
    live.take(TRACKS, tracks(112.0))
    assert [frame["number"] for frame in live.frames()] == [1, 2]
    live.take(DETECTIONS, detections(100.0, [1.0, 2.0]))
    assert live.take_frames() == []


@pytest.mark.parametrize("again", [0.0, 50.0, 100.0])
def test_stamps_that_go_back_are_a_restart(again):
    """Also to stamps that have been before, as of a recording that is played in a loop."""
    live = Live()
    for stamp in (0.0, 50.0, 100.0, 112.0):
        live.take(TRACKS, tracks(stamp, confirmed_track(1, 0.0, 0.0)))
        live.take(FIXED, tracks(stamp, confirmed_track(9, 0.0, 0.0)))
    live.frames()
    live.take(TRACKS, tracks(again, confirmed_track(2, 0.0, 0.0)))
    (frame,) = live.frames()
    assert frame["restart"] and frame["number"] == 5 and frame["fixed"] == []
    live.take(TRACKS, tracks(again + 12.0))
    assert "restart" not in live.frames()[0]


def test_fixed_echoes_stay_until_the_next_message_of_them():
    live = Live()
    live.take(FIXED, tracks(100.0, confirmed_track(9, 5.0, 6.0)))
    live.frames()
    live.take(TRACKS, tracks(112.0))
    assert [row[:3] for row in live.frames()[0]["fixed"]] == [[9, 500, 600]]
    live.take(FIXED, tracks(124.0))
    live.take(TRACKS, tracks(124.0))
    assert live.frames()[0]["fixed"] == []


@pytest.mark.parametrize(("known", "heading"), [(True, 500), (False, None)])
def test_the_own_ship_is_shown_in_its_own_frame_only_with_its_heading_if_known(known, heading):
    live = Live()
    variance = np.diag([1.0, 1.0, 0.01 if known else 1e6])
    pose = PoseSample(100.0, 1.0, 2.0, 0.5, variance, frame_id="odom")
    live.take_own_ship(odometry_message(pose))
    live.take(TRACKS, tracks(100.0))
    live.take(TRACKS, tracks(112.0, frame_id="sonar"))
    first, second = live.frames()
    assert first["own_ship"][:3] == [100, 200, heading]
    assert second["own_ship"] is None


def test_messages_that_cannot_be_read_are_reported_and_the_rest_is_shown():
    live = Live()
    broken = detections(100.0, [1.0, 2.0])
    broken.fields = broken.fields[:2]
    live.take(DETECTIONS, broken)
    live.take(TRACKS, tracks(100.0, confirmed_track(1, 0.0, 0.0)))
    odometry = odometry_message(PoseSample(100.0, 0.0, 0.0, 0.0, None, frame_id="odom"))
    odometry.pose.pose.position.x = math.nan
    live.take_own_ship(odometry)
    (frame,) = live.frames()
    assert len(frame["tracks"]) == 1
    assert live.errors == [("own_ship/odometry", "not_finite"), (DETECTIONS, "missing_field")]


def test_scans_that_nobody_draws_are_bounded():
    live = Live()
    for number in range(1000):
        for topic in CLOUDS:
            live.take(topic, tracks(float(number)))
    frames = live.frames()
    assert len(frames) == MAX_PENDING and frames[-1]["stamp"] == 999.0


def moving(stamp: float, x: float, rates=None):
    pose = PoseSample(stamp, x, 2.0, 0.5, None, frame_id="odom", rates=rates)
    return odometry_message(pose)


def test_own_ship_s_velocity_is_of_its_odometry_if_recent_and_unknown_after_a_restart():
    live = Live()
    live.take_own_ship(moving(100.0, 1.0, (3.0, -1.0, 0.0)))
    live.take(TRACKS, tracks(100.0))
    assert live.frames()[0]["own_ship"][3:] == [3000, -1000, 0]
    live.take(TRACKS, tracks(105.1))
    assert live.frames()[0]["own_ship"][2:] == [500, None, None, 5100], "its age, ms"
    live.take(TRACKS, tracks(1.0))
    live.take_own_ship(moving(1.0, 1.0))
    assert live.frames()[0]["own_ship"][3:] == [None, None, 0]


@pytest.mark.parametrize("interval", [0.1, 1.0, 12.0])
def test_without_a_velocity_that_of_own_ship_is_the_change_of_its_position(interval):
    """However often the pose is read for a scan."""
    live = Live()
    for number in range(12):
        stamp = 100.0 + interval * number
        live.take(TRACKS, tracks(stamp))
        for later in (0.02, 0.04, 0.06):
            live.take_own_ship(moving(stamp + later, 2.0 * (stamp + later)))
        (frame,) = live.frames()
    assert frame["own_ship"][3:5] == [2000, 0]
    assert frame["own_ship"][0] == pytest.approx(200.0 * stamp, abs=1), "at the scan's stamp"


def test_the_alarms_see_a_scan_once_with_own_ship_at_rest_where_the_node_says_so():
    live = Live()
    live.take(TRACKS, tracks(100.0, confirmed_track(1, 0.0, 0.0)))
    assert live.take_frames()[0][2].own_ship is None
    live.take(DETECTIONS, detections(100.0, [1.0, 2.0]))
    assert live.take_frames()[0][2] is None, "the same scan"
    live.source = "none"
    live.take(TRACKS, tracks(112.0, confirmed_track(1, 600.0, 800.0, 0.0, -8.0)))
    ((frame, _, observed),) = live.take_frames()
    assert (observed.own_ship, observed.north) == ((0.0,) * 5, False)
    assert frame["own_ship"] is None and frame["tracks"][0][-3:-1] == [88_000, 60_000]
    live.source = "odometry"
    live.take(TRACKS, tracks(124.0))
    assert live.take_frames()[0][2].north


def test_bearings_of_alarms_are_true_ones_where_north_is_known_and_own_ship_rests():
    live = LiveFrames(lambda *_: None, is_north=True)
    live.source = "none"
    live.take(TRACKS, tracks(100.0))
    assert live.take_frames()[0][2].away(0.0, 500.0) == ", 500 m, 000°T"
