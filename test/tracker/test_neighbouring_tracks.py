"""Detections of tracks beside older ones: they do not show that targets have several detections."""

from __future__ import annotations

import numpy as np

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker import plot_extraction
from tsepm_ros.tracker.clustering import placed
from tsepm_ros.tracker.maintenance.stationary import StraightFits
from tsepm_ros.tracker.plot_extraction import BESIDE, DEVIATIONS, of_neighbours
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

SENSOR = SensorModel(max_range=300.0, range_std=0.3, range_std_fraction=0.0, azimuth_std=0.001)


def tracks(*places: tuple[float, float], apart: float = 1.0) -> TrackArrays:
    """Tracks of which each moves faster than the one before, by a speed in m/s."""
    return TrackArrays.of(
        [
            ConfirmedTrack(
                track_id=number,
                stamp=0.0,
                state=np.array([x, apart * number, y, 0.0]),
                covariance=np.diag([0.25, 0.01, 0.25, 0.01]),
                hits=((0, 0),),
                evaluation=0.0,
            )
            for number, (x, y) in enumerate(places)
        ]
    )


def fits(held: TrackArrays) -> StraightFits:
    return StraightFits.of(held.state, held.covariance)


def flagged(places: list[tuple[float, float]], held: TrackArrays, **more) -> list[bool]:
    x, y = np.array(places).T
    scan = Scan(0.0, np.hypot(x, y), np.arctan2(y, x), **more)
    return of_neighbours(scan, placed(scan), held, fits(held), SENSOR).tolist()


def test_of_two_side_by_side_the_younger_ones_detection_is_left_out():
    held = tracks((100.0, 0.0), (100.0, 5.0))
    assert flagged([(100.0, 5.1), (100.2, 0.0), (100.0, 40.0)], held) == [True, False, False]


def test_tracks_that_move_together_may_be_of_one_target():
    held = tracks((100.0, 0.0), (100.0, 5.0), apart=0.3)  # two standard deviations
    assert not any(flagged([(100.0, 5.1), (100.2, 0.0)], held))


def test_slow_motion_shows_in_the_fits_where_the_tracks_allow_for_manoeuvres():
    held = tracks((100.0, 0.0), (100.0, 5.0), apart=0.3)
    known = StraightFits.of(held.state, held.covariance / 9.0)  # six standard deviations
    scan = Scan(0.0, [np.hypot(100.0, 5.1)], [np.arctan2(5.1, 100.0)])
    assert of_neighbours(scan, placed(scan), held, known, SENSOR).all()


def test_places_are_those_of_the_fixed_frame():
    pose = np.array([[10.0, -20.0, 0.5]])
    held = tracks((100.0, 0.0), (100.0, 5.0))
    x, y = np.array([(100.0, 5.1), (100.2, 0.0)]).T
    range_ = np.hypot(x - 10.0, y + 20.0)
    azimuth = np.arctan2(y + 20.0, x - 10.0) - 0.5
    scan = Scan(0.0, range_, azimuth, sensor_pose=pose[0])
    assert of_neighbours(scan, placed(scan), held, fits(held), SENSOR).tolist() == [True, False]
    empty = Scan(0.0, [], [])
    assert not len(of_neighbours(empty, placed(empty), held, fits(held), SENSOR))


def test_a_second_detection_of_a_track_stays():
    held = tracks((100.0, 0.0), (100.0, 5.0))
    assert flagged([(100.0, 5.1), (100.0, 5.6), (100.0, 0.0)], held) == [True, False, False]


def test_tracks_far_from_every_older_one_keep_their_detections():
    far = BESIDE + 1.0
    held = tracks((100.0, 0.0), (100.0, far), (100.0, 2.0 * far))
    assert not any(flagged([(100.0, 0.0), (100.0, far), (100.0, 2.0 * far)], held))
    assert not any(flagged([(100.0, 0.0), (100.0, 5.0)], tracks((100.0, 0.0))))


def test_a_detection_is_a_tracks_within_its_errors():
    error = np.sqrt(2.0 * 0.5**2 + 0.3**2 + 0.1**2)
    held = tracks((100.0, 0.0), (100.0, 20.0))
    near, far = 20.0 + 0.98 * DEVIATIONS * error, 20.0 + 1.05 * DEVIATIONS * error
    assert flagged([(100.0, near)], held) == [True]
    assert flagged([(100.0, far)], held) == [False]
    assert flagged([(100.0, far)], held, range_std=[1.0]) == [True], "its own errors"


def test_of_very_many_tracks_the_first_are_compared(monkeypatch):
    held = tracks((100.0, 0.0), (100.0, 5.0), (100.0, 10.0))
    monkeypatch.setattr(plot_extraction, "MOST_TRACKS", 2)
    assert flagged([(100.0, 5.0), (100.0, 10.0)], held) == [True, False]
