"""Tracks that repeat an older one end, and no others."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from support.builders import detections
from support.held import P_D, ids, step, tracks

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.maintenance.track_maintenance import TrackMaintenance


def test_a_target_that_is_started_again_and_again_is_held_once():
    initiator = make_initiator("tsepm", sensor=SensorModel(range_std=15.0, range_std_fraction=0.0))
    rng = np.random.default_rng(1)
    for scan in range(300):
        x, y = 3000.0 + 0.5 * scan, 2000.0
        seen = rng.random() < P_D
        polar = math.hypot(x, y), math.atan2(y, x)
        initiator.process(
            Scan(
                12.0 * scan,
                [polar[0] + 15.0 * rng.standard_normal()] * seen,
                [polar[1] + initiator.sensor.azimuth_std * rng.standard_normal()] * seen,
            )
        )
    assert initiator.totals.confirmed > 20
    assert 1 <= len(initiator.hold.current) <= 3


def test_targets_that_cross_stay_two(straight):
    hold = TrackMaintenance(1e6)
    hold.add(tracks(1), 0.9)
    hold.add(replace(tracks(2), state=np.array([[3000.0, -5.0, 1300.0, 0.0]])), 0.9)
    for scan in range(1, 30):
        time = 12.0 * scan
        points = [[2000.0 + 5.0 * time, 1000.0], [3000.0 - 5.0 * time, 1300.0]]
        step(hold, time, detections(points, time), P_D)
    assert ids(hold) == [1, 2]
