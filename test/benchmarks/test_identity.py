# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Confirmed tracks stay with their targets, on recordings in a harbour and as it is judged."""

from pathlib import Path

import identity
import numpy as np
import pytest

from tsepm_ros import ConfirmedTrack
from tsepm_ros.tracker.tracks import TrackArrays

AUTOFERRY = Path(__file__).parents[2].parent / "shared" / "data" / "autoferry"
NOTHING = TrackArrays.from_tracks([])


@pytest.mark.long
@pytest.mark.skipif(not AUTOFERRY.is_dir(), reason="the recordings in a harbour are not here")
@pytest.mark.parametrize("how, late", [("estimated", 1), ("given", 0)])
def test_each_vessel_in_the_harbour_is_a_single_track(how, late):
    # Eight passages of two vessels, each in three scans; where P_D is learned, one takes a fourth.
    settings = identity.settings_of(how)
    found = [
        identity.watched_recording(folder, settings, 40.0)[0]
        for folder in sorted(AUTOFERRY.glob("scenario*"))
    ]
    delays = [delay for part in found for delay in part.delays.values()]
    assert len(delays) == 8
    assert np.mean(delays) <= 3.4 + 1.7 * late / len(delays)
    assert sum(part.held for part in found) >= 0.95 * sum(part.scans for part in found)
    assert sum(part.changes for part in found) <= 3
    assert max(max(part.fastest_new, part.fastest_confirmed) for part in found) <= 15.0


def tracks(**places: float) -> TrackArrays:
    """Tracks on the x axis, by id."""
    return TrackArrays.from_tracks(
        [
            ConfirmedTrack(int(name[1:]), 0.0, np.array([x, 1.0, 0.0, 0.0]), np.eye(4), (), 0.0)
            for name, x in places.items()
        ]
    )


def test_a_change_of_id_is_counted_and_a_gap_without_a_track_is_not_held():
    watched, truth = identity.Watched(10.0), {1: np.zeros(4)}
    for stamp, current in enumerate(
        (NOTHING, tracks(n3=2.0), tracks(n3=50.0), tracks(n3=9.0, n4=0.0), tracks(n3=11.0, n4=0.0))
    ):
        new = tracks(n3=2.0) if stamp == 1 else NOTHING
        watched.take(float(stamp), truth, new, current)
    assert watched.ids[1] == [None, 3, None, 3, 4]
    assert (watched.held, watched.scans, watched.changes) == (3, 4, 1)
    assert watched.delays == {1: 1.0}
    assert (watched.on_target, watched.elsewhere) == (1, [])


def test_a_switch_is_counted_one_to_one_where_a_target_has_lost_its_track_for_another():
    clear = identity.ClearMot(10.0)
    truth = {1: np.zeros(4), 2: np.array([8.0, 0.0, 0.0, 0.0])}
    clear.take_states(truth, tracks(n3=1.0, n4=7.0))
    clear.take_states(
        truth, tracks(n3=6.0, n4=3.0)
    )  # each nearer to the other target, but within the gate
    assert (clear.switches, clear.last) == (0, {1: 3, 2: 4})
    clear.take_states(truth, tracks(n3=1.0))
    assert clear.now == {1: 3}  # one track is not on both
    clear.take_states(truth, tracks(n3=1.0, n5=7.0))
    assert (clear.switches, clear.held()) == (1, (7, 8))


def test_a_track_far_from_every_target_is_elsewhere_and_one_may_be_on_two_that_are_not_resolved():
    watched = identity.Watched(10.0)
    truth = {1: np.zeros(4), 2: np.array([5.0, 0.0, 0.0, 0.0])}
    watched.take(0.0, truth, tracks(n1=2.0, n2=80.0), tracks(n1=2.0, n2=80.0))
    assert watched.elsewhere == [2]
    assert watched.ids == {1: [1], 2: [1]}
    watched.take(1.0, truth, NOTHING, tracks(n1=0.0, n7=6.0))
    assert watched.ids == {1: [1, 1], 2: [1, 1]}
    assert watched.changes == 0
