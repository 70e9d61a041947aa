"""What a stamp means."""

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


TENS = [0.0, 10.0, 20.0, 30.0, 40.0]
FALLING = [*TENS, 25.0, 15.0, 5.0]
LOOP = [0.0, 12.0, 24.0]
CASES = {
    "any first stamp is the next": ([-5.0, -4.9], [NEXT] * 2, {}),
    "an equal stamp is the same scan again": (
        [10.0, 10.0, 10.0, 22.0],
        [NEXT, SAME, SAME, NEXT],
        {},
    ),
    "a step back of the jump is late": ([100.0, 40.0], [NEXT, LATE], {}),
    "beyond the jump it is a restart": ([100.0, 39.999], [NEXT, RESTART], {}),
    "a late scan is forgotten": ([40.0, 20.0, 30.0, 41.0], [NEXT, LATE, LATE, NEXT], {}),
    "after a restart stamps count from there": (
        [1000.0, 10.0, 22.0, 9.0],
        [NEXT, RESTART, NEXT, LATE],
        {},
    ),
    "a restart is said once": ([*LOOP, 100.0, *LOOP], [NEXT] * 4 + [RESTART, NEXT, NEXT], {}),
    "the window of median intervals is no gap": ([*TENS, 120.0], [NEXT] * 6, {}),
    "a gap is longer than that": ([*TENS, 120.1], [NEXT] * 5 + [GAP], {}),
    "a shorter window has shorter gaps": ([*TENS, 70.1], [NEXT] * 5 + [GAP], {"window": 3}),
    "the first intervals are too few": ([0.0, 1.0, 2.0, 1000.0], [NEXT] * 4, {}),
    "no sonar pings so seldom": ([0.0, 1.0, 2.0, 1e6], [NEXT] * 3 + [GAP], {}),
    "three intervals are enough": ([0.0, 1.0, 2.0, 3.0, 1000.0], [NEXT] * 4 + [GAP], {}),
    "one long interval does not move the median": (
        [0.0, 10.0, 20.0, 90.0, 100.0, 180.0, 260.1],
        [NEXT] * 6 + [GAP],
        {},
    ),
    "a given gap holds from the first scan": (
        [0.0, 30.0, 60.1],
        [NEXT] * 2 + [GAP],
        {"max_gap": 30},
    ),
    "scanning goes on after a gap": (
        [*TENS, 500.0, 510.0, 520.0],
        [NEXT] * 5 + [GAP, NEXT, NEXT],
        {},
    ),
    "a restart forgets the intervals": (
        [1000.0, 1001.0, 1002.0, 1003.0, 0.0, 500.0],
        [NEXT] * 4 + [RESTART, NEXT],
        {},
    ),
    "late scans that follow one another are a restart": (
        [*TENS, *TENS],
        [NEXT] * 5 + [LATE, LATE, RESTART, NEXT, NEXT],
        {},
    ),
    "a loop of three scans is a restart at its third": (
        LOOP * 2,
        [NEXT] * 3 + [LATE, LATE, RESTART],
        {},
    ),
    "a stamp far ahead costs two scans": (
        [0.0, 10.0, 55.0, 20.0, 30.0, 40.0, 50.0],
        [NEXT] * 3 + [LATE, LATE, RESTART, NEXT],
        {},
    ),
    "falling stamps are no restart": ([*FALLING, 1.0], [NEXT] * 5 + [LATE] * 4, {}),
    "until they rise": ([*FALLING, 6.0, 7.0], [NEXT] * 5 + [LATE] * 4 + [RESTART], {}),
    "single late scans never restart": (
        [0.0, 10.0, 5.0, 20.0, 6.0, 30.0, 7.0, 40.0],
        [NEXT, NEXT, LATE, NEXT, LATE, NEXT, LATE, NEXT],
        {},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_stamp_is_classified_by_those_before(case):
    stamps, arrivals, options = CASES[case]
    assert classified(stamps, **options) == arrivals


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
    one.max_gap = 2 * MAX_INTERVAL
    assert one.is_confirmed(10.0, 10.0 + 2 * MAX_INTERVAL)


def test_a_sonar_that_changes_to_a_long_period_is_followed():
    # From a 1 s range scale to a 12 s one: one gap, then the new period is known.
    stamps = [*range(10), *range(21, 141, 12)]
    arrivals = classified([float(stamp) for stamp in stamps])
    assert arrivals.count(GAP) <= 3
    assert arrivals[-5:] == [NEXT] * 5


def test_resizing_keeps_the_latest_intervals():
    one = Order(window=8)
    for stamp in (0.0, 100.0, 200.0, 300.0, 310.0, 320.0, 330.0):
        one.classify(stamp)
    one.resize(3)
    assert one.gap_limit == 3 * 10.0
    one.classify(340.0)
    one.resize(8)
    assert one.gap_limit == 8 * 10.0
    one.reset()
    assert one.gap_limit == MAX_INTERVAL
    assert one.classify(-1e6) is NEXT


def test_a_scan_that_is_not_accepted_leaves_no_trace():
    one = Order(max_gap=100.0)
    one.classify(0.0)
    for stamp, arrival in [(1e6, GAP), (12.0, NEXT), (-1e6, Arrival.FAR_BACK), (12.0, NEXT)]:
        assert ScanOrder.classify(one, stamp) is arrival
    assert one.classify(12.0) is NEXT
