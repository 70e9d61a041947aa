"""Starts whose majority of hits turns out wrong."""

from dataclasses import replace

import numpy as np
import pytest
from support.builders import AS_GIVEN, scan_at
from support.score_scenes import score

from tsepm_ros import SensorModel
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

SENSOR = SensorModel(range_std=30.0, range_std_fraction=0.0, azimuth_std=0.01, clutter_density=1e-5)
X = 3000.0


def target(k: int) -> tuple[float, float]:
    """A target at 7 m/s along y."""
    return X, 84.0 * k


def test_a_start_on_clutter_and_one_hit_of_a_target_is_corrected_under_its_id():
    # Two detections of clutter lead to the target's first; from there it goes another way.
    clutter = {0: (X - 170.0, 0.0), 1: (X - 85.0, 0.0)}
    initiator = score(SENSOR, false_tracks_per_hour=100.0, **AS_GIVEN)
    started, revised = [], []
    for k in range(9):
        seen = [clutter[k]] if k in clutter else [target(k - 2)]
        started += initiator.process(scan_at(12.0 * k, seen))
        revised += [(k, track) for track in initiator.revised]
    assert [len(set(track.hits) & {(0, 0), (1, 0), (2, 0)}) for track in started] == [3]
    assert [track.revision for _, track in revised] == [1]
    ((k, track),) = revised
    assert track.track_id == started[0].track_id
    assert len(track.hits) >= 3
    assert {scan for scan, _ in track.hits} <= set(range(2, k + 1))
    np.testing.assert_allclose(track.position, target(k - 2), atol=40.0)
    np.testing.assert_allclose(track.velocity, (0.0, 7.0), atol=1.5)
    (held,) = initiator.current
    assert (held.track_id, held.revision) == (started[0].track_id, 1)


def test_a_target_seen_beside_the_clutter_of_a_track_replaces_it():
    # The clutter meets the target's path, of which two hits are as old as those of the track.
    clutter = {k: (X - 85.0 * (3 - k), 0.0) for k in range(3)}
    initiator = score(SENSOR, false_tracks_per_hour=100.0, **AS_GIVEN)
    started = []
    for k in range(9):
        seen = [clutter[k]] if k in clutter else []
        seen += [target(k - 3)] if k >= 1 else []
        started += initiator.process(scan_at(12.0 * k, seen))
        assert len(initiator.revised) == 0
    assert [set(track.hits) <= {(0, 0), (1, 0), (2, 0)} for track in started] == [True, False]
    assert initiator.current.track_id.tolist() == [started[1].track_id], "it replaces the other"


@pytest.mark.parametrize("turn", [1, 5])
def test_a_target_that_turns_after_its_start_keeps_its_id(turn):
    # The straight path of the hits after the turn has none of those before.
    initiator = score(SENSOR, false_tracks_per_hour=100.0, **AS_GIVEN)
    for k in range(16):
        before, after = min(k, 2 + turn), max(k - 2 - turn, 0)
        seen = [(X - 84.0 * (3 + turn) + 84.0 * before, 84.0 * after)]
        initiator.process(scan_at(12.0 * k, seen))
    assert initiator.totals.confirmed == 1
    assert initiator.current.track_id.tolist() == [0]


@pytest.mark.parametrize("wish", [1.0, 300.0])
def test_hits_are_more_probable_than_not_at_any_rate(wish):
    # Beside each of the target's echoes lies one that fits as well.
    initiator = score(SENSOR, false_tracks_per_hour=wish, **AS_GIVEN)
    found = []
    for k in range(6):
        x, y = target(k)
        seen = [(x, y)] if k not in (1, 2) else [(x + 3.0, y), (x - 3.0, y)]
        found += initiator.process(scan_at(12.0 * k, seen))
    (track,) = found
    assert not {(1, 0), (1, 1)} <= set(track.hits)
    assert {(0, 0), (3, 0)} <= set(track.hits)


@pytest.mark.parametrize("listed", [1, 25])
def test_a_track_of_a_downstream_tracker_has_no_hits_to_doubt(listed):
    initiator = score(SENSOR, false_tracks_per_hour=100.0, **AS_GIVEN)
    rng, covariance = np.random.default_rng(1), np.diag([900.0, 1.0, 900.0, 1.0])
    for k in range(25):
        if k < listed:
            state = np.array([X, 0.0, 84.0 * k, 7.0])
            report = ConfirmedTrack(
                track_id=77,
                stamp=12.0 * k,
                state=state,
                covariance=covariance,
                hits=(),
                evaluation=0.0,
            )
            initiator.maintenance.follow(12.0 * k, TrackArrays.of([report]))
        place = tuple(np.add(target(k), 3.0 * rng.standard_normal(2)))
        assert not len(initiator.process(scan_at(12.0 * k, [place])))
        assert not len(initiator.revised)
    assert initiator.current.track_id.tolist() == [77]


def test_a_track_is_not_corrected_once_its_hits_leave_the_window():
    # The hypotheses with its first hits are deleted then, right or not.
    sensor = replace(SENSOR, clutter_density=1e-6)
    rng = np.random.default_rng([2, 29])
    initiator = score(sensor, false_tracks_per_hour=10.0, **AS_GIVEN)
    for k in range(30):
        seen = []
        if rng.random() < 0.9:
            seen.append(tuple(np.add(target(k), 60.0 * rng.standard_normal(2))))
        clutter = np.array(target(k)) + rng.uniform(-1200.0, 1200.0, (12, 2))
        initiator.process(scan_at(12.0 * k, seen + [tuple(place) for place in clutter]))
        assert not len(initiator.revised)
    assert any(abs(track.position[0] - X) < 400.0 for track in initiator.current)
