"""A browser for the tests of a file."""

from collections.abc import Iterator

import pytest
from support.browser import Browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as opened:
        yield opened
