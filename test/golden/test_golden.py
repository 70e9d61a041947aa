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
"""Tracks, confirmed tracks and counts of short scenes are those that are stored."""

import pytest
from golden_outputs import SCENES, compared, differences, output, stored


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_has_its_stored_tracks(name):
    found = differences(name, output(name))
    assert not found, (
        f"{len(found)} differences; if they are intended, `make golden` stores the new outputs:\n"
        + "\n".join(found[:20])
    )


def test_every_scene_confirms_and_holds_tracks():
    for name in SCENES:
        scans = stored(name)
        assert any(scan["new"] for scan in scans), name
        assert any(scan.get("held") for scan in scans), name


def test_a_difference_names_its_track_its_field_and_its_size():
    old = {"new": {"track 1": {"state": [100.0, None], "hits": ["0/1"]}, "track 2": {}}}
    new = {"new": {"track 1": {"state": [101.0, None], "hits": ["0/2"]}}}
    assert list(compared(old, new)) == [
        "new track 1 hits: ['0/1'] before, ['0/2'] now",
        "new track 1 state[0]: 100.0 before, 101.0 now (+0.01 of it)",
        "new track 2: only before",
    ]
    assert not list(compared(old, old))


@pytest.mark.parametrize(("change", "found"), [(1e-12, 0), (1e-8, 1)])
def test_only_a_difference_beyond_the_tolerance_counts(change, found):
    old, new = ({"state": [factor * 3.0, 1.0]} for factor in (1.0, 1.0 + change))
    assert len(list(compared(old, new))) == found
