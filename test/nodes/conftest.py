"""What the node tests share: a machine-local network, own domains, and an end to every wait."""

from __future__ import annotations

import fcntl
import itertools
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

# Before anything initialises ROS: nothing leaves this machine or is written to the home directory.
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_LOG_DIR", tempfile.mkdtemp(prefix="tsepm_ros_log_"))
os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(Path(__file__).parent / "fastdds.xml"))

from support.ros_process import RosProcess
from support.ros_world import DEADLINE, World

DOMAINS = 100
"""Domains 1 to 100 keep clear of the ports that the system hands out."""

TEST_TIMEOUT = 60.0

SHORT_DEADLINE = 2.0
"""Longest wait in a test that is known to fail, s."""

_candidates = (1 + (os.getpid() + number) % DOMAINS for number in itertools.count())


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(TEST_TIMEOUT))


@pytest.fixture
def domain() -> Iterator[int]:
    """A domain that no other test on this machine has now, or this process had lately."""
    for number in itertools.islice(_candidates, DOMAINS):
        path = Path(tempfile.gettempdir()) / f"tsepm_ros_domain_{number}.lock"
        with ExitStack() as stack:
            try:
                lock = stack.enter_context(path.open("a"))
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:  # somebody else has it
                continue
            yield number
            return
    pytest.fail("every domain is in use")


@pytest.fixture
def world(domain: int, request: pytest.FixtureRequest) -> Iterator[World]:
    expected_to_fail = request.node.get_closest_marker("xfail")
    with World(domain, SHORT_DEADLINE if expected_to_fail else DEADLINE) as made:
        yield made


@pytest.fixture
def start(domain: int, tmp_path: Path) -> Iterator[Callable[..., RosProcess]]:
    """Start an executable of the package in the test's domain; it is killed at the end."""
    with ExitStack() as stack:
        number = itertools.count()

        def start_process(
            name: str, parameters: dict[str, object] | None = None, **options: Any
        ) -> RosProcess:
            output = tmp_path / f"{name}_{next(number)}.txt"
            process = RosProcess(name, parameters or {}, domain, output, **options)
            return stack.enter_context(process)

        yield start_process
