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
"""What all tests share: an end to each that hangs, signals of processes, and the time of parts.

An internal error is a failure: it hides nothing.
"""

import os
from collections import Counter
from collections.abc import Iterator

import pytest
from support.interrupts import heed_interrupts
from support.patience import LONG_TEST, TEST

from tsepm_ros.session.drop_reasons import INTERNAL_ERROR
from tsepm_ros.session.session import Session

pytest_plugins = ["support.ros_fixtures"]


def pytest_configure() -> None:
    heed_interrupts()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if not item.get_closest_marker("timeout"):
            long = item.get_closest_marker("long")
            item.add_marker(pytest.mark.timeout(LONG_TEST if long else TEST))


@pytest.fixture(scope="session", autouse=True)
def _ros_home(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Nodes keep their files in a folder of the tests."""
    os.environ["ROS_HOME"] = str(tmp_path_factory.mktemp("ros_home"))


@pytest.fixture(autouse=True)
def _no_internal_error(request: pytest.FixtureRequest) -> Iterator[None]:
    """Fail a test in which a session counts an internal error, unless it is marked so."""
    found, drop = list[str](), Session.drop

    def noted(session: Session, reason: str, sentence: str, number: int = 1) -> None:
        found.extend([sentence] if reason == INTERNAL_ERROR else [])
        drop(session, reason, sentence, number)

    Session.drop = noted
    yield
    Session.drop = drop
    assert not found or request.node.get_closest_marker("internal_error")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how long each part of the tests took."""
    seconds: Counter[str] = Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                seconds[report.nodeid.partition("::")[0].rpartition("/")[0]] += report.duration
    terminalreporter.section("seconds of each part, of all workers together")
    terminalreporter.line(
        ", ".join(f"{part} {time:.0f}" for part, time in seconds.most_common() if time >= 1.0)
    )
