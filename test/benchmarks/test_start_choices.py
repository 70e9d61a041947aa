"""What compares values of the start rule's constants: which value a run has, and its cells."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import start_choices
from start_choices import HEADER, Job, cells, run

from tsepm_ros.tools.evaluation.measures import StartSummary
from tsepm_ros.tools.evaluation.simulated_run import Outcome, simulate
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tracker import confirmation


@pytest.fixture
def short_box(monkeypatch):
    """Three pings with a warm-up of one."""
    monkeypatch.setattr(start_choices, "EARLY", 2)
    short = replace(load_scenario("box", {}), scans=3, warm_up=1)
    monkeypatch.setattr(start_choices, "box", lambda: short)


@pytest.mark.parametrize("choice", start_choices.CHOICES)
def test_a_run_has_the_value_and_leaves_the_rule_as_built(monkeypatch, short_box, choice):
    seen = []

    def seeing(*arguments):
        seen.append(getattr(confirmation, choice))
        return simulate(*arguments)

    monkeypatch.setattr(start_choices, "simulate", seeing)
    built = getattr(confirmation, choice)
    run(Job(choice, 0.75, 20.0, [1, 0]))
    assert seen == [0.75]
    assert getattr(confirmation, choice) == built


@pytest.mark.long
@pytest.mark.parametrize(
    ("choice", "value"),
    [("MAX_HELD_SHARE", 0.0), ("MIN_PURITY_PROBABILITY", 1.0), ("TARGET_BIRTH_RATE", 0.01)],
)
def test_a_value_takes_effect(monkeypatch, choice, value):
    box = replace(load_scenario("box", {}), scans=12, warm_up=4)
    monkeypatch.setattr(start_choices, "box", lambda: box)
    built = float(getattr(confirmation, choice))
    seeds = [[1, index] for index in range(3)]
    one, other = ([run(Job(choice, v, 300.0, seed)) for seed in seeds] for v in (built, value))
    assert one != other


def test_a_value_without_effect_is_refused(capsys):
    with pytest.raises(SystemExit):
        start_choices.main(["MIN_PURITY_PROBABILITY", "--value", "0.2"])
    assert "must be from 0.5 to 1; got 0.2" in capsys.readouterr().err


def test_the_difference_is_that_of_the_pairs(short_box):
    none = run(Job("MAX_HELD_SHARE", 0.5, 20.0, [1, 0]))
    assert not none.starts
    start = start_of(none, Outcome.TRUE)
    runs, built = [start] * 3 + [none] * 7, [none] * 9 + [start]
    row = dict(zip(HEADER[2:], cells(runs, built), strict=True))
    assert row["P_D, 16 pings"].startswith("0.3000 ")
    # Three runs gain the target, one loses it.
    assert row["difference from the built rule"].startswith("+0.200 ")
    assert (
        dict(zip(HEADER[2:], cells(built, built), strict=True))["difference from the built rule"]
        == ""
    )


def start_of(summary, outcome):
    """The summary with a start of an outcome in its first scan."""
    start = StartSummary(0, 0.0, outcome, True, 1.0, 1.0, 4.0, 1.0, 1.0)
    return replace(summary, starts=(start,))


def test_it_writes_its_result(tmp_path, capsys, short_box):
    path = tmp_path / "choices.json"
    arguments = ["MIN_PURITY_PROBABILITY", "--value", "0.5", "--rate", "100", "--runs", "2"]
    start_choices.main([*arguments, "--workers", "1", "--result", str(path)])
    result = json.loads(path.read_text(encoding="utf-8"))
    assert result["command"] == (
        "python benchmarks/start_choices.py MIN_PURITY_PROBABILITY --value 0.5 --rate 100 --runs 2 "
        "--seed 1"
    )
    assert [row[:2] for row in result["rows"]] == [["100/h", "0.9, as built"], ["100/h", "0.5"]]
    assert "| 100/h | 0.9, as built |" in capsys.readouterr().out
