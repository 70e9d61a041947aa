"""The rules of health, and the page that says what to do where one is broken."""

from pathlib import Path

from tsepm_ros.diagnostics.health import ENTRIES
from tsepm_ros.parameters import table
from tsepm_ros.settings.node_options import DiagnosticsOptions

PAGE = (Path(__file__).parents[2] / "docs/diagnostics.md").read_text(encoding="utf-8")
THRESHOLDS = {row.name for row in table(DiagnosticsOptions)}


RULES = [rule for entry in ENTRIES.values() for some in entry.rules for rule in some]


def test_every_rule_has_a_condition_and_a_remedy_on_the_page():
    assert all(rule.condition in PAGE and f"| {rule.remedy} |" in PAGE for rule in RULES)


def test_the_page_names_every_threshold():
    unnamed = [name for name in THRESHOLDS if f"`diagnostics.{name}`" not in PAGE]
    assert unnamed == []


def test_every_threshold_belongs_to_a_rule():
    of_rules = {name for rule in RULES for name in rule.thresholds}
    assert of_rules == THRESHOLDS - {"window"}, "the window says how long a finding stands"
