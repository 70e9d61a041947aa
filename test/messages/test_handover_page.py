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
"""What the page on the hand-over says of messages."""

import dataclasses

import numpy as np
from support.handover_page import PAGE, run_page

from msg_adapters import (
    PlacedDetections,
    make_header,
    placed_detections_cloud,
    track_cloud,
    track_odometry,
    tracker_report,
)
from tsepm_ros.session.inputs import usable_input_tracks
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.scan import FEATURES

STAMP = 1_700_000_000_123_456_789


def test_what_is_tracked_goes_back_as_it_came(make_track, over_the_wire):
    page = run_page()
    new = track_cloud(make_header(STAMP, "odom"), [make_track(track_id=7), make_track(track_id=9)])
    followed = page["starts"](over_the_wire(new))
    report = tracker_report(over_the_wire(page["tracked"](STAMP, "odom", followed)))
    taken, dropped = usable_input_tracks(report.tracks)
    assert dropped == {}
    assert report.frame_id == "odom"
    assert taken.track_id.tolist() == [7, 9]
    for one in taken:
        np.testing.assert_array_equal(one.state, make_track().state)
        np.testing.assert_array_equal(one.covariance, make_track().covariance)


def test_a_detection_updates_as_the_package_s_own_filter_does(make_track, over_the_wire):
    track = make_track()
    placed = PlacedDetections(
        position=np.array([[0.0, 0.0], [3080.0, 4020.0]]),
        covariance=np.array([np.eye(2), [[900.0, -200.0], [-200.0, 8100.0]]]),
        time_offset=np.array([0.0, 3.4]),
    )
    cloud = over_the_wire(placed_detections_cloud(make_header(STAMP, "odom"), placed))
    state, covariance = run_page()["update"](track.state, track.covariance, cloud, 1)
    step, before = placed.time_offset[1:], track.covariance[None]
    innovation = placed.position[1:] - track.position - step * track.velocity
    S = motion.position_covariance_after(before, step) + placed.covariance[1:]
    [after], [spread] = motion.update(track.state[None], before, step, innovation, S)
    np.testing.assert_allclose(state, after, rtol=1e-9)
    np.testing.assert_allclose(covariance, spread, rtol=1e-9, atol=1e-9)


def test_the_page_gives_every_field_of_placed_detections_with_its_offset():
    features = {name: np.zeros(0) for name in FEATURES}
    placed = PlacedDetections(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0), features)
    section = PAGE.read_text(encoding="utf-8").partition("## Detections for the tracker")[2]
    rows = [line.split("|")[1:4] for line in section.splitlines() if line.startswith("| `")]
    told = {
        name.strip(" `"): (kind.strip(), offset.strip().removesuffix(" on"))
        for names, kind, offsets in rows[:5]
        for name, offset in zip(names.split(","), _each(names, offsets), strict=True)
    }
    cloud = placed_detections_cloud(make_header(STAMP, "odom"), placed)
    kinds = {7: "float32", 8: "float64"}
    made = {field.name: (kinds[field.datatype], str(field.offset)) for field in cloud.fields}
    first = made[FEATURES[0]][1]
    for name in FEATURES:  # where each is depends on which there are
        made[name] = made[name][0], f"from {first}"
    assert told == made


def _each(names: str, offsets: str) -> list[str]:
    """The offset of each name in a row of the page's table."""
    given = offsets.split(",")
    return given if len(given) > 1 else given * len(names.split(","))


def test_odometry_gives_the_state_without_what_is_between_and_twice_its_blocks_are_safe(
    make_track, over_the_wire
):
    track = make_track()
    message = over_the_wire(track_odometry(make_header(STAMP, "odom"), track))
    state, covariance = run_page()["filter_start"](message)
    np.testing.assert_array_equal(state, track.state)
    between = np.add.outer(np.arange(4), np.arange(4)) % 2 == 1
    assert (track.covariance[between] != 0.0).all()
    np.testing.assert_array_equal(covariance, np.where(between, 0.0, track.covariance))
    _, covariance = run_page()["filter_start"](message)
    assert np.linalg.eigvalsh(2.0 * covariance - track.covariance).min() > 0.0
    assert np.linalg.eigvalsh(covariance - track.covariance).min() < 0.0


def test_a_correction_replaces_the_filter_of_its_id(make_track, over_the_wire):
    page, filters = run_page(), {}
    for revision, place in ((0, 100.0), (1, 900.0)):
        track = dataclasses.replace(
            make_track(track_id=7), state=np.array([place, 1.0, 0.0, 0.0]), revision=revision
        )
        cloud = track_cloud(make_header(STAMP, "odom"), [track])
        page["take"](filters, over_the_wire(cloud))
        assert list(filters) == [7] and filters[7][0][0] == place
