"""The tracker's verb stage by stage on made scans; its ids, refusals and options."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, reconfigured, scan_at

from tsepm_ros import ConfirmedTrack, Scan, SensorModel, make_initiator
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays

HERE = (3000.0, 0.0)


def initiator(**options):
    return make_initiator(
        "tsepm", sensor=FIXED_RANGE_ERROR, **{"min_hits": 3, "window": 4, **options}
    )


def test_what_is_no_scan_is_refused():
    with pytest.raises(ValueError, match=r"scan must be a tsepm_ros\.Scan; got list"):
        initiator().process([1.0, 2.0])


def test_an_initiator_is_shown_in_one_line():
    made = initiator()
    for k in range(3):
        made.process(scan_at(12.0 * k, [HERE]))
    assert repr(made) == "Tracker(Tsepm, 3 scans, 1 tracks confirmed, 1 held)"


def test_track_ids_fit_32_bits():
    made = initiator()
    made.next_track_id = 2**32 - 1
    ids = []
    for k in range(6):
        ids += [track.track_id for track in made.process(scan_at(12.0 * k, [HERE]))]
    assert ids == [2**32 - 1, 0]


def test_ids_in_use_are_passed_over():
    made = initiator()
    confirmed, others = [], [(-3000.0, 0.0), (0.0, 3000.0)]
    for k in range(3):
        if k == 2:  # a downstream tracker has come to use ids that were not given yet
            far = ConfirmedTrack(0, 12.0, np.array([9e3, 0, 9e3, 0]), np.eye(4), (), 0.0)
            used = [replace(far, track_id=track_id) for track_id in (0, 2, 500)]
            made.maintenance.follow(12.0, TrackArrays.of(used))
        confirmed += made.process(scan_at(12.0 * k, [HERE, *others]))
    assert [track.track_id for track in confirmed] == [1, 3, 4]
    assert made.next_track_id == 5
    assert sorted(made.maintenance.held.tracks.track_id) == [0, 1, 2, 3, 4, 500]


def test_a_track_says_when_where_and_from_what():
    made = initiator(window=5)
    for stamp, positions in [(100.0, [HERE]), (112.0, []), (130.0, [(-3000.0, 0.0), HERE])]:
        assert not made.process(scan_at(stamp, positions))
    (track,) = made.process(scan_at(140.0, [(0.0, 3000.0), (3000.0, 10.0)]))
    assert track.hits == ((0, 0), (2, 1), (3, 1))
    assert (track.stamp, track.age, track.scan_count) == (140.0, 40.0, 4)
    assert np.isnan(track.score)
    assert track.covariance.shape == (4, 4)
    np.testing.assert_allclose(track.position, [3000.0, 10.0], atol=5.0)


def test_a_changed_speed_counts_at_the_next_scan():
    made = initiator(max_speed=1.0)
    made.process(scan_at(0.0, [HERE]))
    kept = reconfigured(made, made.sensor, CommonOptions(max_speed=50.0), made.options)
    assert kept
    made.process(scan_at(12.0, [(3000.0, 500.0)]))
    assert made.statistics.started == 0


def test_a_smaller_window_ends_tracks_at_once_and_a_larger_one_keeps_them():
    made = initiator(min_hits=3, window=6)
    for k, seen in enumerate([[HERE], [], []]):
        made.process(scan_at(12.0 * k, seen))
    assert reconfigured(
        made, made.sensor, made.common, dataclasses.replace(made.options, window=20)
    )
    for k in range(3, 9):
        made.process(Scan(12.0 * k, [], []))
    assert made.statistics.potential_tracks == 1
    assert reconfigured(made, made.sensor, made.common, dataclasses.replace(made.options, window=9))
    made.process(scan_at(108.0, [HERE]))
    assert made.statistics.started == 1, "nothing of before is there to gate"


def test_another_number_of_hits_starts_over_and_says_so():
    made = initiator()
    for k in range(2):
        made.process(scan_at(12.0 * k, [HERE]))
    options = dataclasses.replace(made.options, min_hits=2)
    assert not reconfigured(made, made.sensor, made.common, options)
    tracks = [made.process(scan_at(24.0 + 12.0 * k, [HERE])) for k in range(2)]
    assert [len(new) for new in tracks] == [0, 1]


def test_a_figure_of_the_sensor_is_asked_for_where_it_belongs():
    with pytest.raises(ValueError, match=r"clutter_density must be a text.*sensor.clutter_density"):
        make_initiator("score", sensor=SensorModel(), clutter_density=2e-4)
    with pytest.raises(ValueError, match=r"max_range is not an option.*mean sensor.max_range"):
        make_initiator("score", sensor=SensorModel(), max_range=300.0)


def test_a_limit_keeps_the_tightest_tracks():
    initiator = make_initiator(
        "tsepm", sensor=FIXED_RANGE_ERROR, min_hits=2, window=2, max_raw_confirmations=1
    )
    initiator.process(scan_at(0.0, [(2000.0, 0.0)]))
    (track,) = initiator.process(scan_at(12.0, [(2000.0, 90.0), (2000.0, 5.0), (2000.0, -60.0)]))
    assert track.hits == ((0, 0), (1, 1))


def test_new_tracks_beyond_those_that_can_be_held_in_time_are_cut_and_counted():
    made = make_initiator("clutter_test", sensor=SensorModel(), plots="off", clutter_test_size=0.9)
    made.max_scan_time = 1e-9
    rng = np.random.default_rng(1)
    for k in range(5):
        made.process(Scan(12.0 * k, 5000 + rng.uniform(-100, 100, 5), rng.uniform(-0.02, 0.02, 5)))
    assert len(made.current) == made.statistics.confirmed == 10
    assert made.statistics.raw_confirmations == sum(
        getattr(made.statistics, name)
        for name in ("cut_confirmations", "pruned", "merged", "confirmed")
    )
    assert made.statistics.cut_confirmations > 100
