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
"""Pictures of evaluations: a panel for each horizon, and a name for each point."""

import numpy as np
import pytest
from support.run_summaries import run_of, start

from tsepm_ros.tools.evaluation.performance import PerformanceEvaluated
from tsepm_ros.tools.evaluation.simulated_run import SimulatedOperatingPoint
from tsepm_ros.tools.simulation import load_scenario

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from tsepm_ros.tools.pictures.operating_curve_picture import draw_operating_curve


@pytest.fixture
def figures(monkeypatch):
    """The figures that are written."""
    written, save = [], Figure.savefig

    def noted(figure, *args, **options):
        written.append(figure)
        save(figure, *args, **options)

    monkeypatch.setattr(Figure, "savefig", noted)
    return written


def test_each_horizon_has_a_panel_and_each_method_a_curve(figures, tmp_path):
    points = [SimulatedOperatingPoint("score", f"{rate:g}/h", {}) for rate in (1.0, 10.0)]
    points.append(SimulatedOperatingPoint("tsepm", "4/5", {}))
    runs = [[run_of(start(3), false=(number, 0, 0, 0))] * 4 for number in (1, 2, 0)]
    box = load_scenario("box")
    path = draw_operating_curve(
        [PerformanceEvaluated.of(box, scans, points, runs) for scans in (2, 4)], tmp_path, "4 runs"
    )
    assert path.name == "box_operating_curve.png"
    assert path.read_bytes().startswith(b"\x89PNG")
    (figure,) = figures
    panels = [axes for axes in figure.axes if axes.get_title("left")]
    assert [axes.get_title("left") for axes in panels] == ["after 2 pings", "after 4 pings"]
    for axes in panels:
        names = [text.get_text() for text in axes.get_legend().get_texts()]
        assert names == ["score", "tsepm"]
        drawn = np.array([text.get_text() for text in axes.texts])
        assert {"1/h", "10/h", "4/5"} <= set(drawn.tolist())
    assert "4 runs" in figure.get_suptitle()
