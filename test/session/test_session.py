"""From arriving scans and own-ship poses to results: in order, in place, or dropped and counted."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, assert_same_tracks, scan_at

from tsepm_ros import ConfirmedTrack, Scan, SensorModel, make_initiator
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.initiation.statistics import ScanStatistics
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.maintenance.downstream_tracker import TrackerReport
from tsepm_ros.methods.tsepm.tsepm_options import TsepmOptions
from tsepm_ros.own_ship.pose_sample import PoseSample
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.scan_order import Arrival
from tsepm_ros.session.session import Session
from tsepm_ros.settings.session_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.simulation import Simulator, load_scenario

BOX = dataclasses.replace(load_scenario("box"), scans=10)
RULE = TsepmOptions(min_hits=3, window=4)

QUEUE_LENGTH = 32


def settings(common: CommonOptions | None = None, rule: TsepmOptions = RULE, **options) -> Settings:
    return Settings(
        session=SessionOptions(**{"method": "tsepm", **options}),
        sensor=FIXED_RANGE_ERROR,
        common=common or CommonOptions(),
        methods={"tsepm": rule},
    )


class Reports(list):
    """What a session reported."""

    def __call__(self, reason: str, sentence: str) -> None:
        assert sentence
        self.append(reason)


def session(*args, **options) -> Session:
    return Session(settings(*args, **options), Reports())


def moving(**options) -> Session:
    return session(own_ship_source="odometry", **{"own_ship_max_gap": 3600.0, **options})


def arrived(scan: Scan, frame_id: str = "sonar", **more) -> SensorScan:
    return SensorScan(scan, frame_id, **more)


def ping(stamp: float, n: int = 1) -> SensorScan:
    """A target that stands still, and more detections far off."""
    return arrived(
        scan_at(stamp, [(3000.0, 0.0)] + [(-2000.0 - 900 * k, 0.0) for k in range(n - 1)])
    )


def play(one: Session, stamps, now: float = math.inf):
    """Results of scans at the stamps, each processed as it comes."""
    results = []
    for stamp in stamps:
        one.add_scan(ping(float(stamp)), 0.0)
        results += one.process(now)
    return results


def play_empty(one: Session, stamps):
    """The same with scans that have no detections."""
    results = []
    for stamp in stamps:
        one.add_scan(arrived(Scan(float(stamp), [], [])), 0.0)
        results += one.process()
    return results


def sail(one: Session, *stamps: float, frame_id: str = "odom") -> None:
    """Own-ship poses of a ship that runs along x at 2 m/s, at the stamps and every 20 s between."""
    for begin, end in itertools.pairwise([*stamps, stamps[-1]]):
        for stamp in [begin, *np.arange(begin + 20.0, end, 20.0)]:
            one.add_own_ship(PoseSample(float(stamp), 2.0 * stamp, 10.0, 0.5, frame_id=frame_id))


def simulated(seed: int = 1) -> list[Scan]:
    return [simulated.scan for simulated in Simulator(BOX, seed)]


def test_a_session_gives_what_the_initiator_gives():
    chosen = Settings(session=SessionOptions(method="tsepm"), sensor=BOX.sensor)
    one, initiator = Session(chosen), make_initiator("tsepm", sensor=BOX.sensor)
    confirmed = 0
    for scan in simulated():
        one.add_scan(arrived(scan, stamp_ns=17), 0.0)
        (result,) = one.process()
        assert_same_tracks(result.new, initiator.process(scan))
        assert result.statistics == initiator.statistics
        assert (result.stamp, result.stamp_ns) == (scan.stamp, 17)
        assert result.core_seconds > 0
        confirmed += len(result.new)
    assert confirmed > 5
    assert one.dropped == Counter()


def test_without_own_ship_scans_are_processed_at_once_in_the_detections_frame():
    results = play(session(), [0, 12, 24], now=0.0)
    assert [result.frame_id for result in results] == ["sonar"] * 3
    assert [len(result.new) for result in results] == [0, 0, 1]


def test_current_has_every_held_track_at_the_scan_s_stamp():
    one = session(CommonOptions(hold_time=20.0))
    results = play(one, [0, 12, 24]) + play_empty(one, [36, 48])
    (track,) = results[2].new
    assert [[one.track_id for one in result.current] for result in results[2:4]] == [[0], [0]]
    assert results[3].current[0].stamp == 36.0
    assert [result.ended for result in results] == [[], [], [], [], [track.track_id]]
    assert len(results[4].current) == 0


# Scans that must leave no trace: after the third of ten scans.
HARMLESS = {
    "scan_same_stamp": lambda scan: arrived(scan),
    "scan_late": lambda scan: arrived(dataclasses.replace(scan, stamp=scan.stamp - 5.0)),
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
    clean, disturbed = Session(chosen), Session(chosen, Reports())
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
            assert disturbed._report == [reason]
    assert clean.initiator.totals.confirmed > 0


def test_scans_wait_for_the_own_ship_and_are_processed_in_order():
    one = moving()
    sail(one, 0.0)
    for stamp in (3.0, 5.0, 9.0):
        one.add_scan(ping(stamp), 100.0)
    assert list(one.process(100.5)) == []
    assert one.waiting == 3
    sail(one, 4.0)
    assert [result.stamp for result in one.process(100.6)] == [3.0]
    sail(one, 10.0)
    assert [result.stamp for result in one.process(100.7)] == [5.0, 9.0]
    assert one.waiting == 0
    assert one.dropped == Counter()


def test_scans_are_placed_where_the_ship_was_at_their_time():
    one = moving()
    sail(one, 0.0, 100.0)
    one.add_scan(ping(30.0), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [60.0, 10.0, 0.5])
    assert result.frame_id == "odom"


@pytest.mark.parametrize("offset", [None, [1.0, 5.0]], ids=["at once", "echoes"])
def test_scans_with_range_rates_have_the_velocity_of_the_ship_at_their_times(offset):
    one = moving()
    sail(one, 0.0, 100.0)
    rates = {"range_rate": [1.0, -1.0]}
    scan = Scan(30.0, [1500.0, 7500.0], [-0.5, 0.5], time_offset=offset, features=rates)
    one.add_scan(arrived(scan), 0.0)
    (result,) = one.process(0.0)
    expected = [2.0, 0.0] if offset is None else [[2.0, 0.0]] * 2
    np.testing.assert_allclose(result.scan.sensor_velocity, expected, atol=1e-9)


def test_echoes_are_placed_with_the_poses_of_their_sending_and_arrival():
    one = moving()
    sail(one, 0.0, 100.0)
    scan = Scan(30.0, [1500.0, 7500.0], [-0.5, -0.5], time_offset=[1.0, 5.0])
    one.add_scan(arrived(scan), 0.0)
    (result,) = one.process(0.0)
    # Looking along x: half of the way between sending and arrival.
    expected = [[62.0, 10.0, 0.5], [70.0, 10.0, 0.5]]
    np.testing.assert_allclose(result.scan.sensor_pose, expected, atol=1e-9)


def test_a_scan_waits_for_the_pose_of_its_last_echo():
    one = moving()
    needed = []
    one.look_up = lambda *span: needed.append(span)
    one.add_scan(arrived(Scan(30.0, [1500.0, 7500.0], [0.0, 0.0], time_offset=[1.0, 5.0])), 0.0)
    sail(one, 29.0, 39.9)
    assert list(one.process(0.0)) == []
    sail(one, 40.0)
    assert len(list(one.process(0.0))) == 1
    assert needed == [("sonar", 30.0, 40.0, "body")] * 2


def test_a_scan_whose_echoes_are_sent_later_waits_for_and_uses_the_poses_of_then():
    one = moving()
    needed = []
    one.look_up = lambda *span: needed.append(span[1:3])
    scan = Scan(30.0, [100.0, 100.0], [-0.5, -0.5], time_offset=[4.0, 8.0])
    one.add_scan(arrived(scan, transmit_offset=np.array([4.0, 7.0])), 0.0)
    sail(one, 0.0, 100.0)
    (result,) = one.process(0.0)
    assert needed == [(30.0, 39.0)]
    expected = [[68.0, 10.0, 0.5], [76.0, 10.0, 0.5]]
    np.testing.assert_allclose(result.scan.sensor_pose, expected, atol=1e-9)


def test_a_scan_that_cannot_be_placed_costs_itself_and_no_track(monkeypatch):
    one = moving(common=CommonOptions(hold_time=1e6), own_ship_max_gap=60.0)
    sail(one, 0.0, 60.0)
    confirmed = play(one, [0, 12, 24], now=0.0)[2].new

    def fail(*given, **named):
        raise ValueError("sensor_pose must be at most 1e9")

    with monkeypatch.context() as patch:
        patch.setattr("tsepm_ros.own_ship.registration.to_fixed_frame", fail)
        assert play(one, [36], now=0.0) == []
    assert (one.dropped, one.waiting) == ({"internal_error": 1}, 0)
    (result,) = play(one, [48], now=0.0)
    assert held(result) == [track.track_id for track in confirmed]


def test_a_look_up_that_fails_costs_one_scan():
    one = moving()
    sail(one, 0.0, 100.0)

    def fail(*span):
        raise LookupError("no transform")

    one.look_up = fail
    assert play(one, [12], now=0.0) == []
    one.look_up = None
    assert len(play(one, [24], now=0.0)) == 1
    assert one.dropped == {"internal_error": 1}


def test_a_scan_at_which_the_initiator_fails_forgets_the_tracks(monkeypatch):
    one = session()
    (track,) = play(one, [0, 12, 24])[2].new
    with monkeypatch.context() as patch:
        patch.setattr(one.initiator.hold, "add", lambda *_: 1 / 0)
        assert play(one, [36]) == []
    assert one.dropped == {"internal_error": 1}
    results = play(one, [48, 60, 72])
    assert (held(results[0]), results[0].ended) == ([], [track.track_id])
    assert len(results[2].new) == 1


def test_own_ship_data_that_is_refused_does_not_change_the_mounting():
    one = moving(fixed_frame="odom")
    sail(one, 1.0, 100.0)
    one.add_own_ship(PoseSample(101.0, 0.0, 0.0, 0.0, frame_id="map", child_frame_id="base_link"))
    play(one, [12], now=0.0)
    assert one._report == ["own_ship_frame"]


def test_the_pose_covariance_goes_with_the_scan():
    one = moving()
    covariance = np.diag([4.0, 9.0, 0.01])
    for stamp in (0.0, 10.0):
        one.add_own_ship(PoseSample(stamp, 0.0, 0.0, 0.0, covariance, frame_id="odom"))
    one.add_scan(ping(5.0), 0.0)
    one.add_scan(dataclasses.replace(ping(6.0), north_referenced=True), 0.0)
    by_bow, by_north = one.process(0.0)
    np.testing.assert_array_equal(by_bow.scan.sensor_pose_covariance, covariance)
    np.testing.assert_array_equal(by_north.scan.sensor_pose_covariance, np.diag([4.0, 9.0, 0.0]))


def test_north_referenced_scans_do_not_turn_with_the_ship():
    one = moving()
    sail(one, 0.0, 10.0)
    one.add_scan(dataclasses.replace(ping(5.0), north_referenced=True), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [10.0, 10.0, 0.0])


def test_a_ship_without_a_heading_places_only_north_referenced_scans():
    one = moving()
    for stamp in (0.0, 10.0):
        one.add_own_ship(
            PoseSample(stamp, 0.0, 0.0, 0.0, np.diag([1.0, 1.0, 1e6]), frame_id="odom")
        )
    one.add_scan(ping(5.0), 0.0)
    one.add_scan(dataclasses.replace(ping(6.0), north_referenced=True), 0.0)
    assert [result.stamp for result in one.process(0.0)] == [6.0]
    assert one.dropped == {"heading_unknown": 1}


def test_a_scan_whose_own_ship_data_never_comes_is_dropped_after_the_timeout():
    one = moving(own_ship_timeout=2.0)
    one.add_scan(ping(0.0), 50.0)
    assert list(one.process(51.9)) == []
    assert one.dropped == Counter()
    assert list(one.process(52.0)) == []
    assert one.dropped == {"own_ship_missing": 1}
    assert one._report == ["own_ship_missing"]
    assert one.waiting == 0


def test_stale_own_ship_data_drops_the_scan_and_the_next_good_one_is_processed():
    one = moving(own_ship_timeout=2.0, own_ship_max_extrapolation=0.5)
    sail(one, 0.0, 10.0)
    one.add_scan(ping(10.6), 0.0)
    assert list(one.process(2.0)) == []
    assert one.dropped == {"own_ship_stale": 1}
    sail(one, 30.0)
    one.add_scan(ping(22.0), 12.0)
    assert [result.stamp for result in one.process(12.0)] == [22.0]


def test_slightly_stale_own_ship_data_is_extrapolated_after_the_wait():
    one = moving(own_ship_timeout=2.0, own_ship_max_extrapolation=0.5)
    sail(one, 0.0, 10.0)
    one.add_scan(ping(10.5), 0.0)
    assert list(one.process(1.9)) == []
    (result,) = one.process(2.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [21.0, 10.0, 0.5])


def test_a_scan_from_before_the_own_ship_data_is_dropped_at_once():
    one = moving(own_ship_max_extrapolation=0.5)
    sail(one, 10.0, 20.0)
    one.add_scan(ping(9.0), 0.0)
    one.add_scan(ping(12.0), 0.0)
    assert [result.stamp for result in one.process(0.0)] == [12.0]
    assert one.dropped == {"own_ship_stale": 1}


def test_a_hole_of_an_hour_in_the_own_ship_data_is_not_interpolated_across():
    one = moving(own_ship_max_gap=60.0)
    for span in ((0.0, 1.0), (3601.0, 3602.0)):
        sail(one, *span)
    one.add_scan(ping(1800.0), 0.0)
    assert list(one.process()) == []
    assert one.dropped == {"own_ship_stale": 1}


def test_the_queue_of_waiting_scans_is_bounded_and_drops_the_oldest(monkeypatch):
    monkeypatch.setattr("tsepm_ros.session.session.QUEUE_LENGTH", QUEUE_LENGTH)
    one = moving()
    for k in range(QUEUE_LENGTH + 3):
        one.add_scan(ping(float(k)), 0.0)
    assert one.waiting == QUEUE_LENGTH
    assert one.dropped == {"queue_full": 3}
    sail(one, 0.0, 100.0)
    assert [result.stamp for result in one.process(0.0)] == [
        float(k) for k in range(3, QUEUE_LENGTH + 3)
    ]


def test_a_restart_whose_first_scan_gave_way_in_the_queue_is_still_a_restart(monkeypatch):
    monkeypatch.setattr("tsepm_ros.session.session.QUEUE_LENGTH", QUEUE_LENGTH)
    one = moving()
    sail(one, 999.0, 1100.0)
    one.add_scan(ping(1000.0), 0.0)
    assert len(list(one.process(0.0))) == 1
    for k in range(QUEUE_LENGTH + 1):
        one.add_scan(ping(float(k)), 0.0)
    sail(one, 0.0, 100.0)
    assert len(list(one.process(0.0))) == QUEUE_LENGTH


def test_own_ship_data_in_another_frame_is_dropped_and_counted():
    one = moving(fixed_frame="map")
    sail(one, 0.0, frame_id="odom")
    assert one.dropped == {"own_ship_frame": 1}
    assert one.own_ship_stamp is None
    sail(one, 1.0, frame_id="map")
    assert one.own_ship_stamp == 1.0


def test_the_first_own_ship_frame_becomes_the_fixed_frame():
    one = moving()
    sail(one, 0.0, frame_id="odom")
    sail(one, 1.0, frame_id="map")
    assert one.dropped == {"own_ship_frame": 1}


def test_own_ship_data_that_is_not_newer_is_dropped_and_counted():
    one = moving()
    sail(one, 10.0, 10.0, 5.0)
    assert one.dropped == {"own_ship_late": 2}
    assert one.own_ship_stamp == 10.0


def test_own_ship_data_that_jumps_back_starts_a_new_history():
    one = moving(restart_jump=60.0)
    sail(one, 1000.0, 1001.0, 5.0, 7.0)
    one.add_scan(ping(6.0), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [12.0, 10.0, 0.5])


BAD_SAMPLES = {
    "x": {"x": math.nan},
    "y": {"y": math.inf},
    "far": {"x": 1e12},
    "yaw": {"yaw": math.nan},
    "stamp": {"stamp": math.nan},
    "covariance": {"covariance": -np.eye(3)},
    "nan covariance": {"covariance": np.full((3, 3), math.nan)},
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


def test_a_time_offset_before_the_first_pose_drops_the_scan_and_no_other():
    # Scan allows negative time offsets: a driver may stamp the end of listening.
    one = moving()
    sail(one, 10.0, 30.0)
    one.add_scan(arrived(Scan(11.0, [1000.0], [0.0], time_offset=[-3.0])), 0.0)
    one.add_scan(ping(20.0), 0.0)
    assert [result.stamp for result in one.process()] == [20.0]
    assert one.dropped == {"own_ship_stale": 1}


def test_a_negative_time_offset_is_placed_where_poses_are_known():
    one = moving()
    sail(one, 0.0, 30.0)
    scan = Scan(20.0, [1000.0], [-0.5], time_offset=[-3.0])
    one.add_scan(arrived(scan), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [[34.0, 10.0, 0.5]], atol=1e-9)


def test_a_limit_lowered_while_a_scan_waits_drops_it():
    one = moving()
    one.add_scan(ping(5.0, n=4), 0.0)
    sail(one, 0.0, 20.0)
    one.configure(dataclasses.replace(one.settings, common=CommonOptions(max_detections=3)))
    one.add_scan(ping(12.0), 0.0)
    assert [result.stamp for result in one.process(0.0)] == [12.0]
    assert one.dropped == {"too_many_detections": 1}


@pytest.mark.parametrize(
    ("options", "first", "good", "bad"),
    [
        pytest.param({}, "sonar", "sonar", "radar", id="first frame"),
        pytest.param({"sensor_frame": "sonar"}, "radar", "sonar", "radar", id="given frame"),
        pytest.param(
            {"fixed_frame": "sonar"}, "radar", "sonar", "radar", id="fixed frame, not moving"
        ),
        pytest.param(
            {"own_ship_source": "odometry", "fixed_frame": "odom", "own_ship_max_gap": 3600.0},
            "sonar",
            "sonar",
            "odom",
            id="moving",
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
        pytest.param({"sensor_frame": "sonar"}, "sonar", id="sensor"),
        pytest.param({"fixed_frame": "map"}, "map", id="fixed"),
        pytest.param({"own_ship_source": "odometry", "sensor_frame": "sonar"}, "odom", id="moving"),
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


def test_a_restart_resets_the_state_and_is_said_once():
    one = session()
    before = play(one, [1000, 1012, 1024])
    after = play(one, [0, 12, 24])
    assert [result.arrival for result in after] == [Arrival.RESTART, Arrival.NEXT, Arrival.NEXT]
    assert one._report == ["restart"]
    assert after[0].ended == [before[2].new[0].track_id]
    assert len(after[0].current) == 0
    assert [len(result.new) for result in after] == [0, 0, 1]
    assert after[2].new[0].hits == ((0, 0), (1, 0), (2, 0)), "scans count from the restart"
    assert after[2].new[0].track_id == 1, "ids go on"


def test_hits_from_before_a_restart_are_not_used():
    one = session()
    play(one, [1000, 1012])
    assert [len(result.new) for result in play(one, [0, 12])] == [0, 0]


FAR_BACK = [
    pytest.param([0.0], "stamp_not_set", id="not set"),
    pytest.param([0.0, 0.0], "stamp_not_set", id="not set twice"),
    pytest.param([500.0], "scan_far_back", id="far back"),
    pytest.param([500.0, 400.0], "scan_far_back", id="not rising"),
]


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


def test_a_driver_that_never_sets_stamps_is_told_so():
    one = session()
    play(one, [0, 0, 0])
    assert one.dropped == {"stamp_not_set": 2}


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
    assert (list(one.process(last=True)), one.waiting) == ([], 0)
    assert one.dropped == {"scan_far_back": 1}


def test_a_restart_before_the_own_ship_follows_is_still_a_restart():
    one = moving()
    sail(one, 1000.0, 1100.0)
    play(one, [1000, 1012], now=0.0)
    one.add_scan(ping(0.0), 0.0)
    assert list(one.process()) == [], "dropped: no own-ship data of the new run"
    sail(one, 1.0, 50.0)
    results = play(one, [12, 24, 36], now=0.0)
    assert [len(result.new) for result in results] == [0, 0, 1]
    assert one._report.count("restart") == 1


def test_poses_of_the_run_before_a_restart_do_not_place_scans():
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


def test_a_long_gap_drops_potential_tracks_and_keeps_the_held():
    one = session(CommonOptions(hold_time=1e6))
    stamps = [0, 12, 24, 36, 48, 1000, 1012, 1024]
    results = play(one, stamps)
    assert results[5].arrival is Arrival.GAP
    assert one._report == ["gap"]
    assert [len(result.new) for result in results] == [0, 0, 1, 0, 0, 0, 0, 1]
    assert [track.track_id for track in results[5].current] == [0]
    assert results[7].new[0].scan_count == 3


def test_a_gap_before_a_dropped_scan_still_drops_potential_tracks():
    one = moving(max_gap=100.0)
    sail(one, 0.0, 30.0)
    play(one, [0, 12], now=0.0)
    one.add_scan(ping(500.0), 0.0)
    assert list(one.process()) == []
    sail(one, 505.0, 600.0)
    results = play(one, [512, 524, 536], now=0.0)
    assert [len(result.new) for result in results] == [0, 0, 1]


def test_late_and_repeated_scans_are_dropped_by_their_names():
    one = session()
    play(one, [100, 100, 90, 112, 90])
    assert one.dropped == {"scan_same_stamp": 1, "scan_late": 2}
    assert one.initiator.totals.scans == 2


def test_thresholds_changed_between_scans_keep_the_potential_tracks():
    one = session()
    play(one, [0, 12])
    changed = dataclasses.replace(RULE, pruning_probability=0.999)
    assert one.configure(settings(rule=changed))
    (result,) = play(one, [24])
    assert len(result.new) == 1


def test_another_number_of_hits_starts_over():
    one = session()
    play(one, [0, 12])
    assert not one.configure(settings(rule=TsepmOptions(min_hits=2, window=4)))
    assert [len(result.new) for result in play(one, [24, 36])] == [0, 1]


def test_a_shorter_window_ends_the_tracks_that_are_over_it():
    one = session(rule=TsepmOptions(min_hits=3, window=8))
    play(one, [0, 12])
    play_empty(one, [24, 36])
    assert one.configure(settings(rule=TsepmOptions(min_hits=3, window=4)))
    assert [len(result.new) for result in play(one, [48, 60, 72])] == [0, 0, 1]


def test_changed_times_and_limits_count_at_the_next_scan():
    one = session(CommonOptions(hold_time=1000.0))
    play(one, [0, 12, 24])
    one.configure(settings(CommonOptions(hold_time=5.0), restart_jump=10.0, max_gap=20.0))
    (result,) = play_empty(one, [36])
    assert result.ended == [0]
    assert [result.arrival for result in play(one, [57, 40, 41])] == [
        Arrival.GAP,
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
@pytest.mark.parametrize("change", [Session.configure, Session.rehearse])
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
    one.rehearse(
        settings(CommonOptions(hold_time=1.0), TsepmOptions(min_hits=2, window=3), method=method)
    )
    assert [len(result.new) for result in play(one, [24])] == [1]
    (held,) = play_empty(one, [36])
    assert len(held.current) == 1


def test_the_own_ship_source_stays_as_it_is_when_settings_change():
    one = moving()
    sail(one, 0.0, 10.0)
    one.configure(settings())
    one.add_scan(ping(5.0), 0.0)
    (result,) = one.process(0.0)
    np.testing.assert_allclose(result.scan.sensor_pose, [10.0, 10.0, 0.5])


def test_reset_forgets_everything_but_ids():
    one = moving()
    sail(one, 1000.0, 1100.0)
    play(one, [1000, 1012, 1024, 1012], now=0.0)
    one.add_scan(ping(5000.0), 0.0)
    assert one.reset() == [0]
    assert one.dropped == Counter()
    assert (one.waiting, one.own_ship_stamp) == (0, None)
    assert one.initiator.totals.scans == 0
    sail(one, 0.0, 50.0)
    results = play(one, [0, 12, 24], now=0.0)
    assert [result.arrival for result in results] == [Arrival.NEXT] * 3
    assert results[2].new[0].track_id == 1
    assert results[2].ended == []
    assert "restart" not in one._report


def test_counts_of_several_are_added_up():
    one = session()
    one.drop("not_finite", "3 detections", 3)
    one.drop("not_finite", "2 detections", 2)
    assert one.dropped == {"not_finite": 5}
    assert one._report == ["not_finite"] * 2


def test_figures_tell_the_state():
    one = session()
    assert (one.figures().totals.scans, one.figures().scan_stamp) == (0, None)
    play(one, [0, 12, 24])
    figures = one.figures()
    assert (figures.totals.scans, figures.totals.detections, figures.totals.confirmed) == (3, 3, 1)
    assert (figures.waiting, figures.tracks, figures.scan_stamp) == (0, 1, 24.0)
    assert figures.detection_probability == 0.9
    assert figures.detection_probability_estimated == pytest.approx(0.9)
    assert figures.clutter_density == FIXED_RANGE_ERROR.clutter_density
    play(one, [24, 20])
    assert one.figures().dropped == {"scan_late": 1, "scan_same_stamp": 1}


def test_figures_count_on_through_restarts_failures_and_another_method(monkeypatch):
    one = session()
    play(one, [1000, 1012, 1024])
    play(one, [0, 12, 24])
    with monkeypatch.context() as patch:
        patch.setattr(one.initiator.hold, "add", lambda *_: 1 / 0)
        play(one, [36])
    play(one, [48])
    one.configure(settings(method="score"))
    play(one, [60])
    totals = one.figures().totals
    assert (totals.scans, totals.detections, totals.confirmed) == (8, 8, 2)
    one.reset()
    assert one.figures().totals == ScanStatistics()


def test_the_newest_scan_is_not_one_of_before_the_poses_restarted():
    one = moving()
    sail(one, 900.0, 1020.0)
    play(one, [1000, 1012], now=0.0)
    sail(one, 0.0, 12.0)
    assert (one.figures().scan_stamp, one.figures().own_ship_stamp) == (None, 12.0)
    play(one, [5], now=0.0)
    assert one.figures().scan_stamp == 5.0


def test_figures_tell_how_far_own_ship_data_is_behind_the_newest_scan():
    one = moving()
    sail(one, 0.0, 20.0)
    one.add_scan(ping(30.0), 0.0)
    one.add_scan(ping(42.0), 0.0)
    figures = one.figures()
    assert (figures.waiting, figures.scan_stamp, figures.own_ship_stamp) == (2, 42.0, 20.0)


def test_a_result_says_how_long_the_scan_waited():
    one = moving()
    one.add_scan(ping(10.0), (100.0, 7.0))
    assert list(one.process((100.5, 7.5))) == []
    sail(one, 0.0, 20.0)
    (result,) = one.process((101.5, 99.0))
    assert result.waiting == 1.5
    assert play(session(), [0])[0].waiting == math.inf, "no time was given"


@pytest.mark.parametrize("live", [False, True])
def test_the_time_limit_holds_only_live(live):
    one = Session(settings(max_scan_time=3.0), live=live)
    play(one, [0])
    assert one.initiator.max_scan_time == (3.0 if live else math.inf)
    one.configure(settings(max_scan_time=4.0))
    play(one, [12])
    assert one.initiator.max_scan_time == (4.0 if live else math.inf)


def tracked(stamp: float, /, *ids: int, **values) -> TrackArrays:
    """Targets 1 km apart as a downstream tracker knows them; values replace those of each."""
    tracks = [
        ConfirmedTrack(
            track_id=track_id,
            stamp=stamp,
            state=np.array([7000.0, 0.0, 1000.0 * place, 0.0]),
            covariance=np.diag([50.0, 1.0, 50.0, 1.0]) ** 2,
            hits=(),
            evaluation=0.0,
        )
        for place, track_id in enumerate(ids)
    ]
    return TrackArrays.of([dataclasses.replace(track, **values) for track in tracks])


def tell(one: Session, stamp: float, *listed: int, frame_id: str = "sonar") -> None:
    """Give a downstream tracker's report."""
    one.add_tracked(TrackerReport(stamp, frame_id, tracked(stamp, *listed)))


def held(result) -> list[int]:
    return [track.track_id for track in result.current]


def test_the_newest_report_counts_at_the_next_scan():
    one = session()
    tell(one, 0.0, 70, 71)
    tell(one, 1.0, 71, 72)
    first, *_, third = play(one, [2, 14, 26])
    assert held(first) == [71, 72]
    assert held(third) == [71, 72, third.new[0].track_id]
    tell(one, 27.0, 72)
    assert held(third) == [71, 72, 0], "nothing changes before the next scan"
    (fourth,) = play(one, [38])
    assert (held(fourth), fourth.ended) == ([72, 0], [71])
    assert one.dropped == Counter()


def test_a_report_counts_before_the_scan_that_waited_for_own_ship_data():
    one = moving()
    one.add_scan(ping(10.0), 0.0)
    tell(one, 14.0, 70, frame_id="odom")
    sail(one, 0.0, 20.0)
    (result,) = one.process(0.0)
    assert held(result) == [70]
    assert result.current[0].stamp == 10.0


def test_what_is_tracked_in_another_frame_is_dropped_as_soon_as_the_frame_is_known():
    one = session()
    tell(one, 0.0, 70, frame_id="map")
    assert one.dropped == Counter(), "the frame is not known yet"
    (result,) = play(one, [1])
    assert (held(result), one.dropped) == ([], {"tracked_frame": 1})
    tell(one, 2.0, 70)
    tell(one, 3.0, 71, frame_id="map")
    assert one.dropped == {"tracked_frame": 2}
    (result,) = play(one, [4])
    assert held(result) == [70]
    assert one._report == ["tracked_frame"] * 2


def test_a_report_older_than_the_last_is_dropped():
    one = session()
    play(one, [0])
    tell(one, 5.0, 70)
    tell(one, 4.0, 71)
    (result,) = play(one, [6])
    assert (held(result), one.dropped) == ([70], {"tracked_late": 1})


@pytest.mark.parametrize("stamp", [939.0, 1060.5])
def test_a_report_of_another_time_is_dropped_and_the_next_is_used(stamp):
    one = session()
    tell(one, stamp, 70)
    (result,) = play(one, [1000])
    assert (held(result), one.dropped) == ([], {"tracked_stale": 1})
    tell(one, 1001.0, 71)
    (result,) = play(one, [1012])
    assert held(result) == [71]


GOOD_COVARIANCE = np.diag([50.0, 1.0, 50.0, 1.0]) ** 2
BAD_TRACKED = {
    "state": ({"state": np.array([math.nan, 0.0, 0.0, 0.0])}, "not_finite"),
    "far": ({"state": np.array([0.0, 0.0, -1e10, 0.0])}, "not_finite"),
    "stamp": ({"stamp": math.inf}, "not_finite"),
    "infinite": ({"covariance": np.full((4, 4), math.inf)}, "not_finite"),
    "huge": ({"covariance": GOOD_COVARIANCE * 1e300}, "not_finite"),
    "nan": ({"covariance": np.full((4, 4), math.nan)}, "not_finite"),
    "asymmetric": ({"covariance": GOOD_COVARIANCE + 20.0 * np.eye(4, k=1)}, "bad_covariance"),
    "zero": ({"covariance": np.zeros((4, 4))}, "bad_covariance"),
    "negative": ({"covariance": -GOOD_COVARIANCE}, "bad_covariance"),
    "indefinite": ({"covariance": np.eye(4) - 2 * np.eye(4)[::-1]}, "bad_covariance"),
    "singular": ({"covariance": np.full((4, 4), 100.0)}, "bad_covariance"),
    "tiny": ({"covariance": GOOD_COVARIANCE * 1e-300}, "bad_covariance"),
    "duplicate": ({"track_id": 70}, "duplicate_id"),
}


@pytest.mark.parametrize("fault", BAD_TRACKED)
def test_a_bad_tracked_target_is_dropped_and_the_others_are_kept(fault):
    values, reason = BAD_TRACKED[fault]
    one = session()
    tracks = tracked(0.0, 70).joined(tracked(0.0, 71, 72, **values), tracked(0.0, 73))
    one.add_tracked(TrackerReport(0.0, "sonar", tracks))
    assert one.dropped == {f"tracked_{reason}": 2}
    assert one._report == [f"tracked_{reason}"]
    (result,) = play_empty(one, [0])
    assert held(result) == [70, 73]
    np.testing.assert_array_equal(result.current.state, tracks.where(np.array([0, 3])).state)
    assert np.isfinite(result.current.covariance).all()


def test_a_restart_forgets_what_is_tracked():
    one = session()
    tell(one, 1000.0, 70)
    play(one, [1000])
    tell(one, 1001.0, 70, 71)
    result, _ = play_empty(one, [0, 12])
    assert (result.arrival, held(result), result.ended) == (Arrival.RESTART, [], [70])
    assert one.figures().tracker == "none"
    tell(one, 1013.0, 71)  # still of the run before
    (result,) = play_empty(one, [24])
    assert (held(result), one.dropped) == ([], {"tracked_stale": 1})
    tell(one, 25.0, 72)
    (result,) = play_empty(one, [36])
    assert held(result) == [72]


def test_reset_forgets_what_is_tracked_and_its_stamps():
    one = session()
    tell(one, 1000.0, 70)
    play(one, [1000])
    tell(one, 1001.0, 71)
    assert one.reset() == [70]
    (result,) = play(one, [990])
    assert held(result) == []
    tell(one, 991.0, 72)
    (result,) = play(one, [1002])
    assert (held(result), one.dropped) == ([72], Counter())


def test_a_tracker_s_silence_and_its_return_are_said_once_each():
    one = session(CommonOptions(tracked_timeout=30.0))
    assert one.figures().tracker == "none"
    tell(one, 0.0, 70)
    for stamp, state, said in [
        (12, "alive", []),
        (24, "alive", []),
        (36, "silent", ["tracker_silent"]),
        (48, "silent", ["tracker_silent"]),
    ]:
        play_empty(one, [stamp])
        assert (one.figures().tracker, list(one._report)) == (state, said)
    for stamp in (60, 72):
        tell(one, float(stamp), 70)
        play_empty(one, [stamp])
    assert one._report == ["tracker_silent", "tracker_back"]
    assert one.figures().tracker == "alive"


def test_the_tracker_s_timeout_may_change_and_another_method_keeps_what_it_tracks():
    one = session()
    tell(one, 0.0, 70)
    play_empty(one, [0])
    one.configure(settings(CommonOptions(tracked_timeout=20.0), method="score"))
    (result,) = play_empty(one, [12])
    assert (held(result), one.figures().tracker) == ([70], "alive")
    play_empty(one, [24])
    assert one.figures().tracker == "silent"
    one.configure(settings(CommonOptions(tracked_timeout=40.0), method="score"))
    tell(one, 24.0, 70)
    play_empty(one, [60])
    assert one.figures().tracker == "alive"
