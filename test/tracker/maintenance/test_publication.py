"""Held tracks that are not published: they claim their detections and nobody hears of them."""

import numpy as np
from support.builders import detections
from support.held import P_D, published, step, tracks

from tsepm_ros.tracker.maintenance.stationary import SpeedPrior
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.tracks import TrackArrays

SLOW = SpeedPrior(8.0, 10.0)
"""Under this prior the tracks of `support.held`, at 5 m/s, count as standing still."""


def holding(*track_ids: int, prior: SpeedPrior = SLOW, hold_time: float = 1e6) -> TrackMaintenance:
    hold = TrackMaintenance(hold_time, speed_prior=prior)
    hold.add(tracks(*track_ids), 0.9)
    return hold


def echoes(hold: TrackMaintenance) -> list[int]:
    return [echo.track_id for echo in hold.fixed_echoes]


def test_what_is_held_back_claims_its_detections_as_every_held_track_does():
    back, shown = holding(1), holding(1, prior=SpeedPrior())
    assert (published(back), published(shown)) == ([], [1])
    scan = detections([[2060.0, 1000.0], [2000.0, 9000.0]], 12.0)
    np.testing.assert_array_equal(step(back, 12.0, scan, P_D), step(shown, 12.0, scan, P_D))
    for one, other in zip(back.held_association, shown.held_association, strict=True):
        np.testing.assert_array_equal(one, other)
    assert back.held_association.probability[0] > 0.9
    assert (published(back), echoes(back)) == ([], [1])


def test_the_end_of_what_was_never_published_is_not_told():
    hold = holding(1, 2, hold_time=30.0)
    for scan in range(1, 60):
        step(hold, 12.0 * scan, detectable=P_D)
        assert hold.ended == {}
    assert len(hold.held) == 0
    hold = holding(1)
    hold.clear()
    step(hold, 1.0)
    assert hold.ended == {}


def test_min_speed_does_not_take_back_what_was_published():
    hold = holding(1, prior=SpeedPrior())
    hold.speed_prior = SLOW
    step(hold, 12.0)
    assert (published(hold), echoes(hold)) == ([1], [])
    assert hold.current.stationary_probability[0] > 0.5


def test_what_exists_hardly_is_neither_published_nor_a_fixed_echo():
    hold = TrackMaintenance(1e6, speed_prior=SLOW)
    hold.add(tracks(1), 0.3)
    assert echoes(hold) == []
    hold.speed_prior = SpeedPrior()
    step(hold, 1.0)
    assert (published(hold), len(hold.held)) == ([], 1)


def test_a_downstream_tracker_does_not_decline_what_it_never_heard_of():
    hold = holding(1)
    for stamp in np.arange(10.0, 160.0, 10.0):
        step(hold, stamp, detections([[2000.0 + 5.0 * stamp, 1000.0]], stamp, 400.0), P_D)
        if stamp in (10.0, 80.0, 150.0):
            hold.follow(stamp, TrackArrays.of([]))
    assert len(hold.held) == 1
    # Its time begins when the track is published.
    hold.speed_prior = SpeedPrior()
    step(hold, 160.0, detections([[2800.0, 1000.0]], 160.0, 400.0), P_D)
    assert published(hold) == [1]
    hold.follow(200.0, TrackArrays.of([]))
    assert published(hold) == [1]
    hold.follow(230.0, TrackArrays.of([]))
    assert published(hold) == []


def test_what_a_downstream_tracker_lists_is_published():
    hold = holding(1)
    hold.follow(5.0, tracks(1, 7, stamp=5.0))
    assert published(hold) == [1, 7]
    step(hold, 6.0)
    assert len(hold.released) == 0


def test_a_fixed_echo_outside_the_coverage_is_remembered_as_it_is():
    hold = holding(1)
    for stamp in range(12, 61, 12):
        step(hold, stamp, detections([[2000.0, 1000.0]], stamp, 400.0), P_D)
    before = hold.fixed_echoes
    for stamp in range(72, 6000, 12):
        step(hold, stamp, detectable=0.0)
    after = hold.fixed_echoes
    assert after.track_id.tolist() == [1]
    np.testing.assert_allclose(after.state, before.state, rtol=1e-9)
    np.testing.assert_allclose(after.covariance, before.covariance, rtol=1e-6)


def test_min_speed_off_does_not_publish_places_that_are_remembered_outside_the_coverage():
    hold = holding(1)
    for stamp in range(12, 61, 12):
        step(hold, stamp, detections([[2000.0, 1000.0]], stamp, 400.0), P_D)
    step(hold, 72.0, detectable=0.0)
    assert echoes(hold) == [1]
    hold.speed_prior = SpeedPrior()
    step(hold, 84.0, detectable=0.0)
    assert len(hold.released) == len(hold.current) == len(hold.held) == 0


def test_an_existence_that_is_not_known_leaves_the_others_their_probability_to_stand_still():
    fits = holding(1, 2, 3).held.fits
    alone = fits[np.array([0, 1])].stationary_probability(SLOW, np.array([0.9, 0.8]))
    found = fits.stationary_probability(SLOW, np.array([0.9, 0.8, np.nan]))
    np.testing.assert_allclose(found[:2], alone)
