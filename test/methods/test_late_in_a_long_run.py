"""A scan after months means the same as soon after the start; `score` with another window."""

import numpy as np
import pytest
from support.builders import scan_at

from tsepm_ros import Scan, SensorModel, available_methods, make_initiator
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.tracks import ConfirmedTrack

LATE = 10**13
"""Scans and detections before; an array with an element for each does not fit into memory."""


SENSOR = SensorModel(range_std=5.0, range_std_fraction=0.0, azimuth_std=0.002)


def scans() -> list[Scan]:
    """A target that moves, among false detections."""
    rng = np.random.default_rng(5)
    made = []
    for k in range(24):
        target = np.array([1000.0, 300.0]) + 10.0 * k * np.array([3.0, -2.0]) + rng.normal(0, 3, 2)
        made.append(scan_at(10.0 * k, [target, *rng.uniform(-3000.0, 3000.0, (6, 2))]))
    return made


def tracks_of(method: str, first_scan: int) -> list[ConfirmedTrack]:
    """The tracks where the first scan has this number."""
    made = make_initiator(method, sensor=SENSOR, max_speed=6.0, hold_time=60.0)
    made.scan_index = first_scan - 1
    found = [track for scan in scans() for track in made.process(scan)]
    made.potential_tracks()
    return found + list(made.current)


@pytest.mark.parametrize("method", available_methods())
def test_numbers_of_scans_and_detections_may_be_large(method, monkeypatch):
    soon = tracks_of(method, 0)
    assert soon

    def begin_late(window: DetectionWindow) -> None:
        begin(window)
        window.first_id = LATE

    begin = DetectionWindow.__init__
    monkeypatch.setattr(DetectionWindow, "__init__", begin_late)
    late = tracks_of(method, LATE)
    assert len(late) == len(soon)
    for before, after in zip(soon, late, strict=True):
        np.testing.assert_array_equal(after.state, before.state)
        np.testing.assert_array_equal(after.covariance, before.covariance)
        assert after.hits == tuple((LATE + scan, row) for scan, row in before.hits)
