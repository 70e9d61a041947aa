"""Which detections are in the gates of held tracks."""

from __future__ import annotations

import math

import numpy as np
from support.held import CLUTTER, P_D, tracks

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import convert


def test_a_fast_target_seen_exactly_is_not_lost_by_the_time_of_its_echo():
    sensor = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=1e-3)
    hold = TrackMaintenance(120.0)
    hold.add(tracks(1), 0.9)
    for scan in range(1, 20):
        stamp, lag = 12.0 * scan, 3.3
        found = convert(
            Scan(
                stamp,
                [math.hypot(2000.0 + 5.0 * (stamp + lag), 1000.0)],
                [math.atan2(1000.0, 2000.0 + 5.0 * (stamp + lag))],
                time_offset=[lag],
            ),
            sensor,
            scan,
        )
        hold.step(stamp, found, np.full(1, CLUTTER), lambda x: np.full(len(x), P_D), sensor, 20.0)
        assert hold.held.existence[0] > 0.9
    (track,) = hold.current
    assert np.hypot(*(track.position - [2000.0 + 5.0 * stamp, 1000.0])) < 5.0
