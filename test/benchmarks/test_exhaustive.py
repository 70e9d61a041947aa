"""The search of all states against a loop over them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exhaustive_search import StateGrid

from tsepm_ros.simulation import Simulator, load_scenario

SCENE = replace(load_scenario("box"), scans=3, clutter_box=(4800.0, 5200.0, 4900.0, 5400.0))
GRID = StateGrid(SCENE, step=50.0, max_speed=10.0)
SCANS = [one.scan for one in Simulator(SCENE, [1, 0])]
MAPS = np.array([GRID.scan_map(scan) for scan in SCANS])


def ratio(scan, place):
    """1 - p_d + p_d / lambda sum N(z; x) in the coordinates of the plane."""
    sensor, distance = SCENE.sensor, np.hypot(*place)
    total = 0.0
    for r, a in zip(scan.range, scan.azimuth, strict=True):
        errors = np.array([r - distance, a - np.arctan2(place[1], place[0])])
        sigmas = np.array([sensor.range_std_fraction * distance, sensor.azimuth_std])
        density = np.exp(-0.5 * ((errors / sigmas) ** 2).sum()) / (2 * np.pi * sigmas.prod())
        total += density / r
    p_d = sensor.detection_probability
    return 1 - p_d + p_d / sensor.clutter_density * total


def looped(end, velocity, appearing):
    """Likelihood ratio of one state, by its cell at the last scan and its cells a scan."""
    found = 0.0 if appearing else 1.0
    for index, scan in enumerate(SCANS):
        cell = np.array(end) - (len(SCANS) - 1 - index) * np.array(velocity)
        if (cell < 0).any() or (cell >= GRID.sigma.shape).any():
            return 0.0
        found = ratio(scan, GRID.cells[tuple(cell)]) * (found + appearing)
    return found


def test_a_scan_map_is_the_likelihood_ratio_in_every_cell():
    expected = [[ratio(SCANS[0], place) for place in row] for row in GRID.cells]
    np.testing.assert_allclose(MAPS[0], expected, rtol=1e-3)


@pytest.mark.parametrize("appearing", [False, True])
def test_the_evidence_is_the_mean_over_all_velocities(appearing):
    most = int(10.0 * SCENE.period / GRID.step)
    velocities = [
        (i, j)
        for i in range(-most, most + 1)
        for j in range(-most, most + 1)
        if np.hypot(i, j) * GRID.step <= 10.0 * SCENE.period
    ]
    expected = [
        [np.mean([looped((i, j), v, appearing) for v in velocities]) for j in range(10)]
        for i in range(8)
    ]
    np.testing.assert_allclose(
        GRID.evidence_maps(MAPS, appearing=appearing)[-1], expected, rtol=1e-3
    )


def test_the_sum_is_over_a_square_of_states():
    evidence = GRID.evidence_maps(MAPS, appearing=False)[-1]
    half = round(GRID.sigma[4, 5] / GRID.step)
    part = evidence[4 - half : 5 + half, 5 - half : 6 + half]
    sensor = SCENE.sensor
    unit = GRID.step**2 * sensor.clutter_density / sensor.detection_probability
    assert GRID.summed(evidence, 1.0)[4, 5] == pytest.approx(np.log(unit * part.sum()), rel=1e-5)


def test_a_target_in_clutter_free_scans_is_one_peak_at_its_place():
    clear = replace(
        load_scenario("box"),
        scans=6,
        clutter_box=(4000.0, 6000.0, 4000.0, 6000.0),
        sensor=replace(SCENE.sensor, detection_probability=0.999, clutter_density=1e-9),
    )
    grid = StateGrid(clear, step=25.0, max_speed=10.0)
    scans = list(Simulator(clear, [1, 0]))
    maps = np.array([grid.scan_map(one.scan) for one in scans])
    evidence = grid.evidence_maps(maps, appearing=False)[-1]
    (peak,) = grid.peaks(maps, evidence, reach=2.0, least=5.0, appearing=False)
    assert np.hypot(*(peak["position"] - scans[-1].truth[0, 0::2])) < 3.0 * peak["sigma"]
    np.testing.assert_allclose(peak["velocity"], [5.0, 0.0], atol=6.0)
