"""Bad input: counted, named, and without effect on what comes after it."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField
from support.boat import Boat
from support.expectation import assert_same, assert_stamps, confirmed
from support.ros_world import WARN
from support.sonar_driver import START_NS, Ping, cloud, pings, points, stamp_ns

SECOND = 10**9
SENT = pings(14)
WHEN = 4
"""The bad message comes after so many good ones, while potential tracks wait for more hits."""


def message(ping: Ping) -> PointCloud2:
    return cloud(ping.stamp_ns, {"range": ping.range, "azimuth": ping.azimuth})


def setting(**values: Any) -> Callable[[PointCloud2], None]:
    def spoil(bad: PointCloud2) -> None:
        for name, value in values.items():
            setattr(bad, name, value)

    return spoil


def field(index: int, **values: Any) -> Callable[[PointCloud2], None]:
    """Change the description of a field: 0 is range, 1 azimuth."""
    return lambda bad: setting(**values)(bad.fields[index])


LARGEST = 2**32 - 1
UNUSABLE = {
    "no_azimuth": (field(1, name="phi"), "missing_field"),
    "no_range": (field(0, name="r"), "missing_field"),
    "no_fields": (setting(fields=[]), "missing_field"),
    "azimuth_as_integer": (field(1, datatype=PointField.INT32), "wrong_datatype"),
    "unknown_datatype": (field(0, datatype=99), "wrong_datatype"),
    "counted_field": (field(0, count=2), "wrong_count"),
    "offset_beyond_the_point": (field(1, offset=6), "bad_offset"),
    "huge_offset": (field(1, offset=LARGEST), "bad_offset"),
    "two_ranges": (field(1, name="range"), "missing_field"),
    "short_data": (lambda bad: setting(data=bad.data[:-1])(bad), "short_data"),
    "no_data": (setting(data=b""), "short_data"),
    "short_rows": (setting(row_step=8), "bad_row_step"),
    "no_point_step": (setting(point_step=0), "bad_offset"),
    "huge_width": (setting(width=LARGEST), "bad_row_step"),
    "huge_height": (setting(height=LARGEST), "short_data"),
    "other_frame": (lambda bad: setting(frame_id="elsewhere")(bad.header), "unknown_frame"),
    "no_frame": (lambda bad: setting(frame_id="")(bad.header), "empty_frame"),
}
"""How a good message is spoilt, and what it then counts as."""
SAID = {
    "missing_field": "azimuth",
    "short_data": "height * row_step",
    "unknown_frame": "'elsewhere'",
    "empty_frame": "frame_id",
}


def spoilt(name: str, stamp_ns: int) -> PointCloud2:
    bad = message(replace(SENT[WHEN], stamp_ns=stamp_ns))
    UNUSABLE[name][0](bad)
    return bad


def test_unusable_messages_are_dropped_counted_and_named_and_cost_nothing_else(world):
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    between = (SENT[WHEN - 1].stamp_ns + SENT[WHEN].stamp_ns) // 2
    for name in UNUSABLE:
        for _ in range(2):
            boat.driver.publisher.publish(spoilt(name, between))
    received += boat.send(SENT[WHEN:])
    expected = Counter(2 * [reason for _, reason in UNUSABLE.values()])
    assert world.dropped() == expected
    for reason, said in SAID.items():
        assert "\n" not in world.until_logged(reason, said, level=WARN)
    for reason in ("wrong_count", "unknown_frame", "empty_frame"):
        assert sum(reason in line for line in world.logged(WARN)) == 1, "said once of two"
    status = world.status("detections")
    assert status.level == b"\x01" and "2 empty_frame" in status.message
    assert_same(received, confirmed(SENT))
    assert_stamps(received, SENT)


def test_an_unusable_first_message_does_no_harm(world):
    boat = Boat(world)
    for name in ("no_azimuth", "short_data"):
        bad = spoilt(name, START_NS - SECOND)
        bad.header.frame_id = "elsewhere"
        boat.driver.publisher.publish(bad)
    assert_same(boat.send(SENT), confirmed(SENT))
    assert world.dropped() == {"missing_field": 1, "short_data": 1}


def test_a_scan_of_100_000_detections_is_processed_and_so_are_those_after_it(world):
    boat, rng = Boat(world), np.random.default_rng(5)
    distance = 9000 * np.sqrt(rng.uniform(0.01, 1, 100_000)).astype(np.float32)
    angle = rng.uniform(-np.pi, np.pi, 100_000).astype(np.float32)
    sent = [*SENT[:6], Ping(SENT[6].stamp_ns, distance, angle), *SENT[7:10]]
    assert_same(boat.send(sent), confirmed(sent))
    assert int(world.figures()["detections"]) == sum(len(ping.range) for ping in sent)
    assert world.dropped() == {}


ABSURD = [
    ("range", 4000.0, 1e300),
    ("azimuth", 0.5, 1e300),
    ("range_std", 45.0, 1e300),
    ("azimuth_std", 0.0175, 1e3),
    ("time_offset", 0.0, 1e300),
]


def test_finite_but_absurd_values_cost_no_track_of_others(world):
    boat = Boat(world)
    ping = SENT[WHEN]
    for name, usual, absurd in ABSURD:
        columns = {"range": ping.range, "azimuth": ping.azimuth}
        columns.setdefault(name, np.full(len(ping.range), usual))
        more = {"range": 4000.0, "azimuth": 0.5, name: absurd}
        columns = {key: np.append(values, more[key]) for key, values in columns.items()}
        boat.send(SENT[:WHEN])
        seen = len(boat.tracks)
        boat.driver.publisher.publish(cloud(ping.stamp_ns, columns, datatype=PointField.FLOAT64))
        boat.send(SENT[WHEN + 1 :])
        world.until(lambda: stamp_ns(boat.tracks[-1]) == SENT[-1].stamp_ns, "the last ping")
        x = [point["x"] for one in boat.tracks[seen:][:6] for point in points(one)]
        assert any(2900 < value < 3500 for value in x), "the target that was there all along"
        assert "internal_error" not in world.dropped()
        world.reset()


def test_a_stamp_that_no_clock_gives_is_dropped_and_counted(world):
    boat = Boat(world)
    received = boat.send(SENT[:WHEN])
    for sec in (SENT[WHEN].stamp_ns // SECOND, 2**31 - 1):
        for nanosec in (10**9, 2**32 - 1):
            bad = message(SENT[WHEN])
            bad.header.stamp.sec, bad.header.stamp.nanosec = sec, nanosec
            boat.driver.publisher.publish(bad)
    assert_same([*received, *boat.send(SENT[WHEN:])], confirmed(SENT))
    assert world.dropped() == {"stamp_invalid": 4}
