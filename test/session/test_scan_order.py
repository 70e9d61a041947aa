"""What a stamp means."""

from __future__ import annotations

import pytest

from tsepm_ros.session.scan_queue import MAX_INTERVAL, Arrival, ScanOrder

NEXT, SAME, LATE = Arrival.NEXT, Arrival.SAME_STAMP, Arrival.LATE
RESTART, GAP = Arrival.RESTART, Arrival.GAP


class Order(ScanOrder):
    """The order of scans that are all processed, but for those that come late.

    Those that are far back are taken as confirmed.
    """

    def __init__(self, window: int = 8, restart_jump: float = 60.0, max_gap: float = 0.0) -> None:
        super().__init__(window, restart_jump, max_gap)

    def classify(self, stamp: float) -> Arrival:
        arrival = super().classify(stamp)
        arrival = RESTART if arrival is Arrival.FAR_BACK else arrival
        if arrival not in (SAME, LATE):
            self.accept(stamp, arrival)
        return arrival


def classified(stamps, **options) -> list[Arrival]:
    one = Order(**options)
    return [one.classify(stamp) for stamp in stamps]


@pytest.mark.parametrize("first", [0.0, -5.0, 1.7e9])
def test_any_first_stamp_is_the_next(first):
    assert classified([first, first + 0.1]) == [NEXT, NEXT]


def test_an_equal_stamp_is_the_same_scan_again():
    assert classified([10.0, 10.0, 10.0, 22.0]) == [NEXT, SAME, SAME, NEXT]


@pytest.mark.parametrize(
    ("back", "arrival"),
    [(1e-9, LATE), (12.0, LATE), (60.0, LATE), (60.001, RESTART), (1e9, RESTART)],
)
def test_a_step_back_is_late_up_to_the_jump_and_a_restart_beyond(back, arrival):
    assert classified([100.0, 100.0 - back])[-1] is arrival


def test_a_late_scan_is_forgotten():
    # 30 is later than the late 20, but not than 40.
    assert classified([40.0, 20.0, 30.0, 41.0]) == [NEXT, LATE, LATE, NEXT]


@pytest.mark.parametrize(
    ("following", "confirmed"),
    [
        (10.0, False),  # the same again
        (9.0, False),
        (10.001, True),
        (22.0, True),
        (10.0 + MAX_INTERVAL, True),
        (10.1 + MAX_INTERVAL, False),
        (100_000.0, False),
        (100_012.0, False),  # of the run before
    ],
)
def test_a_stamp_far_back_is_confirmed_by_one_that_follows_it_before_the_last(following, confirmed):
    one = Order()
    one.classify(100_000.0)
    assert ScanOrder.classify(one, 10.0) is Arrival.FAR_BACK
    assert ScanOrder.classify(one, 99_940.0) is LATE
    assert one.is_confirmed(10.0, following) is confirmed


def test_a_gap_that_is_allowed_is_near():
    one = Order(max_gap=2 * MAX_INTERVAL)
    one.classify(100_000.0)
    assert one.is_confirmed(10.0, 10.0 + 2 * MAX_INTERVAL)


def test_after_a_restart_stamps_count_from_there():
    assert classified([1000.0, 10.0, 22.0, 9.0]) == [NEXT, RESTART, NEXT, LATE]


def test_a_restart_is_said_once():
    looped = [0.0, 12.0, 24.0, 100.0, 0.0, 12.0, 24.0]
    assert classified(looped).count(RESTART) == 1


def test_a_gap_is_longer_than_the_window_of_median_intervals():
    stamps = [0.0, 10.0, 20.0, 30.0, 40.0]
    assert classified([*stamps, 40.0 + 80.0])[-1] is NEXT
    assert classified([*stamps, 40.0 + 80.1])[-1] is GAP
    assert classified([*stamps, 40.0 + 30.1], window=3)[-1] is GAP


def test_a_gap_cannot_be_told_from_the_first_intervals():
    assert Order().gap_limit == MAX_INTERVAL
    assert classified([0.0, 1.0, 2.0, 1000.0]) == [NEXT] * 4
    assert classified([0.0, 1.0, 2.0, 1e6]) == [NEXT] * 3 + [GAP], "no sonar pings so seldom"
    assert classified([0.0, 1.0, 2.0, 3.0, 1000.0]) == [NEXT] * 4 + [GAP]


def test_one_long_interval_does_not_move_the_median():
    one = Order()
    for stamp in (0.0, 10.0, 20.0, 90.0, 100.0):
        one.classify(stamp)
    assert one.gap_limit == 80.0


def test_a_given_gap_holds_from_the_first_scan():
    assert classified([0.0, 30.0, 60.1], max_gap=30.0) == [NEXT, NEXT, GAP]


def test_scanning_goes_on_after_a_gap():
    stamps = [0.0, 10.0, 20.0, 30.0, 500.0, 510.0, 520.0]
    assert classified(stamps) == [NEXT] * 4 + [GAP, NEXT, NEXT]


def test_a_sonar_that_changes_to_a_long_period_is_followed():
    # From a 1 s range scale to a 12 s one: one gap, then the new period is known.
    stamps = [*range(10), *range(21, 141, 12)]
    arrivals = classified([float(stamp) for stamp in stamps])
    assert arrivals.count(GAP) <= 3
    assert arrivals[-5:] == [NEXT] * 5


def test_a_restart_forgets_the_intervals():
    one = Order()
    for stamp in (1000.0, 1001.0, 1002.0, 1003.0, 0.0):
        one.classify(stamp)
    assert one.gap_limit == MAX_INTERVAL


def test_resizing_keeps_the_latest_intervals():
    one = Order(window=8)
    for stamp in (0.0, 100.0, 200.0, 300.0, 310.0, 320.0, 330.0):
        one.classify(stamp)
    one.resize(3)
    assert one.gap_limit == 3 * 10.0
    one.classify(340.0)
    one.resize(8)
    assert one.gap_limit == 8 * 10.0


def test_reset_forgets_everything():
    one = Order()
    for stamp in (0.0, 1.0, 2.0, 3.0):
        one.classify(stamp)
    one.reset()
    assert one.gap_limit == MAX_INTERVAL
    assert one.classify(-1e6) is NEXT


def test_changed_limits_count_at_the_next_scan():
    one = Order()
    one.classify(100.0)
    one.restart_jump, one.max_gap = 5.0, 20.0
    assert one.classify(121.0) is GAP
    assert one.classify(115.0) is RESTART


def test_late_scans_that_follow_one_another_are_a_restart():
    # A recording of 50 s that loops: shorter than the jump that is a restart at once.
    loop = [0.0, 10.0, 20.0, 30.0, 40.0]
    assert classified([*loop, *loop]) == [NEXT] * 5 + [LATE, LATE, RESTART, NEXT, NEXT]


def test_a_loop_of_three_scans_is_a_restart_at_its_third():
    assert classified([0.0, 12.0, 24.0] * 2) == [NEXT] * 3 + [LATE, LATE, RESTART]


def test_a_stamp_far_ahead_costs_two_scans_and_not_those_until_then():
    assert classified([0.0, 10.0, 55.0, 20.0, 30.0, 40.0, 50.0])[3:] == [LATE, LATE, RESTART, NEXT]


def test_late_scans_with_falling_stamps_are_no_restart_until_the_stamps_rise():
    falling = [0.0, 10.0, 20.0, 30.0, 40.0, 25.0, 15.0, 5.0]
    assert classified([*falling, 1.0])[5:] == [LATE] * 4
    assert classified([*falling, 6.0, 7.0])[5:] == [LATE] * 4 + [RESTART]


def test_single_late_scans_between_good_ones_never_restart():
    stamps = [0.0, 10.0, 5.0, 20.0, 6.0, 30.0, 7.0, 40.0]
    assert RESTART not in classified(stamps)


def test_a_scan_that_is_not_accepted_leaves_no_trace():
    one = Order(max_gap=100.0)
    one.classify(0.0)
    for stamp, arrival in [(1e6, GAP), (12.0, NEXT), (-1e6, Arrival.FAR_BACK), (12.0, NEXT)]:
        assert ScanOrder.classify(one, stamp) is arrival
    assert one.classify(12.0) is NEXT
