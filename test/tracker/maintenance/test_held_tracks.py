"""The table of held tracks: its rows are taken, joined, predicted and replaced together."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from support.held import MAX_SPEED, tracks

from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks, Status
from tsepm_ros.tracker.maintenance.external_tracker import LISTED

PLAIN = (
    *("existence", "visible", "covered_scans", "last_detected", "unlisted_since"),
    *("status", "announced"),
)


def table(*track_ids: int, existence: float = 0.9) -> ConfirmedTracks:
    return ConfirmedTracks.of(tracks(*track_ids), existence)


def assert_same(one: ConfirmedTracks, other: ConfirmedTracks) -> None:
    for field in fields(ConfirmedTracks):
        a, b = getattr(one, field.name), getattr(other, field.name)
        for part in fields(a) if hasattr(a, "__dataclass_fields__") else ():
            np.testing.assert_array_equal(getattr(a, part.name), getattr(b, part.name))
        if isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b)


def test_rows_are_taken_and_joined():
    whole = table(1, 2, 3)
    first, others = whole[np.array([True, False, False])], whole[np.array([1, 2])]
    parts = ConfirmedTracks.joined(first, others)
    assert (len(parts), len(ConfirmedTracks.none())) == (3, 0)
    assert_same(parts, whole)
    assert_same(ConfirmedTracks.joined(ConfirmedTracks.none(), whole), whole)


def test_prediction_carries_every_column_and_changes_no_row_of_the_old_table():
    old = table(1, 2)
    new = old.predicted(12.0, MAX_SPEED, np.zeros(2, bool))
    assert_same(old, table(1, 2))
    assert new.tracks.stamp.tolist() == new.tracks.age.tolist() == [12.0, 12.0]
    np.testing.assert_allclose(new.tracks.state[:, 0], 2060.0)
    np.testing.assert_array_equal(new.tracks.state, new.models.combined()[0])
    kept = old.predicted(12.0, MAX_SPEED, np.ones(2, bool))
    np.testing.assert_array_equal(kept.tracks.state, old.tracks.state)
    np.testing.assert_allclose(kept.models.covariance, old.models.covariance)
    assert kept.tracks.stamp.tolist() == kept.tracks.age.tolist() == [12.0, 12.0]


def test_what_is_listed_gets_the_reported_state_and_keeps_its_figures():
    before = {"status": np.full(2, Status.FIXED), "announced": np.zeros(2, bool)}
    old = replace(table(1, 2, existence=0.4), **before)
    new = old.listed(tracks(2, 9, stamp=7.0, x=5000.0), 0.99)
    assert_same(old, replace(table(1, 2, existence=0.4), **before))
    assert_same(new[np.array([0])], old[np.array([0])])
    assert new.tracks.track_id.tolist() == [1, 2]
    assert new.tracks.state[1].tolist() == [5000.0, 5.0, 2000.0, 0.0]
    np.testing.assert_array_equal(new.models.state[1], new.tracks.state[[1, 1]])
    listed = [0.99, 1.0, 0.0, 7.0, LISTED, Status.PUBLISHED, True]
    assert [getattr(new, name)[1] for name in PLAIN] == listed
    assert (new.tracks.hits[1], new.tracks.age[1]) == (((0, 0),), 7.0)
