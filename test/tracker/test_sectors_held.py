"""Scans of parts of a turn: a target elsewhere is not missed."""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros import Scan, SensorModel, make_initiator


def test_parts_of_a_turn_that_look_elsewhere_end_no_track():
    # 16 parts a turn; the target is missed in four looks at it, which are 64 scans.
    parts, rng = 16, np.random.default_rng(3)
    sensor = SensorModel(range_std=0.5, range_std_fraction=0.0, azimuth_std=0.005, max_range=100.0)
    initiator = make_initiator("score", sensor=sensor, max_speed=2.0, plots="off", window=64)
    ended = {}
    for number in range(parts * 24):
        turn, part = divmod(number, parts)
        here = int(part == 8 and turn not in range(14, 18))
        range_ = 50.0 + 0.5 * rng.standard_normal(here)
        azimuth = math.pi / parts + 0.005 * rng.standard_normal(here)
        width = 2.0 * math.pi / parts
        swept = ((part - 8) * width, width)
        initiator.process(Scan(number / 20.0, range_, azimuth, swept=swept))
        ended |= initiator.maintenance.ended
    assert not ended
    assert initiator.current.track_id.tolist() == [0]
