"""How the benchmark of ends counts: a target's tracks until the last of them is out."""

import math

import endings
import numpy as np
import pytest
from endings_scenes import Case, Watched, pinged, watched

from tsepm_ros import ConfirmedTrack, Scan, SensorModel, make_initiator
from tsepm_ros.tracker.tracks import TrackArrays

SENSOR = SensorModel(max_range=100.0)
EMPTY = Scan(0.0, [], [])


def tracks(**places: float) -> TrackArrays:
    """Tracks on the x axis, by id, with a deviation of 1 m across and 2 m along."""
    covariance = np.diag([4.0, 1.0, 1.0, 1.0])
    return TrackArrays.of(
        [
            ConfirmedTrack(int(name[1:]), 0.0, np.array([x, 1.0, 0.0, 0.0]), covariance, (), 0.0)
            for name, x in places.items()
        ]
    )


@pytest.fixture
def seen():
    return Watched(make_initiator("score", sensor=SENSOR))


def test_a_track_is_out_with_the_ping_after_the_last_that_has_it_even_if_it_was_absent(seen):
    place = np.array([40.0, 0.0])
    for current in (tracks(n3=41.0), tracks(n3=41.0, n4=39.0)):
        seen.take(EMPTY, place, current)
    for current in (tracks(n3=41.0), tracks(), tracks(n4=60.0), tracks(n5=40.0)):
        seen.take(EMPTY, None, current)
    assert seen.pings_until_out() == 4
    assert seen.ids() == [3]
    assert seen.of_tracks()["elsewhere"] == 1


def test_a_target_without_a_track_at_its_end_has_no_pings_until_out(seen):
    seen.take(EMPTY, np.array([40.0, 0.0]), tracks(n3=80.0))
    seen.take(EMPTY, None, tracks(n3=80.0))
    assert math.isnan(seen.pings_until_out())


def test_the_axis_is_compared_with_five_errors_of_a_detection_and_a_quarter_of_the_range(seen):
    seen.take(EMPTY, None, tracks(n1=50.0))
    figures = seen.of_tracks()
    assert figures["axis / limit"] == pytest.approx(2.0 / (5.0 * 50.0 * math.radians(1.0)))
    assert figures["axis / quarter"] == pytest.approx(2.0 / 25.0)


def test_no_detection_is_beyond_the_coverage_nor_a_false_one_in_the_dark():
    sensor, rng = Case("stays", 0.1, 0.0, 0.9, 0).sensor, np.random.default_rng(1)
    scan = pinged(0.0, np.array([[101.0, 0.0], [50.0, 0.0]]), 300.0, sensor, rng, dark=(0.1, 0.5))
    assert sensor.covers(scan.range, scan.azimuth).all()
    assert not ((scan.azimuth > 0.1) & (scan.azimuth < 0.6)).any()


@pytest.mark.parametrize("scene", endings.SCENES)
def test_the_target_of_each_scene_is_there_as_long_as_the_scene_says(scene):
    seen = watched(Case(scene, 12.0, 0.0, 0.9, 1))
    there = 400 if scene in ("stays", "silent") else 170 if scene == "shadow" else 100
    assert sum(seen.there) == there


def test_a_value_that_is_not_there_fails_its_bound():
    assert endings.fails(math.nan, "<= 3")
    assert not endings.fails(3.0, "<= 3")
    assert endings.fails(0.9, ">= 0.95")
    assert not endings.fails(math.nan, "")
