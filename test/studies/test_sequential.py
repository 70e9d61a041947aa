"""The improved sequential method on scenes by hand."""

from __future__ import annotations

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, reconfigured, scan_at

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.tracker.measurement import convert


def initiator(**options):
    return make_initiator("sequential", sensor=FIXED_RANGE_ERROR, **options)


def confirmed_at(seen: str, **options) -> list[int]:
    """Scans, from 1 on, that confirm a target seen where `seen` has a 1."""
    made = initiator(**options)
    found = []
    for k, one in enumerate(seen):
        where = [(3000.0, 5.0 * 12.0 * k)] if one == "1" else []
        found += [k + 1] * len(made.process(scan_at(12.0 * k, where)))
    return found


def test_the_defaults_are_the_article_s():
    options = initiator().options
    assert (options.min_hits, options.window, options.gate_sigmas) == (6, 10, 2.0)
    assert (options.estimator, options.matching) == ("least_squares", "oldest")


@pytest.mark.parametrize(
    ("seen", "confirmed"),
    [("1111011", [7]), ("1110010101", [10]), ("1010010101", []), ("10100101011", [])],
    ids=["figure 3", "figure 4", "figure 5", "a sixth hit too late"],
)
def test_six_of_ten_as_in_the_figures(seen, confirmed):
    assert confirmed_at(seen) == confirmed


@pytest.mark.parametrize(
    ("ranges", "hits"),
    [
        ([3000, 3000, 3000, 3000, 3200, 3150, 3150], [1, 2, 3, 4, 6, 7]),
        ([3000, 3000, 3000, 3200, 3310, 3250, 3450, 3400, 3600, 3550], [1, 2, 3, 6, 8, 10]),
    ],
    ids=["figure 3", "figure 4"],
)
def test_points_outside_the_gate_leave_the_track_its_later_ones(ranges, hits):
    found = {}
    for matching in ("oldest", "nearest"):
        made = initiator(matching=matching)
        tracks = []
        for k, x in enumerate(ranges):
            tracks += made.process(scan_at(12.0 * k, [(float(x), 0.0)]))
        found[matching] = [[scan + 1 for scan, _ in track.hits] for track in tracks]
    assert found["oldest"] == [hits]
    assert hits not in found["nearest"], "the points outside must contend for the later ones"


@pytest.mark.parametrize("gap", [1, 2, 3, 5])
@pytest.mark.parametrize("inside", [True, False])
def test_the_gate_is_that_of_equation_7(gap, inside):
    # Hits along the line of sight: distances are differences of the unbiased ranges.
    made = initiator(min_hits=2)
    made.process(scan_at(0.0, [(3000.0, 0.0)]))
    for k in range(1, gap):
        made.process(scan_at(12.0 * k, []))
    reach = 10.0 * gap * 12.0 + 2.0 * 30.0
    unbiased = np.exp(0.5 * FIXED_RANGE_ERROR.azimuth_std**2)
    step = (reach + (-0.01 if inside else 0.01)) / unbiased
    assert len(made.process(scan_at(12.0 * gap, [(3000.0 + step, 0.0)]))) == inside


def test_the_margin_may_be_of_the_position_s_error():
    scan = scan_at(0.0, [(3000.0, 0.0)])
    sigma = convert(scan, FIXED_RANGE_ERROR, 0)["major_sigma"][0]
    assert sigma > 50.0
    for error, found in (("range", 0), ("major_axis", 1)):
        made = initiator(min_hits=2, gate_error=error)
        made.process(scan)
        assert len(made.process(scan_at(12.0, [(3000.0, 120.0 + 2.0 * sigma - 1.0)]))) == found


def test_a_matched_detection_starts_nothing_and_the_others_do():
    made = initiator()
    made.process(scan_at(0.0, [(3000.0, 0.0)]))
    made.process(scan_at(12.0, [(3000.0, 10.0), (3000.0, 30.0)]))
    assert made.statistics.started == 1
    assert made.statistics.potential_tracks == 2
    (track,) = made.potential_tracks()
    assert track.hits == ((0, 0), (1, 0))


@pytest.mark.parametrize(
    ("matching", "lengths"),
    [("nearest", {1: 2}), ("oldest", {0: 2}), ("shared", {0: 2, 1: 2})],
)
def test_who_gets_a_detection_that_two_tracks_match(matching, lengths):
    # Gates of 10 m/s and 60 m: the second detection is outside the first's, the third in both.
    made = initiator(matching=matching)
    for k, x in enumerate((3000.0, 3200.0, 3190.0)):
        made.process(scan_at(12.0 * k, [(x, 0.0)]))
    assert {track.hits[0][0]: len(track.hits) for track in made.potential_tracks()} == lengths
    assert made.statistics.started == 0


def test_the_oldest_track_takes_what_is_nearest_to_it_and_leaves_the_rest():
    made = initiator(matching="oldest")
    for k, places in enumerate(([3000.0], [3200.0], [3190.0, 3150.0])):
        made.process(scan_at(12.0 * k, [(x, 0.0) for x in places]))
    found = sorted(track.hits for track in made.potential_tracks())
    assert found == [((0, 0), (2, 1)), ((1, 0), (2, 0))]


def test_tracks_that_share_a_detection_are_put_out_once_and_end():
    made = initiator(min_hits=3, matching="shared")
    tracks = []
    for k, places in enumerate(([3000.0, 3100.0], [3050.0], [3050.0])):
        tracks += made.process(scan_at(12.0 * k, [(x, 0.0) for x in places]))
    assert len(tracks) == 1
    assert made.statistics.raw_confirmations == 2
    assert made.statistics.merged == 1
    assert made.statistics.potential_tracks == 0


def test_the_nearest_pair_of_all_is_matched_first():
    made = initiator(min_hits=2, matching="nearest")
    made.process(scan_at(0.0, [(3000.0, 0.0), (3000.0, 60.0)]))
    # 40 m from the first and 20 m from the second; 70 m from the first, 130 m from the second.
    tracks = made.process(scan_at(12.0, [(3000.0, 40.0), (3000.0, -70.0)]))
    assert [track.hits for track in tracks] == [((0, 0), (1, 1)), ((0, 1), (1, 0))]


def test_the_time_between_the_detections_counts_not_the_scans():
    made = initiator(min_hits=2)
    made.process(scan_at(0.0, [(3000.0, 0.0)]))
    assert len(made.process(scan_at(40.0, [(3000.0, 400.0)]))) == 1


def test_a_moving_sensor_is_taken_out():
    made = make_initiator("sequential", sensor=SensorModel(range_std=1.0, range_std_fraction=0.0))
    tracks = []
    for k in range(6):
        own = np.array([4.0 * 12.0 * k, 0.0])
        scan = scan_at(12.0 * k, [np.array([6000.0, 60.0 * k]) - own], sensor_pose=[*own, 0.0])
        tracks += made.process(scan)
    np.testing.assert_allclose(tracks[0].state, [6000.0, 0.0, 300.0, 5.0], atol=1.0)


def test_another_number_of_hits_starts_over():
    made = initiator()
    made.process(scan_at(0.0, [(3000.0, 0.0)]))
    assert not reconfigured(made, made.sensor, made.common, initiator(min_hits=5).options)
    assert not made.potential_tracks()
