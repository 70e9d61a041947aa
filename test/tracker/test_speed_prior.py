"""The evidence under the velocity prior that ends at v_max; plain loops: `test_confirmation`."""

from __future__ import annotations

from support.builders import scan_at
from support.score_scenes import score

from tsepm_ros import SensorModel

SENSOR = SensorModel(range_std=10.0, range_std_fraction=0.0, azimuth_std=0.005, max_range=6000.0)


def first_score(speed: float, **options) -> float:
    """Evidence of the first track on a target without clutter; 0 without a track."""
    initiator = score(SENSOR, **options)
    for k in range(8):
        for track in initiator.process(scan_at(12.0 * k, [(3000.0 + 12.0 * speed * k, 500.0)])):
            return float(track.score)
    return 0.0


def test_what_is_faster_than_the_maximum_does_not_start():
    # The filter's Gaussian prior, of 5 m/s, allows 13 m/s with 3 % of its mass.
    assert first_score(8.0) > 0.0
    assert first_score(13.0) == 0.0
    assert first_score(13.0, max_speed=15.0) > 0.0
