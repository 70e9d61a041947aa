"""Messages of different content become one scan."""

import dataclasses
import math

import numpy as np
import pytest
from support.sweeps import FIRST, RADAR, START_NS, STEP, beam, fan, read

from tsepm_ros import Scan
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.sweep import joined

RICH = SensorScan(
    Scan(
        11.0,
        [100.0, 200.0],
        [0.1, 0.1],
        range_std=[3.0, 4.0],
        azimuth_std=[0.2, 0.3],
        time_offset=[0.1, 0.2],
        features={"intensity": [5.0, 6.0]},
        group=[4, -1],
    ),
    "radar",
    transmit_offset=np.array([0.01, 0.02]),
    height=np.array([-1.0, -2.0]),
)
PLAIN = SensorScan(Scan(10.5, [300.0], [0.05], features={"range_rate": [2.0]}), "radar")


def test_what_one_message_has_and_the_other_does_not():
    one = joined([PLAIN, RICH, beam(12.0, 0.2)], RADAR, None)
    scan = one.scan
    assert (scan.stamp, one.frame_id) == (10.5, "radar")
    assert scan.range.tolist() == [300.0, 100.0, 200.0]
    assert scan.range_std == pytest.approx([1.0, 3.0, 4.0])
    assert scan.azimuth_std == pytest.approx([0.01, 0.2, 0.3])
    assert scan.time_offset == pytest.approx([0.0, 0.6, 0.7])
    assert one.transmit_offset == pytest.approx([0.0, 0.51, 0.52])
    assert one.height == pytest.approx([0.0, -1.0, -2.0])
    assert scan.features["intensity"] == pytest.approx([math.nan, 5.0, 6.0], nan_ok=True)
    assert scan.features["range_rate"] == pytest.approx([2.0, math.nan, math.nan], nan_ok=True)
    assert scan.group[0] == scan.group[2] == -1
    assert scan.group[1] >= 0
    Scan(**{name: value for name, value in vars(scan).items() if value is not None})  # is allowed


def test_empty_messages_are_an_empty_scan():
    one = joined([beam(1.0, 0.1), beam(2.0, 0.2)], RADAR, np.array([0.0, 0.3]))
    assert (len(one.scan), one.scan.stamp) == (0, 1.0)
    assert one.scan.swept.tolist() == [0.0, 0.3]


@pytest.mark.parametrize("size", [1, 2, 3, 5, 30])
def test_runs_of_rays_go_on_from_message_to_message(size):
    """The groups of one message with all rays are those of its parts."""
    rng = np.random.default_rng(size)
    for _ in range(20):
        ranges = np.cumsum(rng.choice([0.0, 0.2, 30.0, -40.0], 30)) + 300.0
        ranges[rng.random(30) < 0.2] = np.inf
        expected = read(fan(START_NS, FIRST, ranges)).scan.group
        parts = [
            read(fan(START_NS + place * 10**6, FIRST + place * STEP, ranges[place : place + size]))
            for place in range(0, 30, size)
        ]
        exact = dataclasses.replace(RADAR, range_std=1e-6)
        group = joined(parts, exact, None).scan.group
        assert np.array_equal(group[:, None] == group, expected[:, None] == expected)


def test_messages_that_are_apart_share_no_run():
    near = [read(fan(START_NS + n, FIRST + 5 * n * STEP, [100.0])) for n in range(3)]
    assert len(set(joined(near, RADAR, None).scan.group)) == 3
    unknown = [dataclasses.replace(each, beams=None) for each in near]
    assert len(set(joined(unknown, RADAR, None).scan.group)) == 3
