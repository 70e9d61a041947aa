"""What compares targets told wrongly and rightly: its verdicts by hand, and its fades."""

from __future__ import annotations

import json
from dataclasses import replace

import fading_targets
import numpy as np
import pytest
from fading_targets import EVERY, FADED, WARM_UP, compared, faded

from tsepm_ros.tools.evaluation.simulated_run import SimulatedScene
from tsepm_ros.tools.simulation import load_scenario


@pytest.mark.parametrize(
    ("both", "wrong_alone", "right_alone", "verdict"),
    [(200, 20, 20, "holds"), (60, 10, 60, "does not"), (20, 5, 5, "cannot tell")],
)
def test_verdicts_are_those_of_the_paired_margin(both, wrong_alone, right_alone, verdict):
    pairs = [(1, 1)] * both + [(1, 0)] * wrong_alone + [(0, 1)] * right_alone
    seen = np.array(pairs + [(0, 0)] * (400 - len(pairs)), bool)
    wrong, right, margin, found = compared(seen)
    assert found == verdict
    assert float(wrong.split()[0]) == pytest.approx((both + wrong_alone) / 400, abs=1e-3)
    assert float(right.split()[0]) == pytest.approx((both + right_alone) / 400, abs=1e-3)
    expected = (both + wrong_alone - 0.95 * (both + right_alone)) / 400
    assert float(margin.split()[0]) == pytest.approx(expected, abs=1e-3)


def test_a_target_fades_for_four_pings_of_sixteen():
    box = load_scenario("box", {"sensor.detection_probability": 1.0})
    scene = SimulatedScene.drawn(replace(box, warm_up=WARM_UP), [1, 0])
    seen = [bool((origin >= 0).any()) for origin in faded(scene, 5).origins]
    assert not any(seen[:WARM_UP])
    gone = [not one for one in seen[WARM_UP : WARM_UP + EVERY]]
    assert sum(gone) == FADED
    assert gone[5 : 5 + FADED] == [True] * FADED


@pytest.mark.long
def test_a_run_of_two_pairs_writes_its_result(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(fading_targets, "TARGETS", dict([*fading_targets.TARGETS.items()][:1]))
    path = tmp_path / "fading.json"
    fading_targets.main(["--runs", "2", "--workers", "1", "--rate", "100", "--result", str(path)])
    result = json.loads(path.read_text(encoding="utf-8"))
    assert result["command"] == "python benchmarks/fading_targets.py --runs 2 --rate 100"
    assert [row[2] for row in result["rows"]] == ["8", "16"]
    assert "| P_d 0.6 | 100/h | 16 |" in capsys.readouterr().out
