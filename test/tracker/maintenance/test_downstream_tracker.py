"""What a downstream tracker lists replaces what is held, as long as it is heard."""

import numpy as np
import pytest
from support.builders import detections
from support.held import MAX_SPEED, P_D, holding, ids, step, tracks

from tsepm_ros.tracker.maintenance.external_tracker import ExternalTracker
from tsepm_ros.tracker.maintenance.track_maintenance import (
    TrackMaintenance,
)


def follow_tracker(hold: TrackMaintenance, stamp: float, *listed: int) -> None:
    """The downstream tracker lists tracks where `tracks` has them after the time."""
    hold.follow(stamp, tracks(*listed, stamp=stamp, x=2000.0 + 5.0 * stamp))


def test_a_tracker_that_comes_back_empty_gets_time_to_list_what_is_held():
    hold = holding()
    follow_tracker(hold, 0.0, 1, 2)
    step(hold, 100.0)
    follow_tracker(hold, 100.0)
    step(hold, 112.0)
    assert (hold.tracker, ids(hold)) == (ExternalTracker.ALIVE, [1, 2])
    follow_tracker(hold, 112.0, 2)
    follow_tracker(hold, 160.1, 2)
    step(hold, 161.0)
    assert (list(hold.ended), ids(hold)) == ([1], [2])


def test_clearing_forgets_the_tracker():
    hold = holding()
    follow_tracker(hold, 0.0, 1)
    hold.clear()
    step(hold, 1.0)
    assert (list(hold.ended), hold.tracker) == ([1], ExternalTracker.NONE)
    step(hold, 100.0)
    assert hold.tracker is ExternalTracker.NONE, "it cannot fall silent"
    hold.add(tracks(2, stamp=100.0), 0.9)
    follow_tracker(hold, 101.0)
    step(hold, 112.0)
    assert ids(hold) == [2]


def test_tracked_targets_known_as_exactly_as_is_taken_do_no_harm():
    hold, rng = holding(), np.random.default_rng(4)
    axis = np.array([[1.0, 1.0 - 1e-11], [1.0 - 1e-11, 1.0]])
    for scan in range(200):
        told = tracks(*range(8), stamp=12.0 * scan)
        told.covariance[:] = np.kron(np.eye(2), axis) * 10.0 ** rng.uniform(-12, 18, (8, 1, 1))
        hold.follow(12.0 * scan + rng.uniform(-20, 20), told)
        found = detections(told.state[:, 0::2] + rng.standard_normal((8, 2)), 12.0 * scan, 1e-12)
        assert np.isfinite(step(hold, 12.0 * scan + 1e-3, found, P_D)).all()
        assert np.isfinite(hold.current.covariance).all()
        assert np.isfinite(hold.held.existence).all()
    assert len(ids(hold)) == 8


def test_the_speed_of_what_a_tracker_lists_is_its_own_until_it_is_silent():
    hold, fast = holding(1), tracks(1)
    fast.state[:, 1] = 30.0
    fast.covariance[:] = np.diag([5.0, 0.5, 5.0, 0.5]) ** 2
    for stamp in (0.0, 12.0):
        hold.follow(stamp, fast.predicted(stamp))
        step(hold, stamp + 6.0)
        assert hold.current.state[0, 1] == pytest.approx(30.0, abs=0.1)
    step(hold, 100.0)
    assert hold.tracker is ExternalTracker.SILENT
    assert 9.0 < np.hypot(*hold.current.state[0, 1::2]) <= MAX_SPEED
