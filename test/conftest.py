"""What all tests share: an end to each that hangs, and signals that processes receive."""

from __future__ import annotations

import signal
import threading

import pytest
from support.patience import STATISTICAL_TEST, TEST


def pytest_configure() -> None:
    # A shell's jobs in the background ignore SIGINT, and the processes that tests interrupt would
    # inherit that.
    if (
        signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        and threading.current_thread() is threading.main_thread()
    ):
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if not item.get_closest_marker("timeout"):
            statistical = item.get_closest_marker("statistical")
            item.add_marker(pytest.mark.timeout(STATISTICAL_TEST if statistical else TEST))
