"""A session from arriving scans to results and counts."""

from __future__ import annotations

from collections import Counter

from support.builders import assert_same_tracks
from support.sessions import (
    BOX,
    arrived,
    simulated,
)

from tsepm_ros import make_initiator
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings


def test_a_session_gives_what_the_initiator_gives():
    chosen = Settings(session=SessionOptions(method="tsepm"), sensor=BOX.sensor)
    one, initiator = Session(chosen), make_initiator("tsepm", sensor=BOX.sensor)
    confirmed = 0
    for scan in simulated():
        one.add_scan(arrived(scan, stamp_ns=17), 0.0)
        (result,) = one.process()
        assert_same_tracks(result.new, initiator.process(scan))
        assert result.statistics == initiator.statistics
        assert (result.stamp, result.stamp_ns) == (scan.stamp, 17)
        assert result.core_seconds > 0
        confirmed += len(result.new)
    assert confirmed > 5
    assert one.dropped == Counter()
