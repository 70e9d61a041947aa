"""Bad input: counted, named, and without effect on what comes after it."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField
from support.boat import Boat
from support.expectation import assert_same, assert_stamps, confirmed
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
    "no_azimuth": (rename("azimuth", "phi"), "missing_field"),
    "no_range": (rename("range", "r"), "missing_field"),
    "no_fields": (resize(fields=[]), "missing_field"),
    "azimuth_as_integer": (setting(1, datatype=PointField.INT32), "wrong_datatype"),
    "unknown_datatype": (setting(0, datatype=99), "wrong_datatype"),
    "counted_field": (setting(0, count=2), "wrong_count"),
    "offset_beyond_the_point": (setting(1, offset=6), "bad_offset"),
    "huge_offset": (setting(1, offset=LARGEST), "bad_offset"),
    "two_ranges": (rename("azimuth", "range"), "missing_field"),
    "short_data": (shorten, "short_data"),
    "no_data": (resize(data=b""), "short_data"),
    "short_rows": (resize(row_step=8), "bad_row_step"),
    "no_point_step": (resize(point_step=0), "bad_offset"),
    "huge_width": (resize(width=LARGEST), "bad_row_step"),
    "huge_height": (resize(height=LARGEST), "short_data"),
    "other_frame": (lambda bad: setattr(bad.header, "frame_id", "elsewhere"), "unknown_frame"),
    "no_frame": (lambda bad: setattr(bad.header, "frame_id", ""), "empty_frame"),
}
"""How a good message is spoilt, and what it then counts as."""


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("no_azimuth", "azimuth"),
        ("short_data", "height * row_step"),
        ("other_frame", "'elsewhere'"),
        ("no_frame", "frame_id"),
    ],
)
def test_an_unusable_message_is_dropped_counted_and_named(world, name, said):
    spoil, reason = UNUSABLE[name]
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    bad = message(replace(SENT[WHEN], stamp_ns=between(SENT)))
    spoil(bad)
    boat.driver.publisher.publish(bad)
    boat.driver.publisher.publish(bad)
    received += boat.send(SENT[WHEN:])
    assert world.dropped() == {reason: 2}
    line = world.until_logged(reason, said, level=WARN)
    assert "\n" not in line
    assert len([one for one in world.logged(WARN) if reason in one]) == 1, "throttled"
    status = world.status("detections")
    assert (status.level, status.message) == (b"\x01", f"dropped: 2 {reason}")
    assert_same(received, confirmed(SENT))
    assert_stamps(received, SENT)


@pytest.mark.parametrize("name", ["no_azimuth", "short_data"])
def test_an_unusable_first_message_does_no_harm(world, name):
    spoil, reason = UNUSABLE[name]
    boat = Boat(world)
    bad = message(replace(SENT[0], stamp_ns=START_NS - SECOND))
    bad.header.frame_id = "elsewhere"
    spoil(bad)
    boat.driver.publisher.publish(bad)
    assert_same(boat.send(SENT), confirmed(SENT))
    assert world.dropped() == {reason: 1}


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
    for spoil, _reason in UNUSABLE.values():
        bad = message(replace(SENT[WHEN], stamp_ns=between(SENT)))
        spoil(bad)
        boat.driver.publisher.publish(bad)
    received += boat.send(SENT[WHEN:])
    assert world.dropped() == Counter(reason for _spoil, reason in UNUSABLE.values())
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
