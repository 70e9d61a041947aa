"""Own-ship data of a session: awaited, late, missing and begun anew, and frames that do not fit."""

import dataclasses
import math
from collections import Counter, deque

import numpy as np
import pytest
from support.sessions import arrived, held, moving, ping, play, sail, session, settings

from tsepm_ros import Scan
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import Mounting, SensorScan
from tsepm_ros.session.drop_reasons import MAX_SENTENCE
from tsepm_ros.session.inputs import MAX_NOTICED, Frames
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.options import CommonOptions


def test_a_scan_whose_echoes_are_sent_later_waits_for_and_uses_the_poses_of_then():
    one = moving()
    needed = []
    one.own_ship.look_up = lambda *span: needed.append(span[1:3])
    scan = Scan(30.0, [100.0, 100.0], [-0.5, -0.5], time_offset=[4.0, 8.0])
    one.add_scan(arrived(scan, transmit_offset=np.array([4.0, 7.0])), 0.0)
    sail(one, 0.0, 100.0)
    (result,) = one.process(0.0)
    assert needed == [(30.0, 39.0)]
    expected = [[68.0, 10.0, 0.5], [76.0, 10.0, 0.5]]
    np.testing.assert_allclose(result.scan.sensor_pose, expected, atol=1e-9)


@pytest.mark.internal_error
def test_a_look_up_that_fails_costs_one_scan():
    one = moving()
    sail(one, 0.0, 100.0)

    def fail(*span):
        raise LookupError("no transform")

    one.own_ship.look_up = fail
    assert play(one, [12], now=0.0) == []
    one.own_ship.look_up = None
    assert len(play(one, [24], now=0.0)) == 1
    assert one.dropped == {"internal_error": 1}


def test_a_scan_whose_own_ship_data_never_comes_is_dropped_after_the_timeout():
    one = moving(own_ship_timeout=2.0)
    one.add_scan(ping(0.0), 50.0)
    assert list(one.process(51.9)) == []
    assert one.dropped == Counter()
    assert list(one.process(52.0)) == []
    assert one.dropped == {"own_ship_missing": 1}
    assert one.heard == ["own_ship_missing"]
    assert one.figures().waiting == 0


def reader(one, *stamps):
    """Reads poses one by one, as a node does messages of odometry that wait."""
    unread = deque(stamps)

    def read() -> bool:
        if unread:
            sail(one, unread.popleft())
            return True
        return False

    one.own_ship.read_unread = read
    return unread


def test_own_ship_data_is_not_read_out_of_turn_for_a_scan_that_may_wait_or_is_covered():
    one = moving(own_ship_timeout=2.0)
    unread = reader(one, 4.0, -900.0)
    sail(one, 0.0, 2.0)
    one.add_scan(ping(3.0), 50.0)
    assert list(one.process(51.0)) == []
    sail(one, 4.0)
    assert [result.stamp for result in one.process(53.0)] == [3.0]
    assert len(unread) == 2


def test_a_scan_before_a_restart_is_not_placed_by_unread_own_ship_data_after_it():
    one = moving(own_ship_timeout=2.0)
    sail(one, 0.0, 69.0)
    one.add_scan(ping(69.5), 50.0)
    unread = reader(one, *np.arange(0.0, 80.0))
    assert list(one.process(60.0)) == []
    assert one.dropped == {"own_ship_stale": 1}
    while unread:
        one.own_ship.read_unread()
    for stamp in (4.0, 16.0, 28.0):
        one.add_scan(ping(stamp), 61.0)
    assert [result.stamp for result in one.process(61.0)] == [4.0, 16.0, 28.0]


def test_own_ship_data_is_extrapolated_after_the_wait_but_not_far_and_the_next_scan_is_processed():
    one = moving(own_ship_timeout=2.0, own_ship_max_extrapolation=0.5)
    sail(one, 0.0, 10.0)
    one.add_scan(ping(10.5), 0.0)
    assert list(one.process(1.9)) == []
    (result,) = one.process(2.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [21.0, 10.0, 0.5])
    one.add_scan(ping(10.6), 2.0)
    assert list(one.process(4.0)) == []
    assert one.dropped == {"own_ship_stale": 1}
    sail(one, 30.0)
    one.add_scan(ping(22.0), 14.0)
    assert [result.stamp for result in one.process(14.0)] == [22.0]


@pytest.mark.parametrize(
    ("options", "spans", "stamps", "used"),
    [
        ({"own_ship_max_extrapolation": 0.5}, [(10.0, 20.0)], [9.0, 12.0], [12.0]),
        ({"own_ship_max_gap": 60.0}, [(0.0, 1.0), (3601.0, 3602.0)], [1800.0], []),
    ],
    ids=["before the data", "in a hole of an hour"],
)
def test_a_scan_that_own_ship_data_will_never_cover_is_dropped_at_once(
    options, spans, stamps, used
):
    one = moving(**options)
    for span in spans:
        sail(one, *span)
    for stamp in stamps:
        one.add_scan(ping(stamp), 0.0)
    assert [result.stamp for result in one.process(0.0)] == used
    assert one.dropped == {"own_ship_stale": 1}


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


def test_a_pose_carried_off_the_earth_costs_its_ping_under_a_name():
    one = moving(own_ship_max_extrapolation=0.5)
    at_the_end = PoseSample(0.0, 1e9 - 1000.0, 0.0, 0.0, rates=(1e6, 0.0, 0.0), frame_id="odom")
    one.add_own_ship(at_the_end)
    assert play(one, [0.4]) == []
    sail(one, 40.0, 60.0)
    assert [result.stamp for result in play(one, [50])] == [50.0]
    assert one.dropped == {"own_ship_jump": 1}


def test_a_restart_before_the_own_ship_follows_is_one_and_poses_before_it_place_no_scans():
    one = moving()
    sail(one, 1000.0, 1100.0)
    play(one, [1000, 1012], now=0.0)
    one.add_scan(ping(0.0), 0.0)
    assert list(one.process()) == [], "dropped: no own-ship data of the new run"
    sail(one, 1.0, 50.0)
    results = play(one, [12, 24, 36], now=0.0)
    assert [len(result.new) for result in results] == [0, 0, 1]
    assert one.heard.count("restart") == 1
    one = moving()
    for stamp in range(0, 1100, 20):
        one.add_own_ship(PoseSample(float(stamp), 5e5, 5e5, 0.0, frame_id="odom"))
    play(one, [1000], now=0.0)
    one.add_scan(ping(50.0), 0.0)
    one.add_scan(ping(62.0), 0.0)
    assert list(one.process(0.0)) == []
    sail(one, 0.0, 100.0)
    result, _ = one.process(0.1)
    np.testing.assert_allclose(result.scan.sensor_pose, [100.0, 10.0, 0.5])


def test_the_own_ship_source_stays_as_it_is_when_settings_change():
    one = moving()
    sail(one, 0.0, 10.0)
    one.configure(settings())
    one.add_scan(ping(5.0), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [10.0, 10.0, 0.5])


def test_the_newest_scan_and_own_ship_stamps_are_told_also_after_a_restart_of_poses():
    one = moving()
    sail(one, 900.0, 1020.0)
    play(one, [1000, 1012], now=0.0)
    sail(one, 0.0, 12.0)
    assert (one.figures().scan_stamp, one.figures().own_ship_stamp) == (None, 12.0)
    play(one, [5], now=0.0)
    assert one.figures().scan_stamp == 5.0
    one = moving()
    sail(one, 0.0, 20.0)
    one.add_scan(ping(30.0), 0.0)
    one.add_scan(ping(42.0), 0.0)
    figures = one.figures()
    assert (figures.waiting, figures.scan_stamp, figures.own_ship_stamp) == (2, 42.0, 20.0)


def test_a_scan_that_cannot_be_placed_costs_itself_and_no_track():
    one = moving(common=CommonOptions(hold_time=1e6), own_ship_max_extrapolation=12.0)
    sail(one, 0.0, 30.0)
    confirmed = play(one, [0, 12, 24])[2].new
    # At the edge of what is taken, and beyond it where the newest velocity carries it.
    for stamp in (31.0, 32.0):
        one.add_own_ship(PoseSample(stamp, 1e9, 0.0, 0.0, rates=(10.0, 0.0, 0.0), frame_id="odom"))
    assert play(one, [36]) == []
    assert (one.dropped, one.figures().waiting) == ({"own_ship_jump": 1}, 0)
    sail(one, 40.0, 60.0)
    (result,) = play(one, [48])
    assert held(result) == [track.track_id for track in confirmed]


def test_a_negative_time_offset_is_placed_where_poses_are_known():
    one = moving()
    sail(one, 0.0, 30.0)
    scan = Scan(20.0, [1000.0], [-0.5], time_offset=[-3.0])
    one.add_scan(arrived(scan), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [[34.0, 10.0, 0.5]], atol=1e-9)


def test_frames_of_own_ship_data_that_do_not_fit_are_refused_and_change_nothing():
    one = moving(fixed_frame="odom")
    sail(one, 1.0, 100.0)
    one.add_own_ship(PoseSample(101.0, 0.0, 0.0, 0.0, frame_id="map", child_frame_id="base_link"))
    play(one, [12], now=0.0)
    assert one.heard == ["own_ship_frame"]
    one = moving()
    sail(one, 0.0, frame_id="odom")
    sail(one, 1.0, frame_id="map")
    assert one.dropped == {"own_ship_frame": 1}


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


@pytest.mark.parametrize(
    ("options", "first", "bad"),
    [
        ({}, "sonar", "radar"),
        ({"sensor_frame": "sonar"}, "radar", "radar"),
        ({"fixed_frame": "sonar"}, "radar", "radar"),
        ({"own_ship_source": "odometry", "fixed_frame": "odom"}, "sonar", "odom"),
    ],
)
def test_detections_in_an_unknown_frame_are_dropped(options, first, bad):
    one = session(own_ship_max_gap=3600.0, **options)
    if "own_ship_source" in options:
        sail(one, 0.0, 100.0)
    frames = [first, "sonar", bad, "sonar"]
    for stamp, frame_id in enumerate(frames):
        one.add_scan(dataclasses.replace(ping(float(stamp)), frame_id=frame_id), 0.0)
    assert len(list(one.process())) == frames.count("sonar")
    assert one.dropped["unknown_frame"] == 4 - frames.count("sonar")


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
    assert (one.fixed_frame, one.own_ship.poses.last_stamp) == (given, 0.0 if given else None)


def test_the_frames_that_were_noticed_are_bounded():
    """A source that names another frame with each message neither grows nor repeats for ever."""
    frames = Frames(SessionOptions(own_ship_source="odometry"))
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
