"""A browser for all tests of a worker."""

from collections.abc import Iterator

import pytest
from support.browser import Browser


@pytest.fixture(scope="session")
def _running() -> Iterator[Browser]:
    with Browser() as opened:
        yield opened


@pytest.fixture
def browser(_running) -> Iterator[Browser]:
    """The same browser for all; what a test opens in it is closed after the test."""
    yield _running
    _running.close_tabs()
