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
"""Plan-position pictures: panels, trails, the legend, and labels that do not overlap."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tsepm_ros.tools.evaluation.simulated_run import Judged, Outcome
from tsepm_ros.tools.pictures.run_scene import RunScene, SceneScan
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays


def track_at(track_id, x, hits=()):
    return ConfirmedTrack(
        track_id=track_id,
        stamp=0.0,
        state=np.array([x, 1.0, 0.0, 0.0]),
        covariance=np.diag([400.0, 1.0, 400.0, 1.0]),
        hits=hits,
        evaluation=0.0,
    )


def view(number, new=(), held=(), restart=False):
    detections = np.array([[number, 0.0], [number, 1.0]])
    tracks = (TrackArrays.from_tracks(list(new)), TrackArrays.from_tracks(list(held)))
    return SceneScan(float(number), detections, None, *tracks, restart=restart)


def test_the_picture_of_a_judged_run_has_the_result_and_a_panel_for_each_target():
    pytest.importorskip("matplotlib")
    from tsepm_ros.tools.pictures import plan_position

    track = replace(track_at(41, 30.0, ((0, 0), (2, 1))), stamp=2.0)
    scans = [view(0), view(1), view(2, [track], [track]), view(3, held=[track_at(41, 31.0)])]
    truth = [np.array([[0.0, y, 0.0], [3.0, y + 3.0, 0.0]]) for y in (29.0, 900.0)]
    judged = [Judged(track, Outcome.TRUE, 0, True, 1.0, 1.0, 1.0)]
    figure = plan_position.draw(RunScene("run", scans, truth, judged))
    plan, found, missed = figure.axes
    assert figure.get_suptitle() == "1 of 2 targets in 3 pings, no false track"
    titles = [axes.get_title(loc="left") for axes in (found, missed)]
    assert titles == ["target A: track 41\nafter 3 pings, 2 s, by 2 hits", "target B: no track"]
    written = [text.get_text() for text in found.texts]
    assert {"1", "3", "41"} <= set(written), "the scans of the hits, and the id"
    diamonds = [line for line in found.lines if line.get_marker() == "D"]
    assert [(*line.get_xdata(), *line.get_ydata()) for line in diamonds] == [(31.0, 0.0)], "at 2 s"
    rings = [text.get_text() for text in plan.texts if text.get_text().endswith((" m", "km"))]
    assert rings, "ranges of the rings"


def test_a_recording_shows_fixed_echoes_trails_and_the_way_of_the_own_ship():
    pytest.importorskip("matplotlib")
    from tsepm_ros.tools.pictures import plan_position

    echo = np.array([[5.0, 5.0]])
    poses = [np.array([10.0 * number, 0.0, np.nan]) for number in range(3)]
    held = [[track_at(4, 50.0), track_at(6, 20.0)], [track_at(4, 51.0)], [track_at(4, 52.0)]]
    scans = [
        replace(view(number, held=held[number]), sensor=pose, fixed_echoes=echo)
        for number, pose in enumerate(poses)
    ]
    figure = plan_position.draw(RunScene("run", scans))
    (plan,) = figure.axes
    lines = [line.get_xydata().tolist() for line in plan.lines]
    assert [[50.0, 0.0], [51.0, 0.0], [52.0, 0.0]] in lines, "trail of the track that is held"
    assert [[20.0, 0.0]] in lines, "trail of the track that ended"
    assert [[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]] in lines, "way of the own ship"
    assert echo.tolist() in lines
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"fixed echo", "own ship and its way", "held to the end: its trail"} <= set(labels)


def legend_of(scene: RunScene) -> set[str]:
    """Labels of the legend of a run's picture."""
    from tsepm_ros.tools.pictures import plan_position

    figure = plan_position.draw(scene)
    return {text.get_text() for text in figure.legends[0].get_texts()}


def test_the_legend_of_a_picture_names_only_what_is_drawn():
    pytest.importorskip("matplotlib")
    tracks = [track_at(number, 10.0 * number, ((0, 0), (1, 1))) for number in range(13)]
    truth = [np.array([[0.0, 0.0, 0.0], [3.0, 9.0, 0.0]])]
    false = [Judged(tracks[0], Outcome.FALSE, -1, True, 1.0, 1.0, 1.0)]
    judged_false = "false, misplaced or redundant track"
    hits = "hits of a new track in order"

    empty = legend_of(RunScene("run"))
    assert not empty & {judged_false, "fixed echo", "held to the end: its trail"}
    some = [view(0), view(1, tracks[:2])]
    assert hits in legend_of(RunScene("run", some, truth))
    assert judged_false in legend_of(RunScene("run", some, truth, false))
    assert hits not in legend_of(RunScene("run", [view(0), view(1, tracks)])), "too many starts"


def notes_of(size: float, points: np.ndarray):
    """Labels of points in axes of a size, inches, whose limits are 0 and 1."""
    figures = pytest.importorskip("matplotlib.figure")
    from tsepm_ros.tools.pictures import plan_position
    from tsepm_ros.tools.pictures.plan_position import PointLabel

    figure = figures.Figure(figsize=(size, size))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    plan_position.label_points(
        axes, [PointLabel(str(n), x, y, "black") for n, (x, y) in enumerate(points)]
    )
    figure.draw_without_rendering()
    return list(axes.texts)


def test_labels_overlap_neither_each_other_nor_points_and_without_room_are_at_the_last_place():
    notes = notes_of(5.0, 0.5 + 0.01 * np.random.default_rng(1).standard_normal((12, 2)))
    assert [note.get_text() for note in notes] == [str(n) for n in range(12)]
    boxes = [super(type(note), note).get_window_extent() for note in notes]
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    from tsepm_ros.tools.pictures.plan_position import LABEL_ANGLES, LABEL_DISTANCES

    (note,) = notes_of(0.1, np.array([[0.5, 0.5]]))
    assert note.get_position()[1] == pytest.approx(LABEL_DISTANCES[-1] * np.sin(LABEL_ANGLES[-1]))
