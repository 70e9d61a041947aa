"""What every initiator keeps to: options, ids, refusals, limits; that it stays alive."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, reconfigured, scan_at

from tsepm_ros import ConfirmedTrack, Scan, SensorModel, available_methods, make_initiator
from tsepm_ros.numerics.arrays import keep_best
from tsepm_ros.tracker.maintenance.track_maintenance import best_held
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays

HERE = (3000.0, 0.0)


def initiator(**options):
    return make_initiator(
        "tsepm", sensor=FIXED_RANGE_ERROR, **{"min_hits": 3, "window": 4, **options}
    )


def test_an_unknown_method_is_refused_and_the_known_are_named():
    with pytest.raises(ValueError, match=r"^method must be one of tsepm.*got 'kalman'"):
        make_initiator("kalman", sensor=SensorModel())


def test_an_option_that_the_method_does_not_have_is_refused_by_name():
    with pytest.raises(ValueError, match=r"^colour is not an option of method 'tsepm'.*min_hits"):
        make_initiator("tsepm", sensor=SensorModel(), colour="red", min_hits=4)


def test_what_is_no_scan_is_refused():
    with pytest.raises(ValueError, match=r"scan must be a tsepm_ros\.Scan; got list"):
        initiator().process([1.0, 2.0])


@pytest.mark.parametrize("sensor", [None, {"range_std": 1.0}, SensorModel], ids=str)
def test_a_wrong_sensor_is_refused_by_name(sensor):
    with pytest.raises(TypeError, match="sensor must be a SensorModel"):
        make_initiator("tsepm", sensor=sensor)


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


@pytest.mark.parametrize("limit", [1, 3, 50, 199, 200, 1000])
@pytest.mark.parametrize("values", [3, 10_000], ids=["many ties", "few ties"])
def test_keep_best_keeps_the_smallest_and_of_ties_the_first(limit, values):
    cost = np.random.default_rng(limit).integers(0, values, 200).astype(float)
    expected = np.sort(np.argsort(cost, kind="stable")[:limit])
    assert keep_best(cost, limit).tolist() == expected.tolist()


def test_a_limit_keeps_the_tightest_tracks():
    initiator = make_initiator(
        "tsepm", sensor=FIXED_RANGE_ERROR, min_hits=2, window=2, max_potential_tracks=1
    )
    initiator.process(scan_at(0.0, [(2000.0, 0.0)]))
    (track,) = initiator.process(scan_at(12.0, [(2000.0, 90.0), (2000.0, 5.0), (2000.0, -60.0)]))
    assert track.hits == ((0, 0), (1, 1))


def test_a_hundred_thousand_detections_in_one_scan_do_not_end_anything():
    # The scan's 100 000 potential tracks gate everything until their window ends; a target that
    # appears after that is found as if the scan had not been, and nothing is left of it.
    rng = np.random.default_rng(1)
    n = 100_000
    initiator = make_initiator("tsepm", sensor=SensorModel())
    initiator.process(
        Scan(0.0, 9000 * np.sqrt(rng.uniform(1e-6, 1, n)), rng.uniform(-math.pi, math.pi, n))
    )
    assert initiator.statistics.potential_tracks == n
    for k in range(1, 9):
        initiator.process(
            scan_at(12.0 * k, [rng.uniform(-6000, 6000, 2), (1000.0 + 50.0 * k, 3000.0)])
        )
        assert initiator.statistics.potential_tracks <= 250_000
    late = [initiator.process(scan_at(12.0 * k, [(-4000.0, 60.0 * k)])) for k in range(9, 18)]
    assert sum(map(len, late)) >= 1
    track = next(new[0] for new in late if new)
    np.testing.assert_allclose(track.position, (-4000.0, 5.0 * track.stamp), rtol=1e-3)
    assert initiator.statistics.potential_tracks < 100


def cluster(scans: int, number: int, scan_time: float = math.inf):
    """So many detections in a cluster in each scan: number^5 raw confirmations in the fifth."""
    rng = np.random.default_rng(1)
    initiator = make_initiator("tsepm", sensor=SensorModel())
    initiator.max_scan_time = scan_time
    for k in range(scans):
        range_, azimuth = rng.uniform(-100, 100, number), rng.uniform(-0.02, 0.02, number)
        tracks = initiator.process(Scan(12.0 * k, 5000 + range_, azimuth))
    return initiator, tracks


@pytest.mark.timeout(60)
def test_a_small_cluster_of_detections_in_every_scan_is_processed_in_time():
    # A wreck or a jetty: 1e5 raw confirmations, all of which merge; every pair takes minutes.
    initiator, _ = cluster(6, 10)
    assert initiator.totals.confirmed >= 1


def test_a_time_limit_cuts_what_it_must_counts_it_and_the_output_is_valid():
    initiator, tracks = cluster(5, 12, 0.05)
    statistics = initiator.statistics
    assert tracks
    assert statistics.raw_confirmations == 0.25 * 0.05 * 100_000
    assert statistics.raw_confirmations + statistics.cut_confirmations == 12**5
    assert statistics.raw_confirmations == sum(
        (statistics.pruned, statistics.merged, statistics.confirmed)
    )
    for track in tracks:
        assert np.linalg.eigvalsh(track.covariance).min() > 0
        assert [scan for scan, _ in track.hits] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("method", [name for name in available_methods() if name != "hough"])
def test_where_the_time_is_over_only_part_of_the_pairs_in_one_place_is_looked_at(method):
    # A thousand detections twice: a million pairs, of which none may be left out in silence.
    n = 1000
    initiator = make_initiator(method, sensor=SensorModel(), plots="off")
    initiator.max_scan_time = 1e-9
    for k in range(2):
        initiator.process(Scan(12.0 * k, np.full(n, 1000.0), np.zeros(n)))
    assert initiator.statistics.cut_potential_tracks >= n * n - 500_000
    assert initiator.statistics.potential_tracks <= 500_000


def test_new_tracks_beyond_those_that_can_be_held_in_time_are_cut_and_counted():
    made = make_initiator("clutter_test", sensor=SensorModel(), plots="off", clutter_test_size=0.9)
    made.max_scan_time = 0.004
    rng = np.random.default_rng(1)
    for k in range(5):
        made.process(Scan(12.0 * k, 5000 + rng.uniform(-100, 100, 5), rng.uniform(-0.02, 0.02, 5)))
    assert len(made.current) == made.statistics.confirmed == 0.05 * 0.004 * 100_000
    assert made.statistics.raw_confirmations == 0.25 * 0.004 * 100_000
    assert made.statistics.raw_confirmations + made.statistics.cut_confirmations > 5**5


def test_the_new_tracks_kept_are_the_most_probable_and_then_the_best():
    existence = np.array([0.5, 0.9, 0.9, 0.9])
    assert best_held(existence, np.array([0.0, 3.0, 1.0, 2.0]), 2).tolist() == [2, 3]
