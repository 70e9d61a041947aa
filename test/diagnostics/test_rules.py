"""The rules of health, and the page that says what to do where one is broken."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest

from tsepm_ros.diagnostics.health import ENTRIES
from tsepm_ros.diagnostics.judgements import RULES
from tsepm_ros.parameters import table
from tsepm_ros.settings.node_options import DiagnosticsOptions

PAGE = (Path(__file__).parents[2] / "docs/diagnostics.md").read_text(encoding="utf-8")
THRESHOLDS = {row.name for row in table(DiagnosticsOptions)}


def test_every_entry_has_rules():
    assert set(RULES) == set(ENTRIES)


@pytest.mark.parametrize("task", RULES)
def test_every_rule_has_a_condition_and_a_remedy(task):
    for alternatives in RULES[task]:
        for rule in alternatives:
            assert inspect.getdoc(rule.judge)
            assert f"| {rule.remedy} |" in PAGE


def test_the_page_names_every_threshold():
    unnamed = [name for name in THRESHOLDS if f"`diagnostics.{name}`" not in PAGE]
    assert unnamed == []


def test_every_threshold_belongs_to_a_rule():
    of_rules = {
        name
        for rules in RULES.values()
        for alternatives in rules
        for rule in alternatives
        for name in rule.thresholds
    }
    assert of_rules == THRESHOLDS - {"window"}, "the window says how long a finding stands"
