"""What a downstream tracker says, from its arrival to the scan that uses it."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest
from support.sessions import (
    held,
    moving,
    ping,
    play,
    play_empty,
    sail,
    session,
    settings,
)

from tsepm_ros import ConfirmedTrack
from tsepm_ros.session.scan_queue import Arrival
from tsepm_ros.session.session import Session
from tsepm_ros.tracker.maintenance.external_tracker import TrackerReport
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
    assert (held(fourth), fourth.ended) == ([72, 0], {71: "tracker"})
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
    assert one.heard == ["tracked_frame"] * 2


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
    assert one.heard == [f"tracked_{reason}"]
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
    assert (result.arrival, held(result), result.ended) == (Arrival.RESTART, [], {70: "cleared"})
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
    one.reset()
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
        assert (one.figures().tracker, list(one.heard)) == (state, said)
    for stamp in (60, 72):
        tell(one, float(stamp), 70)
        play_empty(one, [stamp])
    assert one.heard == ["tracker_silent", "tracker_back"]
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
