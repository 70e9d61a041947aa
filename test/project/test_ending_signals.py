"""Ends by SIGINT and SIGTERM: held back while processes start, and an exception otherwise."""

from __future__ import annotations

import signal
import threading
from contextlib import AbstractContextManager

import pytest

from tsepm_ros.ending_signals import (
    ENDING_SIGNALS,
    TERMINATED,
    ending_on_termination,
    signals_held,
)


def handlers() -> list:
    return [signal.getsignal(number) for number in ENDING_SIGNALS]


@pytest.fixture
def arrived():
    """Signals that arrived at the handlers that were there before."""
    numbers: list[int] = []
    before = handlers()
    for number in ENDING_SIGNALS:
        signal.signal(number, lambda number, _: numbers.append(number))
    yield numbers
    for number, handler in zip(ENDING_SIGNALS, before, strict=True):
        signal.signal(number, handler)


def test_signals_that_are_held_arrive_after_the_block(arrived):
    before = handlers()
    with signals_held():
        for number in ENDING_SIGNALS:
            signal.raise_signal(number)
        assert arrived == []
    assert arrived == list(ENDING_SIGNALS) and handlers() == before


def test_termination_is_an_exception_of_its_code_within_the_block(arrived):
    before = handlers()
    with pytest.raises(SystemExit) as end, ending_on_termination():
        signal.raise_signal(signal.SIGTERM)
    assert (end.value.code, arrived, handlers()) == (TERMINATED, [], before)


@pytest.mark.parametrize("block", [signals_held, ending_on_termination])
def test_another_thread_leaves_the_handlers_as_they_are(block):
    before, seen = handlers(), []

    def run(context: AbstractContextManager) -> None:
        with context:
            seen.append(handlers())

    thread = threading.Thread(target=run, args=(block(),))
    thread.start()
    thread.join()
    assert seen == [before] and handlers() == before
