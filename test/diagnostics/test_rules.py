"""The rules of health, and the page that says what to do where one is broken."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tsepm_ros.diagnostics.entries import ENTRIES
from tsepm_ros.diagnostics.rules import RULES
from tsepm_ros.parameters import table
from tsepm_ros.settings.diagnostics_options import DiagnosticsOptions

PAGE = (Path(__file__).parents[2] / "docs/operating.md").read_text(encoding="utf-8")
THRESHOLDS = {row.name for row in table(DiagnosticsOptions)}


def remedies_of(task: str) -> str:
    """The rows of an entry in the page's table of diagnostics."""
    _, _, rows = PAGE.partition(f"\n| `{task}` | ")
    return re.split(r"\n(?!\| \|)", rows)[0]


def test_every_entry_has_rules():
    assert set(RULES) == set(ENTRIES)


@pytest.mark.parametrize("task", RULES)
def test_the_operating_page_has_the_remedy_of_every_rule(task):
    rows = remedies_of(task)
    assert rows, "the page names every entry"
    for alternatives in RULES[task]:
        for rule in alternatives:
            assert f"| {rule.remedy}" in rows
            assert rule.level.name.lower() in rows


def test_the_operating_page_names_every_threshold():
    unnamed = [name for name in THRESHOLDS if not re.search(rf"`(diagnostics\.)?{name}`", PAGE)]
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
