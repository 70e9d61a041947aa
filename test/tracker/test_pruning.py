"""The M/N rule at its borders, and the thresholds of the evaluations."""

import math

import pytest
from scipy import stats
from support.builders import FIXED_RANGE_ERROR, scan_at

from tsepm_ros import make_initiator
from tsepm_ros.tracker.pruning import clutter_threshold, distance_threshold

HERE = (2000.0, 0.0)
FAR = (-2000.0, 0.0)


def play(min_hits: int, window: int, pattern: str):
    """One target that stands still, seen in the scans marked x; returns initiator and tracks."""
    initiator = make_initiator(
        "tsepm", sensor=FIXED_RANGE_ERROR, min_hits=min_hits, window=window, max_speed=1.0
    )
    tracks = [
        initiator.process(scan_at(12.0 * k, [HERE] if seen == "x" else []))
        for k, seen in enumerate(pattern)
    ]
    return initiator, tracks


@pytest.mark.parametrize(
    ("min_hits", "window", "pattern"),
    [(2, 2, "xx"), (3, 3, "xxx"), (3, 5, "x.x.x"), (3, 5, "xx..x"), (5, 8, "xxx...xx")],
)
def test_the_last_hit_in_the_last_scan_of_the_window_confirms(min_hits, window, pattern):
    initiator, tracks = play(min_hits, window, pattern)
    assert [len(new) for new in tracks] == [0] * (len(pattern) - 1) + [1]
    (track,) = tracks[-1]
    assert track.scan_count == window == len(pattern)
    assert len(track.hits) == min_hits
    assert initiator.statistics.potential_tracks == 0


@pytest.mark.parametrize(
    ("min_hits", "window", "pattern"),
    [(3, 5, "xx..."), (3, 5, "x...x"), (2, 2, "x."), (5, 8, "xxxx....")],
)
def test_a_track_ends_with_the_window_where_a_hit_is_missing(min_hits, window, pattern):
    initiator, _ = play(min_hits, window, pattern[:-1])
    assert initiator.statistics.potential_tracks == 1
    initiator, tracks = play(min_hits, window, pattern)
    assert not any(tracks)
    assert initiator.statistics.terminated == 1
    assert initiator.statistics.potential_tracks == 0


def test_a_hopeless_track_gates_until_its_end_and_blocks_new_starts():
    # After scan 2 of 4 the track cannot reach 3 hits in 4 scans any more. The detection of scan 3
    # still falls into its gate: it starts nothing, and ends with the track.
    initiator, _ = play(3, 4, "x..")
    assert initiator.statistics.potential_tracks == 1
    assert not initiator.process(scan_at(36.0, [HERE, FAR]))
    assert initiator.statistics.started == 1, "only the detection outside every gate starts"
    assert initiator.statistics.terminated == 1
    assert initiator.statistics.potential_tracks == 1
    # So the target, seen in every scan from 3 on, is found one scan later than M says.
    found = [len(initiator.process(scan_at(12.0 * k, [HERE]))) for k in range(4, 8)]
    assert found == [0, 0, 1, 0]


def test_scans_are_counted_as_they_come_not_by_time():
    # A missing ping is simply not a scan: 5 received scans within any time.
    initiator = make_initiator("tsepm", sensor=FIXED_RANGE_ERROR, min_hits=3, window=3)
    stamps = [0.0, 12.0, 60.0]
    tracks = [initiator.process(scan_at(stamp, [HERE])) for stamp in stamps]
    assert [len(new) for new in tracks] == [0, 0, 1]
    assert tracks[-1][0].scan_count == 3
    assert tracks[-1][0].age == 60.0


@pytest.mark.parametrize("probability", [0.5, 0.9, 0.99, 0.999999])
def test_the_squared_threshold_is_the_chi_square_quantile_of_two_degrees(probability):
    expected = stats.chi2(2).ppf(probability)
    assert distance_threshold(probability, "squared") == pytest.approx(expected)
    assert distance_threshold(probability, "literal") == pytest.approx(math.sqrt(expected))


def test_the_literal_threshold_is_the_paper_s():
    assert distance_threshold(0.99, "literal") == pytest.approx(3.03, abs=0.005)


@pytest.mark.parametrize("size", [0.001, 0.05, 0.5, 0.999])
@pytest.mark.parametrize("min_hits", [2, 5, 16])
def test_the_clutter_threshold_is_the_chi_square_quantile(size, min_hits):
    expected = stats.chi2(2 * min_hits - 2).ppf(size)
    assert clutter_threshold(size, min_hits) == pytest.approx(expected)


def crooked(reading: str) -> int:
    """Tracks from three hits off the line by so much that f_1 lies between gamma and gamma^2."""
    initiator = make_initiator(
        "tsepm",
        sensor=FIXED_RANGE_ERROR,
        min_hits=3,
        window=3,
        max_speed=100.0,
        pruning_reading=reading,
    )
    xs = (2000.0, 2135.0, 2000.0)
    tracks = [initiator.process(scan_at(12.0 * k, [(x, 0.0)])) for k, x in enumerate(xs)]
    if tracks[-1]:
        assert 3.04 < tracks[-1][0].evaluation < 9.2
    return len(tracks[-1])


def test_the_readings_differ_between_gamma_and_its_square():
    assert crooked("literal") == 0
    assert crooked("squared") == 1


def test_kennedy_s_test_keeps_the_tight_track_and_removes_the_loose_one():
    sensor = FIXED_RANGE_ERROR

    def tracks(step: float) -> int:
        initiator = make_initiator(
            "tsepm",
            sensor=sensor,
            min_hits=3,
            window=3,
            max_speed=100.0,
            evaluation="clutter_statistic",
            clutter_test_size=0.05,
            clutter_density="given",
        )
        scans = [scan_at(12.0 * k, [(2000.0 + step * k, 0.0)]) for k in range(3)]
        return sum(len(initiator.process(scan)) for scan in scans)

    # The 5 % quantile of chi-square(4) is 0.711: 2 lambda pi 2 step^2 reaches it at 238 m.
    assert tracks(237.0) == 1
    assert tracks(239.0) == 0
