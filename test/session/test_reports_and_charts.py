"""Reports of a downstream tracker and charts, from their arrival to the scan that uses them."""

import dataclasses
import math

import numpy as np
import pytest
from support.sessions import arrived, held, moving, ping, play, play_empty, sail, session, settings

from tsepm_ros import ConfirmedTrack, LandMask, Scan
from tsepm_ros.session.inputs import TrackerReport
from tsepm_ros.session.session import Session
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays


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


def test_a_report_counts_before_a_scan_that_waited_and_one_older_than_the_last_is_dropped():
    one = moving()
    one.add_scan(ping(10.0), 0.0)
    tell(one, 14.0, 70, frame_id="odom")
    sail(one, 0.0, 20.0)
    (result,) = one.process(0.0)
    assert held(result) == [70]
    assert result.current[0].stamp == 10.0
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
    tracks = TrackArrays.joined(tracked(0.0, 70), tracked(0.0, 71, 72, **values), tracked(0.0, 73))
    one.add_tracked(TrackerReport(0.0, "sonar", tracks))
    assert one.dropped == {f"tracked_{reason}": 2}
    assert one.heard == [f"tracked_{reason}"]
    (result,) = play_empty(one, [0])
    assert held(result) == [70, 73]
    np.testing.assert_array_equal(result.current.state, tracks.where(np.array([0, 3])).state)
    assert np.isfinite(result.current.covariance).all()


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


AHEAD = LandMask(np.ones((10, 10)), 10.0, (2950.0, -50.0, 0.0))
"""Land where `ping` has its target."""
ASTERN = LandMask(np.ones((10, 10)), 10.0, (-2950.0, -50.0, 0.0))


def test_a_chart_in_another_frame_is_refused_also_where_it_came_before_the_frame():
    one = session()
    one.add_land(AHEAD, "sonar")
    play(one, [0])
    for frame in ("map", ""):
        one.add_land(ASTERN, frame)
        (result,) = play(one, [12.0 if frame else 24.0])
        assert result.statistics.on_land == 1
    assert one.dropped["land_frame"] == 2
    assert one.heard == ["land", "land_frame", "land_frame"]
    one = moving()
    one.add_land(AHEAD, "map")
    assert one.dropped == {}
    sail(one, 0.0, 60.0)
    play(one, [0, 12])
    assert one.dropped == {"land_frame": 1}


def test_a_chart_is_of_the_fixed_frame_not_the_sensor_s():
    one = moving()
    sail(one, 0.0, 60.0)
    one.add_land(LandMask([[True]], 20.0, (990.0, 0.0, 0.0)), "odom")
    distance = np.hypot(1000.0, 0.0)
    one.add_scan(arrived(Scan(0.0, [distance], [-0.5])), 0.0)
    (result,) = one.process(0.0)
    assert result.statistics.on_land == 1


def test_a_chart_stays_through_a_reset_for_its_frame_a_restart_and_another_method():
    one = session()
    one.add_land(AHEAD, "sonar")
    play(one, [0])
    one.reset()
    (result,) = play(one, [0])
    assert result.statistics.on_land == 1
    one.reset()
    one.add_scan(arrived(Scan(0.0, [3000.0], [0.0]), "other"), 0.0)
    (result,) = one.process()
    assert result.statistics.on_land == 0
    assert one.dropped == {"land_frame": 1}
    one = session()
    one.add_land(AHEAD, "sonar")
    results = play(one, [1000, 1012, 0, 12])
    assert [result.statistics.on_land for result in results] == [1] * 4
    one.configure(session(method="score").settings)
    (result,) = play(one, [24])
    assert result.statistics.on_land == 1
