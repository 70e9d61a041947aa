"""What the node tests share: a machine-local network, own domains, nodes and processes."""

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
from support.ros_domains import own_domain
from support.ros_process import RosProcess
from support.ros_world import World

SHORT_WAIT = 2.0
"""Longest wait in a test that is known to fail, s."""


@pytest.fixture
def domain() -> Iterator[int]:
    """A domain that no other test on this machine has now, or this process had lately."""
    with own_domain() as number:
        yield number


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
