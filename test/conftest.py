"""What all tests share: an end to each that hangs, and signals that processes receive."""

from __future__ import annotations

import pytest
from support.interrupts import heed_interrupts
from support.patience import LONG_TEST, TEST


def pytest_configure() -> None:
    heed_interrupts()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if not item.get_closest_marker("timeout"):
            long = item.get_closest_marker("long")
            item.add_marker(pytest.mark.timeout(LONG_TEST if long else TEST))
