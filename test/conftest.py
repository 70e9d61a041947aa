"""What all tests share: an end to each that hangs."""

from __future__ import annotations

import pytest
from support.patience import STATISTICAL_TEST, TEST


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if not item.get_closest_marker("timeout"):
            statistical = item.get_closest_marker("statistical")
            item.add_marker(pytest.mark.timeout(STATISTICAL_TEST if statistical else TEST))
