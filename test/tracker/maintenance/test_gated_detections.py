"""Which detections are in the gates of held tracks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, detections
from support.held import CLUTTER, P_D, holding, step, tracks

from tsepm_ros import Scan, SensorModel
from tsepm_ros.tracker.maintenance import data_association
from tsepm_ros.tracker.maintenance.data_association import gate
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import convert, covariance_at


@pytest.mark.parametrize(("sigmas", "inside"), [(3.03, True), (3.04, False)])
def test_the_gate_holds_its_probability(straight, sigmas, inside):
    # sqrt(-2 ln(1 - 0.99)) = 3.035 deviations of the innovation.
    centre = np.array([2060.0, 1000.0])
    predicted = holding(1)
    step(predicted, 12.0)
    spread = predicted.current.covariance[0][0::2, 0::2]
    spread = spread + covariance_at(detections([centre], 12.0), centre[None], FIXED_RANGE_ERROR)[0]
    offset = sigmas * np.linalg.cholesky(spread) @ [0.6, 0.8]
    explained = step(holding(1), 12.0, detections([centre + offset], 12.0), P_D)
    assert (explained[0] > 1e-9 * CLUTTER) == inside


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


def test_with_range_rates_each_detection_updates_by_its_own_error_at_its_own_time():
    # The nearest is exact, another is not, and comes 8 s later, where the velocity counts too.
    modes = np.tile(tracks(1).state[:, None], (1, 3, 1))
    spread = np.tile(tracks(1).covariance[:, None], (1, 3, 1, 1))
    sensor = SensorModel(
        range_std=1.0, range_std_fraction=0.0, azimuth_std=0.02, range_rate_std=0.5
    )
    scan = Scan(
        0.0,
        np.hypot([2000.0, 2040.0], 1000.0),
        np.arctan2(1000.0, [2000.0, 2040.0]),
        time_offset=[0.0, 8.0],
        azimuth_std=[1e-4, 0.02],
        features={"range_rate": [4.5, 4.5]},
    )
    found = convert(scan, sensor, 0)
    gated = gate(modes, spread, modes[:, :2], 0.0, found, sensor)
    states, covariances = gated.updated
    assert len(states) == 6
    assert (np.linalg.eigvalsh(covariances) > 0.0).all()
    of_pairs = gated.row[0, data_association.SEEKER[gated.pairs[1]], gated.pairs[2]]
    for row in (0, 1):
        alone = gate(modes, spread, modes[:, :2], 0.0, found[[row]], sensor)
        np.testing.assert_allclose(states[of_pairs == row], alone.updated[0])
        np.testing.assert_allclose(covariances[of_pairs == row], alone.updated[1])
        likelihood = gated.likelihood[0, :, gated.row[0, 0] == row]
        np.testing.assert_allclose(likelihood, alone.likelihood[0].T)
