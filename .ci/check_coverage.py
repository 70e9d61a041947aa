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
"""Check that the tests run the shares of lines and branches that QUALITY_DECLARATION.md promises.

Usage, with the JSON reports of `make coverage` in a folder: check_coverage.py FOLDER
"""

import json
import sys
from pathlib import Path

LEAST = {"all": 95.0, "core": 98.0}
"""Promised per cent of lines, and of branches, by report; `core` is without nodes and demo."""


def shares(report: Path) -> dict[str, float]:
    """Per cent of lines and of branches that a report counts as run."""
    totals = json.loads(report.read_text(encoding="utf-8"))["totals"]
    return {
        "lines": 100.0 * totals["covered_lines"] / totals["num_statements"],
        "branches": 100.0 * totals["covered_branches"] / totals["num_branches"],
    }


def main() -> None:
    """Print the shares, and fail if one is below the promise."""
    kept = True
    for name, least in LEAST.items():
        for kind, share in shares(Path(sys.argv[1]) / f"{name}.json").items():
            kept &= share >= least
            missed = "" if share >= least else ": MISSED"
            print(f"{name}: {share:.2f} % of {kind}, promised {least:g} %{missed}")
    sys.exit(not kept)


if __name__ == "__main__":
    main()
