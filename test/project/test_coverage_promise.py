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
"""The promised coverage of lines and of branches is what `make coverage` checks."""

import json
import re
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CHECK = ROOT / ".ci" / "check_coverage.py"
pytestmark = pytest.mark.skipif(not CHECK.exists(), reason="source tree only")


def code_of(folder: Path, monkeypatch, **branches: int) -> int:
    """Exit code for reports with 990 of 1000 lines, and these of 1000 branches."""
    for name, covered in branches.items():
        totals = {"covered_lines": 990, "num_statements": 1000}
        totals |= {"covered_branches": covered, "num_branches": 1000}
        (folder / f"{name}.json").write_text(json.dumps({"totals": totals}))
    monkeypatch.setattr(sys, "argv", [str(CHECK), str(folder)])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(CHECK), run_name="__main__")
    return int(end.value.code)


@pytest.mark.parametrize(
    ("branches", "code", "missed"),
    [
        ({"all": 950, "core": 980}, 0, []),
        ({"all": 949, "core": 980}, 1, ["all: 94.90 % of branches"]),
        ({"all": 950, "core": 979}, 1, ["core: 97.90 % of branches"]),
    ],
    ids=str,
)
def test_branches_below_the_promise_fail_whatever_the_lines(
    tmp_path, monkeypatch, capsys, branches, code, missed
):
    assert code_of(tmp_path, monkeypatch, **branches) == code
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 4
    assert [line.partition(",")[0] for line in said if "MISSED" in line] == missed


def test_the_declaration_promises_what_is_checked():
    least = runpy.run_path(str(CHECK))["LEAST"]
    declared = (ROOT / ".github" / "QUALITY_DECLARATION.md").read_text(encoding="utf-8")
    row = re.search(r"^\| 4\.iii coverage .*$", declared, re.MULTILINE)[0]
    assert "lines and branches" in row
    assert f"at least {least['all']:g} % of each of all" in row
    assert f"{least['core']:g} % of each without `nodes` and `demo`" in row


def test_every_report_that_is_checked_is_made():
    recipe = re.search(
        r"^coverage:.*\n((?:.+\n)+)", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE
    )[1]
    made = re.search(r"for part in ([a-z ]+);", recipe)[1].split()
    assert made == list(runpy.run_path(str(CHECK))["LEAST"])
    assert "-o $(COVERAGE)/$$part.json" in recipe and "check_coverage.py $(COVERAGE)" in recipe
