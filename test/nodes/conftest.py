"""What the node tests share: a machine-local network, own domains, nodes and processes."""

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

from support.patience import WAIT
from support.ros_process import RosProcess
from support.ros_world import World

DOMAINS = 100
"""Domains 1 to 100 keep clear of the ports that the system hands out."""

SHORT_WAIT = 2.0
"""Longest wait in a test that is known to fail, s."""

_candidates = (1 + (os.getpid() + number) % DOMAINS for number in itertools.count())


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
    with World(domain, SHORT_WAIT if expected_to_fail else WAIT) as made:
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
