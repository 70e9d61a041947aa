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
"""The campaigns' harness finds, counts, resumes and repeats; what it requires can fail."""

import json
from collections import Counter

import numpy as np
import pytest
from support.builders import scan_at

from tsepm_ros import ConfirmedTrack
from tsepm_ros.tracker.tracks import TrackArrays

campaign = pytest.importorskip("campaign", reason="only in the source tree")
invariants = pytest.importorskip("invariants")
Finding = campaign.Finding


def faulty(number: int, rng: np.random.Generator) -> Counter[str]:
    if number in (3, 5):
        raise ZeroDivisionError(f"planted {rng.integers(10**6)}")
    return Counter({"cases": 1})


def call(tmp_path, *more: str) -> int:
    return campaign.main("planted", "", faulty, arguments=[*more], folder=tmp_path)


def test_a_fault_is_found_named_and_repeated_by_its_number(tmp_path, capsys):
    assert call(tmp_path, "--cases", "5") == 1
    printed = capsys.readouterr().out
    assert "--seed 1 --case 3: ZeroDivisionError: planted" in printed
    assert "Traceback" in printed and "4 cases" in printed
    with pytest.raises(ZeroDivisionError) as repeated:
        call(tmp_path, "--case", "3")
    assert str(repeated.value) in printed
    with pytest.raises(ZeroDivisionError) as other:
        call(tmp_path, "--case", "3", "--seed", "2")
    assert str(other.value) != str(repeated.value)


def test_a_campaign_goes_on_where_it_ended(tmp_path, capsys):
    assert call(tmp_path, "--cases", "3") == 0
    assert call(tmp_path, "--cases", "8") == 1
    state = json.loads((tmp_path / "planted-1.json").read_text())
    assert (state["following"], state["tried"], len(state["findings"])) == (8, {"cases": 6}, 2)
    assert call(tmp_path, "--cases", "8") == 1, "earlier findings stand"
    assert call(tmp_path, "--cases", "3", "--fresh") == 0
    assert call(tmp_path, "--fresh", "--seconds", "0") == 0
    state = json.loads((tmp_path / "planted-1.json").read_text())
    assert state["following"] == 0, "no case begins after the time"


GOOD = np.diag([25.0, 1.0, 25.0, 1.0])
BAD = {
    "not finite": np.full((4, 4), np.nan),
    "not symmetric": GOOD + np.eye(4, k=1),
    "not positive": -GOOD,
    "not positive definite": GOOD + 30.0 * (np.eye(4, k=2) + np.eye(4, k=-2)),
}


def tracks(covariance, *ids: int) -> TrackArrays:
    state = np.array([100.0, 1.0, 0.0, 0.0])
    return TrackArrays.from_tracks(
        [ConfirmedTrack(i, 0.0, state, covariance, (), 0.0) for i in ids]
    )


@pytest.mark.parametrize("fault", BAD)
def test_a_bad_covariance_and_an_id_that_repeats_are_findings(fault):
    invariants.check_tracks(tracks(GOOD, 1, 2), "tracks")
    for covariance, ids, said in ((BAD[fault], (1,), fault), (GOOD, (1, 1), "unique")):
        with pytest.raises(Finding, match=said):
            invariants.check_tracks(tracks(covariance, *ids), "tracks")


def test_a_lost_message_an_internal_error_and_a_nameless_drop_are_findings():
    pytest.importorskip("sensor_msgs")
    from messages import Fed, settings_of

    from tsepm_ros.own_ship.registration import UnregisteredScan

    fed = Fed(settings_of("tsepm", "none"))
    fed.session.add_scan(UnregisteredScan(scan_at(1.0, [(100.0, 0.0)]), "sonar"), 0.0)
    fed.sent = 2
    with pytest.raises(Finding, match="2 messages: 0 results, 0 drops, 1 waiting"):
        fed.check_counts()
    for reason, said in (("internal_error", "internal"), ("no such reason", "not described")):
        with pytest.raises(Finding, match=said):
            invariants.check_reasons(Counter({reason: 1}))


def test_mutation_changes_messages_and_the_same_seed_changes_them_alike():
    pytest.importorskip("sensor_msgs")
    import copy

    from mutation import leaves, mutate, names_of
    from streams import KINDS, good_stream

    def numbers(message: object) -> str:
        values = [value for value, _ in leaves(message)]
        return repr([x for x in values if not (isinstance(x, list) and x and names_of(x[0]))])

    for kind in KINDS:
        good = good_stream(kind).pings[0].detections
        changed = []
        for _ in range(2):
            message = copy.deepcopy(good)
            rng = np.random.default_rng(3)
            for _ in range(20):
                mutate(message, rng)
            changed.append(numbers(message))
        assert changed[0] == changed[1]
        assert changed[0] != numbers(good)


def test_of_mutated_tracks_and_fixes_the_bridge_sends_what_other_readers_read():
    pytest.importorskip("pyproj")
    bridge = pytest.importorskip("bridge", reason="needs ROS and pynmea2")
    tried = sum((bridge.case(n, np.random.default_rng((9, n))) for n in range(4)), Counter())
    assert min(tried[kind] for kind in ("TTM", "TLL", "deltas", "ends of deltas", "drops")) > 10
