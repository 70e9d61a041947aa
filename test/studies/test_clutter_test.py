"""Kennedy's test over the tree of splits, without merging."""

import numpy as np
import pytest
from scipy.stats import chi2
from support.builders import AS_GIVEN, scan_at
from support.scenes import random_scene

from tsepm_ros import Scan, SensorModel, make_initiator


@pytest.mark.parametrize(("size", "found"), [(0.0101, 1), (0.0099, 0)])
def test_a_track_is_put_out_where_its_statistic_is_below_the_quantile(size, found):
    # 4 steps: f_2 = 2 lambda pi 4 step^2, with 8 degrees of freedom.
    density = 8e-6
    step = np.sqrt(chi2.ppf(0.01, 8) / (8.0 * np.pi * density))
    sensor = SensorModel(
        range_std=1.0, range_std_fraction=0.0, azimuth_std=1e-5, clutter_density=density
    )
    made = make_initiator("clutter_test", sensor=sensor, clutter_test_size=size, **AS_GIVEN)
    tracks = []
    for k in range(5):
        tracks += made.process(scan_at(12.0 * k, [(3000.0 + step * k, 0.0)]))
    assert len(tracks) == found
    for track in tracks:
        assert track.evaluation == pytest.approx(chi2.ppf(0.01, 8), rel=1e-6)


def test_a_density_that_is_wrong_or_uneven_does_not_matter_where_it_is_estimated():
    def confirmed(density: float, **options: str) -> int:
        sensor = SensorModel(max_range=5000.0, clutter_density=density)
        rule = {"min_hits": 4, "window": 5, "clutter_test_size": 0.2}
        made = make_initiator("clutter_test", sensor=sensor, **rule, **options)
        rng = np.random.default_rng(2)
        total = 0
        for k in range(30):  # 1e-5 in a box, nothing around it
            x, y = rng.uniform(2000.0, 3500.0, (2, rng.poisson(22.5)))
            tracks = made.process(Scan(12.0 * k, np.hypot(x, y), np.arctan2(y, x)))
            total += len(tracks) if k >= 10 else 0
        return total

    known = confirmed(1e-5, **AS_GIVEN)
    assert confirmed(1e-6, **AS_GIVEN) > 10 * known
    # 39 known: a true ratio of 1.5 stays below 2.5 with 99 %.
    assert 0.5 * known < confirmed(1e-6) < 2.5 * known


@pytest.mark.parametrize("seed", [3, 13])
def test_its_tracks_are_those_of_tsepm_before_merging(seed):
    scene = random_scene(seed)
    rule = {"min_hits": 3, "window": 4, "gate_probability": 0.99, "clutter_test_size": 0.5}
    made = make_initiator("clutter_test", sensor=SensorModel(**scene.sensor), **rule)
    other = make_initiator(
        "tsepm", sensor=SensorModel(**scene.sensor), evaluation="clutter_statistic", **rule
    )
    for scan in scene.as_scans():
        tracks = made.process(scan)
        other.process(scan)
        assert made.statistics.merged == 0
        for count in ("potential_tracks", "raw_confirmations", "pruned", "started", "terminated"):
            assert getattr(made.statistics, count) == getattr(other.statistics, count)
        assert len(tracks) == other.statistics.confirmed + other.statistics.merged
    assert other.totals.merged > 0
    assert made.reason(made.current[0])
