"""Land on a chart: which detections are left out, and what that changes."""

import math

import numpy as np
import pytest
from support.builders import assert_same_tracks

from tsepm_ros import LandMask, Scan, SensorModel, make_initiator
from tsepm_ros.methods.registry import available_methods
from tsepm_ros.tracker.clutter import fixed_places as module
from tsepm_ros.tracker.scan import placed

SENSOR = SensorModel(range_std=5.0, range_std_fraction=0.0, max_range=2000.0)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_a_place_is_on_land_where_its_cell_is(yaw):
    """Against a loop over the cells, each of which knows its own places."""
    rng = np.random.default_rng(1)
    occupied = rng.random((7, 13)) < 0.4
    mask = LandMask(occupied, 2.5, (100.0, -40.0, yaw))
    assert mask.cells == occupied.sum()
    assert mask.area == pytest.approx(6.25 * occupied.sum())
    along, across = (
        np.array([math.cos(yaw), math.sin(yaw)]),
        np.array([-math.sin(yaw), math.cos(yaw)]),
    )
    for row, column in np.ndindex(occupied.shape):
        u, v = rng.uniform(0.01, 0.99, (2, 5))
        places = np.array([100.0, -40.0])
        places = places + 2.5 * ((column + u)[:, None] * along + (row + v)[:, None] * across)
        assert mask.covers(places).tolist() == [bool(occupied[row, column])] * 5
    outside = np.array([[-0.1, 3.0], [13.1, 3.0], [5.0, -0.1], [5.0, 7.1]]) * 2.5
    assert not mask.covers(np.array([100.0, -40.0]) + outside @ np.stack([along, across])).any()
    assert not mask.covers(np.array([[1e300, 0.0], [-1e300, 1e300]])).any()


def test_detections_are_judged_where_they_are_in_the_fixed_frame():
    mask = LandMask([[True]], 10.0, (95.0, 45.0, 0.0))
    scan = Scan(0.0, [50.0, 50.0, 50.0], [0.0, -1.0, 2.0], sensor_pose=(100.0, 0.0, math.pi / 2))
    assert mask.covers(placed(scan)).tolist() == [True, False, False]
    poses = [(100.0, 0.0, math.pi / 2), (50.0, 50.0, 1.0), (0.0, 0.0, 0.0)]
    scan = Scan(0.0, [50.0, 50.0, 50.0], [0.0, -1.0, 2.0], sensor_pose=poses)
    assert mask.covers(placed(scan)).tolist() == [True, True, False]


BAD = {
    "resolution": (math.nan, 0.0, -1.0, math.inf, 1e-9, 1e7),
    "origin": ((math.nan, 0, 0), (0, math.inf, 0), (0, 0, math.nan), (1e12, 0, 0), (0, 0)),
    "occupied": ([True, False], np.zeros((1, 1, 1))),
}


@pytest.mark.parametrize(
    ("name", "value"), [(name, value) for name, values in BAD.items() for value in values]
)
def test_a_chart_that_is_none_is_refused(name, value):
    good = {"occupied": [[True]], "resolution": 1.0, "origin": (0.0, 0.0, 0.0)}
    with pytest.raises(ValueError, match=f"^{name} "):
        LandMask(**{**good, name: value})


def test_a_chart_is_bounded():
    wide = np.broadcast_to(np.array(False), (20_000, 20_000))  # takes no memory
    with pytest.raises(ValueError, match=r"^occupied must have two axes and at most"):
        LandMask(wide, 1.0)
    assert module.MAX_CELLS <= 1e8


def scans(number: int, *, quay: bool, seed: int = 2):
    """A target that sails past, clutter, and a quay 500 m east that echoes."""
    rng, of_the_quay = np.random.default_rng(seed), np.random.default_rng(seed + 1)
    for k in range(number):
        places = [(1000.0 - 20.0 * k, 800.0 + 2.0 * rng.standard_normal())]
        places += rng.uniform(-400.0, 400.0, (3, 2)).tolist()
        if quay:
            places += [(500.0 + of_the_quay.uniform(0.0, 3.0), 7.0 * n) for n in range(-5, 6)]
        x, y = np.array(places).T
        yield Scan(4.0 * k, np.hypot(x, y), np.arctan2(y, x))


@pytest.mark.parametrize("method", available_methods())
def test_with_its_chart_a_quay_changes_nothing(method):
    """Every method gives, to the bit, what it gives without the echoes of the quay."""
    mask = LandMask(np.ones((100, 20)), 1.0, (490.0, -50.0, 0.0))
    one, other = (
        make_initiator(method, sensor=SENSOR, land=mask),
        make_initiator(method, sensor=SENSOR),
    )
    for with_quay, without in zip(scans(12, quay=True), scans(12, quay=False), strict=True):
        assert_same_tracks(one.process(with_quay), other.process(without))
        assert_same_tracks(one.current, other.current)
        statistics = one.statistics
        assert (statistics.detections, statistics.outside_coverage) == (4, 0)
        assert statistics.on_land == 11
    assert one.totals.on_land == 12 * 11


def test_a_hit_counts_the_scan_s_own_detections():
    """Left out or not, what is on land keeps its index."""
    mask = LandMask(np.ones((100, 20)), 1.0, (490.0, -50.0, 0.0))
    initiator = make_initiator("tsepm", sensor=SENSOR, land=mask, min_hits=3, window=4)
    tracks = []
    for scan in scans(6, quay=True):
        last = np.arange(len(scan))[::-1]
        turned = Scan(scan.stamp, scan.range[last], scan.azimuth[last])
        tracks += initiator.process(turned)
    assert {row for track in tracks for _, row in track.hits} == {14}


def test_land_beyond_the_coverage_is_outside():
    mask = LandMask(np.ones((1, 1)), 1e4, (0.0, 0.0, 0.0))
    initiator = make_initiator("score", sensor=SENSOR, land=mask)
    initiator.process(Scan(0.0, [100.0, 9000.0, 100.0], [0.5, 0.5, -0.5]))
    statistics = initiator.statistics
    assert (statistics.detections, statistics.on_land, statistics.outside_coverage) == (1, 1, 1)
