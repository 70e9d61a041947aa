"""Detections of tracks beside older ones: they do not show that targets have several detections."""

import numpy as np

from tsepm_ros import SensorModel
from tsepm_ros.numerics.arrays import changed
from tsepm_ros.tracker.clusters import extended_targets
from tsepm_ros.tracker.clusters.extended_targets import BESIDE, of_neighbours
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.maintenance.data_association import OwnDetections
from tsepm_ros.tracker.maintenance.stationary import StraightFits
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


def flagged(held: TrackArrays, fitted: StraightFits | None = None) -> list[bool]:
    """Of four detections, of which each track has one."""
    table = changed(ConfirmedTracks.of(held, 1.0), fits=fitted or fits(held))
    own = OwnDetections(held.track_id, np.arange(len(held)))
    return of_neighbours(4, own, table, SENSOR).tolist()


def test_of_two_side_by_side_the_younger_ones_detection_is_left_out():
    held = tracks((100.0, 0.0), (100.0, 5.0))
    assert flagged(held) == [False, True, False, False]


def test_tracks_that_lie_and_move_together_may_be_of_one_target():
    held = tracks((100.0, 0.0), (100.0, 1.0), apart=0.3)  # two standard deviations
    assert not any(flagged(held))


def test_tracks_that_move_together_apart_are_two_targets():
    assert flagged(tracks((100.0, 0.0), (100.0, 5.0), apart=0.0)) == [False, True, False, False]


def test_slow_motion_shows_in_the_fits_where_the_tracks_allow_for_manoeuvres():
    held = tracks((100.0, 0.0), (100.0, 0.1), apart=0.3)
    known = StraightFits.of(held.state, held.covariance / 9.0)  # six standard deviations
    assert flagged(held, known) == [False, True, False, False]


def test_tracks_far_from_every_older_one_keep_their_detections():
    far = BESIDE + 1.0
    assert not any(flagged(tracks((100.0, 0.0), (100.0, far), (100.0, 2.0 * far))))


def test_of_very_many_tracks_the_first_are_compared(monkeypatch):
    held = tracks((100.0, 0.0), (100.0, 5.0), (100.0, 10.0))
    monkeypatch.setattr(extended_targets, "MOST_TRACKS", 2)
    assert flagged(held) == [False, True, False, False]
