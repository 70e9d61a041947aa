"""The order of scans: stamps that repeat, come late, go back or jump ahead, and too many."""

import dataclasses
from collections import Counter

import numpy as np
import pytest
from support.builders import assert_same_tracks
from support.sessions import (
    BOX,
    NotedSession,
    arrived,
    moving,
    moving_settings,
    ping,
    play,
    sail,
    session,
    simulated,
)

from tsepm_ros import Scan
from tsepm_ros.methods.score import Score
from tsepm_ros.session import inputs
from tsepm_ros.session.inputs import MAX_INTERVAL, Arrival, ScanOrder
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.options import CommonOptions

NEXT, SAME, LATE = Arrival.NEXT, Arrival.SAME_STAMP, Arrival.LATE
RESTART, GAP = Arrival.RESTART, Arrival.GAP


class Order(ScanOrder):
    """The order of scans that are all processed, but for those that come late.

    Those that are far back are taken as confirmed.
    """

    def __init__(self, window: int = 8, restart_jump: float = 60.0, max_gap: float = 0.0) -> None:
        session = SessionOptions(restart_jump=restart_jump, max_gap=max_gap)
        super().__init__(Settings(session, methods={"score": Score.Options(window=window)}))

    def classify(self, stamp: float) -> Arrival:
        arrival = super().classify(stamp)
        arrival = RESTART if arrival is Arrival.FAR_BACK else arrival
        if arrival not in (SAME, LATE):
            self.accept(stamp, arrival)
        return arrival


def classified(stamps, **options) -> list[Arrival]:
    one = Order(**options)
    return [one.classify(stamp) for stamp in stamps]


TENS = [0.0, 10.0, 20.0, 30.0, 40.0]
FALLING = [*TENS, 25.0, 15.0, 5.0]
LOOP = [0.0, 12.0, 24.0]
LETTERS = {"n": NEXT, "s": SAME, "l": LATE, "r": RESTART, "g": GAP}
CASES = {
    "any first stamp is the next": ([-5.0, -4.9], "nn"),
    "an equal stamp is the same scan again": ([10.0, 10.0, 10.0, 22.0], "nssn"),
    "a step back of the jump is late": ([100.0, 40.0], "nl"),
    "beyond the jump it is a restart": ([100.0, 39.999], "nr"),
    "a late scan is forgotten": ([40.0, 20.0, 30.0, 41.0], "nlln"),
    "after a restart stamps count from there": ([1000.0, 10.0, 22.0, 9.0], "nrnl"),
    "a restart is said once": ([*LOOP, 100.0, *LOOP], "nnnnrnn"),
    "the window of median intervals is no gap": ([*TENS, 120.0], "nnnnnn"),
    "a gap is longer than that": ([*TENS, 120.1], "nnnnng"),
    "a shorter window has shorter gaps": ([*TENS, 70.1], "nnnnng", {"window": 3}),
    "the first intervals are too few": ([0.0, 1.0, 2.0, 1000.0], "nnnn"),
    "no sonar pings so seldom": ([0.0, 1.0, 2.0, 1e6], "nnng"),
    "three intervals are enough": ([0.0, 1.0, 2.0, 3.0, 1000.0], "nnnng"),
    "one long interval does not move the median": (
        [0.0, 10.0, 20.0, 90.0, 100.0, 180.0, 260.1],
        "nnnnnng",
    ),
    "a given gap holds from the first scan": ([0.0, 30.0, 60.1], "nng", {"max_gap": 30}),
    "scanning goes on after a gap": ([*TENS, 500.0, 510.0, 520.0], "nnnnngnn"),
    "a restart forgets the intervals": ([1000.0, 1001.0, 1002.0, 1003.0, 0.0, 500.0], "nnnnrn"),
    "late scans that follow one another are a restart": ([*TENS, *TENS], "nnnnnllrnn"),
    "a loop of three scans is a restart at its third": (LOOP * 2, "nnnllr"),
    "a stamp far ahead costs two scans": ([0.0, 10.0, 55.0, 20.0, 30.0, 40.0, 50.0], "nnnllrn"),
    "falling stamps are no restart": ([*FALLING, 1.0], "nnnnnllll"),
    "until they rise": ([*FALLING, 6.0, 7.0], "nnnnnllllr"),
    "single late scans never restart": (
        [0.0, 10.0, 5.0, 20.0, 6.0, 30.0, 7.0, 40.0],
        "nnlnlnln",
    ),
}
"""Stamps, the letter of each one's arrival, and options."""


@pytest.mark.parametrize("case", CASES)
def test_a_stamp_is_classified_by_those_before(case):
    stamps, letters, *options = CASES[case]
    assert classified(stamps, **dict(*options)) == [LETTERS[letter] for letter in letters]


@pytest.mark.parametrize(
    ("following", "confirmed"),
    [
        (10.0, False),  # the same again
        (9.0, False),
        (10.001, True),
        (10.0 + MAX_INTERVAL, True),
        (10.1 + MAX_INTERVAL, False),
        (100_012.0, False),  # of the run before
    ],
)
def test_a_stamp_far_back_is_confirmed_by_one_that_follows_it_before_the_last(following, confirmed):
    one = Order()
    one.classify(100_000.0)
    assert ScanOrder.classify(one, 10.0) is Arrival.FAR_BACK
    assert one.is_confirmed(10.0, following) is confirmed
    one.settings = Order(max_gap=2 * MAX_INTERVAL).settings
    assert one.is_confirmed(10.0, 10.0 + 2 * MAX_INTERVAL)


def test_a_sonar_that_changes_to_a_long_period_is_followed():
    # From a 1 s range scale to a 12 s one: one gap, then the new period is known.
    stamps = [*range(10), *range(21, 141, 12)]
    arrivals = classified([float(stamp) for stamp in stamps])
    assert arrivals.count(GAP) <= 3
    assert arrivals[-5:] == [NEXT] * 5


def test_another_window_has_the_latest_intervals():
    one = Order(window=8)
    for stamp in (0.0, 100.0, 200.0, 300.0, 310.0, 320.0, 330.0):
        one.classify(stamp)
    one.settings = Order(window=3).settings
    assert one.gap_limit == 3 * 10.0
    one.classify(340.0)
    one.settings = Order(window=8).settings
    assert one.gap_limit == 8 * 10.0


def test_a_scan_that_is_not_accepted_leaves_no_trace():
    one = Order(max_gap=100.0)
    one.classify(0.0)
    for stamp, arrival in [(1e6, GAP), (12.0, NEXT), (-1e6, Arrival.FAR_BACK), (12.0, NEXT)]:
        assert ScanOrder.classify(one, stamp) is arrival
    assert one.classify(12.0) is NEXT


QUEUE_LENGTH = 32

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
    clean, disturbed = Session(chosen), NotedSession(chosen)
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
            assert disturbed.heard == [reason]
    assert clean.tracker.totals.confirmed > 0


def test_the_queue_of_waiting_scans_is_bounded_also_over_a_restart(monkeypatch):
    monkeypatch.setattr(inputs, "QUEUE_LENGTH", QUEUE_LENGTH)
    one = NotedSession(moving_settings())
    for k in range(QUEUE_LENGTH + 3):
        one.add_scan(ping(float(k)), 0.0)
    assert one.figures().waiting == QUEUE_LENGTH
    assert one.dropped == {"queue_full": 3}
    sail(one, 0.0, 100.0)
    assert [result.stamp for result in one.process(0.0)] == [
        float(k) for k in range(3, QUEUE_LENGTH + 3)
    ]
    one = NotedSession(moving_settings())
    sail(one, 999.0, 1100.0)
    one.add_scan(ping(1000.0), 0.0)
    assert len(list(one.process(0.0))) == 1
    for k in range(QUEUE_LENGTH + 1):
        one.add_scan(ping(float(k)), 0.0)
    sail(one, 0.0, 100.0)
    assert len(list(one.process(0.0))) == QUEUE_LENGTH


def test_a_limit_lowered_while_a_scan_waits_drops_it():
    one = moving()
    one.add_scan(ping(5.0, n=4), 0.0)
    sail(one, 0.0, 20.0)
    one.configure(dataclasses.replace(one.settings, common=CommonOptions(max_detections=3)))
    one.add_scan(ping(12.0), 0.0)
    assert [result.stamp for result in one.process(0.0)] == [12.0]
    assert one.dropped == {"too_many_detections": 1}


def test_a_restart_resets_the_state_and_is_said_once():
    one = session()
    before = play(one, [1000, 1012, 1024])
    after = play(one, [0, 12, 24])
    assert [result.arrival for result in after] == [Arrival.RESTART, Arrival.NEXT, Arrival.NEXT]
    assert one.heard == ["restart"]
    assert after[0].ended == {before[2].new[0].track_id: "cleared"}
    assert len(after[0].current) == 0
    assert [len(result.new) for result in after] == [0, 0, 1]
    assert after[2].new[0].hits == ((0, 0), (1, 0), (2, 0)), "scans count from the restart"
    assert after[2].new[0].track_id == 1, "ids go on"


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
    assert (list(one.process(last=True)), one.figures().waiting) == ([], 0)
    assert one.dropped == {"scan_far_back": 1}


def test_a_gap_drops_potential_tracks_and_keeps_the_held_also_before_a_dropped_scan():
    one = session(CommonOptions(hold_time=1e6))
    stamps = [0, 12, 24, 36, 48, 1000, 1012, 1024]
    results = play(one, stamps)
    assert results[5].arrival is Arrival.GAP
    assert one.heard == ["gap"]
    assert [len(result.new) for result in results] == [0, 0, 1, 0, 0, 0, 0, 1]
    # Its place is not known well enough after the gap, and then it is again.
    published = [[track.track_id for track in result.current] for result in results]
    assert published[4:7] == [[0], [], [0]]
    assert results[7].new[0].scan_count == 3
    one = moving(max_gap=100.0)
    sail(one, 0.0, 30.0)
    play(one, [0, 12], now=0.0)
    one.add_scan(ping(500.0), 0.0)
    assert list(one.process()) == []
    sail(one, 505.0, 600.0)
    results = play(one, [512, 524, 536], now=0.0)
    assert [len(result.new) for result in results] == [0, 0, 1]
