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
"""Arguments that commands share: numbers with a least value, folders, and their defaults."""

import argparse

import pytest

from tsepm_ros.tools.commands.arguments import (
    add_arguments,
    add_out_argument,
    add_runs_arguments,
    in_folder_argument,
    positive,
    scenario_argument_names,
    seed,
)


def test_a_number_is_not_below_its_least_value():
    assert (positive("1"), seed("0")) == (1, 0)
    with pytest.raises(argparse.ArgumentTypeError, match="at least 1"):
        positive("0")
    with pytest.raises(argparse.ArgumentTypeError, match="at least 0"):
        seed("-1")
    for text in ("1.5", "1e3", "many", "", "0x10"):
        with pytest.raises(argparse.ArgumentTypeError, match=f"in digits; got '{text}'"):
            positive(text)
    assert (positive(" 20"), positive("1_000")) == (20, 1000)


def test_a_file_is_written_to_a_folder_that_exists(tmp_path):
    assert in_folder_argument(str(tmp_path / "out.csv")) == tmp_path / "out.csv"
    with pytest.raises(argparse.ArgumentTypeError, match=r"the folder .*none does not exist"):
        in_folder_argument(str(tmp_path / "none" / "out.csv"))


def test_runs_seed_workers_and_folder_have_defaults_that_help_tells():
    parser = argparse.ArgumentParser()
    add_runs_arguments(parser, 7, "passes")
    add_out_argument(parser, "results")
    add_arguments(parser, {"--fast": {"action": "store_true"}})
    given = parser.parse_args(["--fast"])
    assert (given.runs, given.seed, str(given.out), given.fast) == (7, 1, "results", True)
    assert given.workers >= 1
    text = " ".join(parser.format_help().split())
    assert "passes; default 7" in text and "default results" in text


def test_shipped_scenarios_are_named():
    assert "box" in scenario_argument_names()
    assert scenario_argument_names().endswith("or a .yaml file")
