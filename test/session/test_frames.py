"""Frames that are given, that arrive first, and that do not fit."""

import dataclasses

import pytest
from support.sessions import moving, ping, play, sail, session

from tsepm_ros import Scan
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import Mounting, SensorScan
from tsepm_ros.session.drop_reasons import MAX_SENTENCE
from tsepm_ros.session.inputs import MAX_NOTICED, Frames
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings


def test_own_ship_data_that_is_refused_does_not_change_the_mounting():
    one = moving(fixed_frame="odom")
    sail(one, 1.0, 100.0)
    one.add_own_ship(PoseSample(101.0, 0.0, 0.0, 0.0, frame_id="map", child_frame_id="base_link"))
    play(one, [12], now=0.0)
    assert one.heard == ["own_ship_frame"]


def test_a_name_as_long_as_a_message_is_reported_without_its_middle():
    sentences = []
    one = Session(
        Settings(session=SessionOptions(own_ship_source="odometry", fixed_frame="map")),
        report=lambda _, sentence: sentences.append(sentence),
    )
    sail(one, 0.0, frame_id="x" * 65536 + "end")
    (sentence,) = sentences
    assert len(sentence) == MAX_SENTENCE
    assert sentence.startswith("own-ship data is in frame 'xxx")
    assert sentence.endswith("xend', the fixed frame is 'map'")


def test_the_first_own_ship_frame_becomes_the_fixed_frame():
    one = moving()
    sail(one, 0.0, frame_id="odom")
    sail(one, 1.0, frame_id="map")
    assert one.dropped == {"own_ship_frame": 1}


@pytest.mark.parametrize(
    ("options", "first", "good", "bad"),
    [
        ({}, "sonar", "sonar", "radar"),
        ({"sensor_frame": "sonar"}, "radar", "sonar", "radar"),
        ({"fixed_frame": "sonar"}, "radar", "sonar", "radar"),
        (
            {"own_ship_source": "odometry", "fixed_frame": "odom", "own_ship_max_gap": 3600.0},
            "sonar",
            "sonar",
            "odom",
        ),
    ],
)
def test_detections_in_an_unknown_frame_are_dropped(options, first, good, bad):
    one = session(**options)
    if "own_ship_source" in options:
        sail(one, 0.0, 100.0)
    for stamp, frame_id in enumerate([first, good, bad, good]):
        one.add_scan(dataclasses.replace(ping(float(stamp)), frame_id=frame_id), 0.0)
    processed = len(list(one.process()))
    expected = sum(frame_id == good for frame_id in [first, good, bad, good])
    assert processed == expected
    assert one.dropped["unknown_frame"] == 4 - expected


@pytest.mark.parametrize(
    ("options", "frame"),
    [
        pytest.param({}, None, id="nothing given"),
        ({"sensor_frame": "sonar"}, "sonar"),
        ({"fixed_frame": "map"}, "map"),
        ({"own_ship_source": "odometry", "sensor_frame": "sonar"}, "odom"),
        pytest.param({"own_ship_source": "odometry", "fixed_frame": "odom"}, None, id="moves"),
    ],
)
def test_a_scan_that_names_no_frame_needs_one_that_is_given(options, frame):
    one = session(**options)
    if "own_ship_source" in options:
        sail(one, 0.0, 10.0)
    one.add_scan(dataclasses.replace(ping(5.0), frame_id=""), 0.0)
    assert [result.frame_id for result in one.process()] == ([] if frame is None else [frame])
    assert one.dropped == ({"empty_frame": 1} if frame is None else {})


@pytest.mark.parametrize("given", ["", "odom"])
def test_own_ship_data_that_names_no_frame_needs_one_that_is_given(given):
    one = moving(fixed_frame=given)
    sail(one, 0.0, frame_id="")
    assert one.dropped == ({} if given else {"own_ship_empty_frame": 1})
    assert (one.fixed_frame, one.own_ship_stamp) == (given, 0.0 if given else None)


def test_the_frames_that_were_noticed_are_bounded():
    """A source that names another frame with each message neither grows nor repeats for ever."""
    frames = Frames(SessionOptions(own_ship_source="odometry"), moves=True)
    frames.admit(SensorScan(Scan(0.0, [], []), "sonar"), 10)
    noticed = 0
    for number in range(10 * MAX_NOTICED):
        frames.take_pose(
            PoseSample(1.0, 0.0, 0.0, 0.0, frame_id="map", child_frame_id=f"f{number}")
        )
        noticed += len(frames.notices(Mounting()))
        assert frames.notices(Mounting()) == []
        assert len(frames._noticed) <= MAX_NOTICED
    assert noticed == 10 * MAX_NOTICED
