"""Bad input: counted, named, and without effect on what comes after it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField
from support.boat import Boat
from support.expectation import as_scan, assert_same, assert_stamps, confirmed, initiator
from support.ros_world import WARN
from support.sonar_driver import START_NS, Ping, cloud, pings, points

NAN, INF = float("nan"), float("inf")
SECOND = 10**9
SENT = pings(14)
WHEN = 4
"""The bad message comes after so many good ones, while potential tracks wait for more hits."""


def message(ping: Ping, **more: Sequence[float]) -> PointCloud2:
    return cloud(ping.stamp_ns, {"range": ping.range, "azimuth": ping.azimuth, **more})


def between(good: Sequence[Ping]) -> int:
    """A stamp between the last good ping before the bad message and the first after it."""
    return (good[WHEN - 1].stamp_ns + good[WHEN].stamp_ns) // 2


BAD_VALUES = [
    pytest.param({"range": NAN}, "range_not_finite", id="range_nan"),
    pytest.param({"range": INF}, "range_not_finite", id="range_infinite"),
    pytest.param({"range": -INF}, "range_not_finite", id="range_minus_infinite"),
    pytest.param({"range": 0.0}, "range_not_positive", id="range_zero"),
    pytest.param({"range": -5.0}, "range_not_positive", id="range_negative"),
    pytest.param({"azimuth": NAN}, "azimuth_not_finite", id="azimuth_nan"),
    pytest.param({"azimuth": -INF}, "azimuth_not_finite", id="azimuth_infinite"),
    pytest.param({"range_std": -1.0}, "range_std_not_positive", id="range_std_negative"),
    pytest.param({"range_std": 0.0}, "range_std_not_positive", id="range_std_zero"),
    pytest.param({"range_std": NAN}, "range_std_not_positive", id="range_std_nan"),
    pytest.param({"azimuth_std": -0.1}, "azimuth_std_not_positive", id="azimuth_std_negative"),
    pytest.param({"azimuth_std": NAN}, "azimuth_std_not_positive", id="azimuth_std_nan"),
    pytest.param({"azimuth_std": INF}, "azimuth_std_not_positive", id="azimuth_std_infinite"),
    pytest.param({"time_offset": NAN}, "time_offset_not_finite", id="time_offset_nan"),
]


USUAL = {
    "range": 4000.0,
    "azimuth": 0.5,
    "range_std": 45.0,
    "azimuth_std": 0.0175,
    "time_offset": 0.0,
}


def with_optional(ping: Ping, names: Iterable[str]) -> dict[str, np.ndarray]:
    """A ping's columns, and these with their usual values, as float32."""
    columns = {"range": np.asarray(ping.range), "azimuth": np.asarray(ping.azimuth)}
    for name in names:
        columns.setdefault(name, np.full(len(ping.range), USUAL[name], np.float32))
    return columns


@pytest.mark.parametrize(("bad", "reason"), BAD_VALUES)
def test_a_bad_detection_is_dropped_and_the_rest_of_its_scan_is_used(world, bad, reason):
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    good = with_optional(SENT[WHEN], bad)
    places = [0, 5, len(SENT[WHEN].range)]  # before, among and after the good ones
    spoilt = {
        name: np.insert(values, places, bad.get(name, USUAL[name])) for name, values in good.items()
    }
    boat.driver.publisher.publish(cloud(SENT[WHEN].stamp_ns, spoilt))
    received += boat.take(1, WHEN)
    received += boat.send(SENT[WHEN + 1 :])
    assert world.dropped() == {reason: 3}
    world.until_logged(reason, "3 detections dropped", level=WARN)

    optional = {name: good[name].astype(float) for name in list(good)[2:]}
    same = initiator()
    expected = [
        same.process(as_scan(ping, **(optional if index == WHEN else {})))
        for index, ping in enumerate(SENT)
    ]
    assert_same(received, expected)
    assert_stamps(received, SENT)


def test_any_finite_azimuth_is_good(world):
    boat = Boat(world)
    turned = [
        replace(ping, azimuth=np.float32(np.remainder(ping.azimuth, 2 * np.pi))) for ping in SENT
    ]
    assert_same(boat.send(turned), confirmed(turned))
    assert world.dropped() == {}


@dataclass
class Unusable:
    """A message that cannot be used: how to make it of a good one, and what it counts as."""

    spoil: Callable[[PointCloud2], object]
    reason: str
    said: str = ""


def rename(old: str, new: str) -> Callable[[PointCloud2], None]:
    def spoil(bad: PointCloud2) -> None:
        next(field for field in bad.fields if field.name == old).name = new

    return spoil


def setting(index: int, **values: int) -> Callable[[PointCloud2], None]:
    def spoil(bad: PointCloud2) -> None:
        for name, value in values.items():
            setattr(bad.fields[index], name, value)

    return spoil


def resize(**values: Any) -> Callable[[PointCloud2], None]:
    def spoil(bad: PointCloud2) -> None:
        for name, value in values.items():
            setattr(bad, name, value)

    return spoil


def shorten(bad: PointCloud2) -> None:
    bad.data = bad.data[:-1]


LARGEST = 2**32 - 1
UNUSABLE = {
    "no_azimuth": Unusable(rename("azimuth", "phi"), "missing_field", "azimuth"),
    "no_range": Unusable(rename("range", "r"), "missing_field", "range"),
    "no_fields": Unusable(resize(fields=[]), "missing_field", "no fields"),
    "azimuth_as_integer": Unusable(
        setting(1, datatype=PointField.INT32), "wrong_datatype", "azimuth"
    ),
    "unknown_datatype": Unusable(setting(0, datatype=99), "wrong_datatype", "range"),
    "counted_field": Unusable(setting(0, count=2), "wrong_count", "range"),
    "offset_beyond_the_point": Unusable(setting(1, offset=6), "bad_offset", "azimuth"),
    "huge_offset": Unusable(setting(1, offset=LARGEST), "bad_offset", "azimuth"),
    "two_ranges": Unusable(rename("azimuth", "range"), "missing_field", "azimuth"),
    "short_data": Unusable(shorten, "short_data", "height * row_step"),
    "no_data": Unusable(resize(data=b""), "short_data", "0 bytes"),
    "short_rows": Unusable(resize(row_step=8), "bad_row_step", "row_step"),
    "no_point_step": Unusable(resize(point_step=0), "bad_offset", "point_step"),
    "huge_width": Unusable(resize(width=LARGEST), "bad_row_step", "row_step"),
    "huge_height": Unusable(resize(height=LARGEST), "short_data", "data"),
    "other_frame": Unusable(
        lambda bad: setattr(bad.header, "frame_id", "elsewhere"), "unknown_frame", "'elsewhere'"
    ),
    "no_frame": Unusable(
        lambda bad: setattr(bad.header, "frame_id", ""), "empty_frame", "frame_id"
    ),
}


@pytest.mark.parametrize("name", UNUSABLE)
def test_an_unusable_message_is_dropped_counted_and_named(world, name):
    case = UNUSABLE[name]
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    bad = message(replace(SENT[WHEN], stamp_ns=between(SENT)))
    case.spoil(bad)
    boat.driver.publisher.publish(bad)
    boat.driver.publisher.publish(bad)
    received += boat.send(SENT[WHEN:])
    assert world.dropped() == {case.reason: 2}
    line = world.until_logged(case.reason, case.said, level=WARN)
    assert "\n" not in line
    assert len([one for one in world.logged(WARN) if case.reason in one]) == 1, "throttled"
    status = world.status("detections")
    assert (status.level, status.message) == (b"\x01", f"dropped: 2 {case.reason}")
    assert_same(received, confirmed(SENT))
    assert_stamps(received, SENT)


@pytest.mark.parametrize("name", ["no_azimuth", "short_data"])
def test_an_unusable_first_message_does_no_harm(world, name):
    case = UNUSABLE[name]
    boat = Boat(world)
    bad = message(replace(SENT[0], stamp_ns=START_NS - SECOND))
    bad.header.frame_id = "elsewhere"
    case.spoil(bad)
    boat.driver.publisher.publish(bad)
    assert_same(boat.send(SENT), confirmed(SENT))
    assert world.dropped() == {case.reason: 1}


@pytest.mark.parametrize("points_in", [(0, 1), (1, 0), (0, 0)], ids=["row", "column", "nothing"])
def test_an_empty_cloud_is_a_scan_without_detections(world, points_in):
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    empty = Ping(SENT[WHEN].stamp_ns, [], [])
    bare = message(empty)
    bare.width, bare.height = points_in
    boat.driver.publisher.publish(bare)
    received += boat.take(1, WHEN)
    received += boat.send(SENT[WHEN + 1 :])
    sent = [*SENT[:WHEN], empty, *SENT[WHEN + 1 :]]
    assert_same(received, confirmed(sent))
    assert_stamps(received, sent)
    assert world.dropped() == {}


def crowd(stamp_ns: int, number: int) -> Ping:
    rng = np.random.default_rng(5)
    distance = 9000 * np.sqrt(rng.uniform(0.01, 1, number))
    angle = rng.uniform(-np.pi, np.pi, number)
    return Ping(stamp_ns, distance.astype(np.float32), angle.astype(np.float32))


def test_a_scan_of_100_000_detections_is_processed_and_so_are_those_after_it(world):
    boat = Boat(world)
    sent = [*SENT[:6], crowd(SENT[6].stamp_ns, 100_000), *SENT[7:10]]
    received = boat.send(sent)
    assert_same(received, confirmed(sent))
    figures = world.figures()
    assert int(figures["detections"]) == sum(len(ping.range) for ping in sent)
    assert not [key for key in figures if key.startswith("dropped.")]


def test_a_scan_above_max_detections_is_dropped(world):
    boat = Boat(world, max_detections=500)
    received = boat.send(SENT[:WHEN])
    boat.driver.ping(crowd(between(SENT), 501))
    received += boat.send(SENT[WHEN:])
    assert world.dropped() == {"too_many_detections": 1}
    world.until_logged("501 detections", "max_detections = 500", level=WARN)
    assert_same(received, confirmed(SENT))


@pytest.mark.parametrize(
    ("back_ns", "reason"),
    [
        pytest.param(0, "scan_same_stamp", id="equal"),
        pytest.param(1_000, "scan_late", id="a_microsecond"),
        pytest.param(12 * SECOND, "scan_late", id="the_stamp_before"),
        pytest.param(36 * SECOND, "scan_late", id="the_first_stamp"),
        pytest.param(60 * SECOND, "scan_late", id="just_no_restart"),
    ],
)
def test_a_stamp_that_is_not_later_is_dropped_and_counted(world, back_ns, reason):
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    late = replace(SENT[0], stamp_ns=SENT[WHEN - 1].stamp_ns - back_ns)
    boat.driver.ping(late)
    received += boat.send(SENT[WHEN:])
    assert world.dropped() == {reason: 1}
    world.until_logged("not later than the last", level=WARN)
    assert_same(received, confirmed(SENT))


def test_a_jump_far_back_starts_over_once(world):
    boat = Boat(world, restart_jump=30.0)
    first = boat.send(SENT[:9])
    again = pings(12, seed=2, start_ns=START_NS - 5000 * SECOND)
    second = boat.send(again)
    assert_same(first, confirmed(SENT[:9]))
    assert_same(second, confirmed(again))
    assert_stamps(second, again)
    assert world.dropped() == {}
    assert len([line for line in world.logged(WARN) if "state reset" in line]) == 1


def test_a_short_loop_starts_over_after_a_few_late_scans(world):
    boat = Boat(world)
    sent = pings(10, period=4.0)
    boat.send(sent)
    for ping in sent:
        boat.driver.ping(ping)
    world.until_logged("state reset")
    late = world.dropped()
    assert late.keys() == {"scan_late"} and late["scan_late"] <= 3
    rest = sent[late["scan_late"] :]
    assert_same(boat.take(len(rest), len(sent)), confirmed(rest))


def test_a_jump_far_back_ends_the_tracks_held(world):
    boat = Boat(world)
    current = world.listen(PointCloud2, "tracks/current")
    world.until_connected()
    boat.send(SENT)
    boat.send(pings(2, start_ns=START_NS - 5000 * SECOND))
    world.until(lambda: len(current) == len(SENT) + 2, "the current tracks")
    assert current[-3].width > 0
    assert current[-2].width == 0


@pytest.mark.parametrize(
    ("stamp", "reason"),
    [
        (0, "stamp_not_set"),
        (START_NS - 5000 * SECOND, "scan_far_back"),
        (-(2**31) * SECOND, "scan_far_back"),
    ],
    ids=["not set", "far back", "the first there is"],
)
def test_a_single_stamp_far_back_costs_only_its_own_ping(world, stamp, reason):
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    boat.driver.ping(replace(SENT[0], stamp_ns=stamp))
    received += boat.send(SENT[WHEN:])
    assert_same(received, confirmed(SENT))
    assert world.dropped() == {reason: 1}


def test_a_gap_longer_than_the_window_drops_potential_tracks(world):
    boat = Boat(world)
    before = SENT[:4]
    after = pings(12, start_ns=before[-1].stamp_ns + 97 * SECOND)
    received = boat.send([*before, *after])
    assert_same(received, [[]] * 4 + confirmed(after))
    world.until_logged("long gap")


def test_a_missing_ping_is_no_gap(world):
    boat = Boat(world)
    sent = [ping for index, ping in enumerate(SENT) if index not in (4, 5, 6)]
    assert_same(boat.send(sent), confirmed(sent))
    assert not [line for line in world.logged() if "gap" in line]


def test_the_longest_gap_may_be_given(world):
    boat = Boat(world, max_gap=20.0)
    sent = [ping for index, ping in enumerate(SENT) if index != 2]
    received = boat.send(sent)
    assert_same(received, [[]] * 2 + confirmed(sent[2:]))


ODD_STAMPS = {
    "zero": 0,
    "before_1970": -(10**6) * SECOND - 1,
    "the_first_there_is": -(2**31) * SECOND,
    "a_nanosecond": 1,
    "the_last_there_is": (2**31 - 1) * SECOND - 300 * SECOND,
}


@pytest.mark.parametrize("start_ns", ODD_STAMPS.values(), ids=ODD_STAMPS)
def test_any_stamp_may_be_the_first(world, start_ns):
    boat = Boat(world)
    sent = pings(start_ns=start_ns)
    received = boat.send(sent)
    assert_same(received, confirmed(sent))
    assert_stamps(received, sent)


def test_a_first_ping_without_a_stamp_does_not_spoil_those_with_one(world):
    boat = Boat(world)
    boat.send(pings(1, seed=2, start_ns=0))
    assert_same(boat.send(SENT), confirmed(SENT))


def test_after_one_absurd_stamp_good_scans_start_over_at_most_once(world):
    boat = Boat(world)
    boat.send(SENT[:WHEN])
    absurd = message(SENT[WHEN])
    absurd.header.stamp.sec = 2**31 - 1
    boat.driver.publisher.publish(absurd)
    after = SENT[WHEN + 1 :]
    for ping in after:
        boat.driver.ping(ping)
    last = after[-1].stamp_ns
    world.until(
        lambda: boat.tracks[-1].header.stamp.sec == last // SECOND, "the last good scan's tracks"
    )
    assert_same(boat.tracks[-len(after) :], confirmed(after))


ABSURD = {
    "range": {"range": 1e300},
    "azimuth": {"azimuth": 1e300},
    "range_std": {"range_std": 1e300},
    "azimuth_std": {"azimuth_std": 1e3},
    "time_offset": {"time_offset": 1e300},
}


@pytest.mark.parametrize("name", ABSURD)
def test_a_finite_but_absurd_value_costs_no_track_of_others(world, name):
    boat = Boat(world)
    boat.send(SENT[:WHEN])
    spoilt = {
        key: np.append(values.astype(float), ABSURD[name].get(key, USUAL[key]))
        for key, values in with_optional(SENT[WHEN], ABSURD[name]).items()
    }
    boat.driver.publisher.publish(cloud(SENT[WHEN].stamp_ns, spoilt, datatype=PointField.FLOAT64))
    boat.send(SENT[WHEN + 1 :])
    x = [point["x"] for one in boat.tracks[:9] for point in points(one)]
    assert any(2900 < value < 3500 for value in x), "the target that was there all along"
    assert "internal_error" not in world.dropped()


def test_drops_add_up_by_reason(world):
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    for case in UNUSABLE.values():
        bad = message(replace(SENT[WHEN], stamp_ns=between(SENT)))
        case.spoil(bad)
        boat.driver.publisher.publish(bad)
    received += boat.send(SENT[WHEN:])
    assert world.dropped() == Counter(case.reason for case in UNUSABLE.values())
    assert_same(received, confirmed(SENT))


@pytest.mark.parametrize("nanosec", [10**9, 2**32 - 1])
@pytest.mark.parametrize("sec", [SENT[WHEN].stamp_ns // SECOND, 2**31 - 1], ids=["now", "last"])
def test_a_stamp_that_no_clock_gives_is_dropped_and_counted(world, sec, nanosec):
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    bad = message(SENT[WHEN])
    bad.header.stamp.sec, bad.header.stamp.nanosec = sec, nanosec
    boat.driver.publisher.publish(bad)
    world.until(lambda: world.dropped().get("stamp_invalid") == 1, "the drop")
    assert_same([*received, *boat.send(SENT[WHEN:])], confirmed(SENT))
    assert world.dropped() == {"stamp_invalid": 1}
