"""Bearings that are joined to turns and passes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tsepm_ros.session.image_turns import ImagePing, ImageTurns

CELLS = np.linspace(1.0, 5.0, 5)


def bearing(stamp, azimuth, level, cells=CELLS):
    azimuths = np.atleast_1d(np.array(azimuth, float))
    table = np.full((len(azimuths), len(cells)), float(level))
    return ImagePing(round(stamp * 1e9), "sonar", cells, azimuths, table, is_part=True)


def turned(turns, number, steps, seconds=2.0, begin=0.3, direction=1.0):
    """Pings of a beam that turns; intensities count its steps, from 1 on."""
    made = []
    for step in range(number * steps):
        angle = begin + direction * 2.0 * math.pi * step / steps
        azimuth = (angle + math.pi) % (2.0 * math.pi) - math.pi
        made += turns.add(bearing(seconds * step / steps, azimuth, step + 1))
    return made


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("seconds", [0.5, 2.9, 30.0])
def test_the_bearings_of_each_turn_are_one_ping_on_even_azimuths(direction, seconds):
    pings = turned(ImageTurns(), 4, 40, seconds, direction=direction)
    assert len(pings) == 2, "the first turn shows the time of a turn, the last is open"
    for ping in pings:
        assert ping.intensity.shape == (40, 5)
        assert np.isfinite(ping.intensity).all()
        assert not ping.is_part
        np.testing.assert_allclose(np.diff(ping.azimuth), 2.0 * math.pi / 40)
        # Each bearing is where the beam was, at its own time.
        step = ping.intensity[:, 0] - 1
        angle = 0.3 + direction * 2.0 * math.pi * step / 40
        assert np.abs(np.angle(np.exp(1j * (ping.azimuth - angle)))).max() < 1e-4
        stamp = 1e-9 * ping.stamp_ns + ping.time_offset
        np.testing.assert_allclose(stamp, seconds * step / 40, atol=1e-6)


def test_a_missing_bearing_is_not_measured():
    turns, pings = ImageTurns(), []
    for step in range(160):
        if step != 100:
            azimuth = (2.0 * math.pi * step / 40 + math.pi) % (2.0 * math.pi) - math.pi
            pings += turns.add(bearing(0.05 * step, azimuth, 1.0))
    lost = [np.isnan(ping.intensity).all(axis=1).sum() for ping in pings]
    assert sorted(lost) == [0] * (len(pings) - 1) + [1]
    assert {len(ping.azimuth) for ping in pings} == {40}


def test_passes_over_a_sector_are_pings_of_equal_size():
    turns, pings = ImageTurns(), []
    there = np.linspace(-0.6, 0.6, 25)
    for step, azimuth in enumerate(np.concatenate([there, there[::-1]] * 4)):
        pings += turns.add(bearing(0.1 * step, azimuth, 1.0))
    assert len(pings) >= 4
    assert {ping.intensity.shape for ping in pings[1:]} == {(25, 5)}
    for ping in pings[1:]:
        assert ping.azimuth[[0, -1]] == pytest.approx([-0.6, 0.6], abs=0.06)


def test_sectors_of_spokes_are_joined_like_single_bearings():
    turns, pings = ImageTurns(), []
    for part in range(64):
        start = 2.0 * math.pi * part / 16
        azimuth = start + 2.0 * math.pi / 256 * np.arange(16)
        azimuth = azimuth - 2.0 * math.pi * np.floor((start + math.pi) / (2.0 * math.pi))
        pings += turns.add(bearing(0.15 * part, azimuth, 1.0))
    assert {ping.intensity.shape for ping in pings} == {(256, 5)}
    assert all(np.isfinite(ping.intensity).all() for ping in pings)


def test_a_change_of_range_starts_over_and_counts_what_is_lost():
    turns = ImageTurns()
    turned(turns, 2, 40)
    before = turns.unused
    turns.add(bearing(100.0, 0.0, 1.0, 2.0 * CELLS))
    assert turns.unused > before


def test_a_whole_ping_passes_as_it_is():
    ping = ImagePing(0, "sonar", CELLS, np.array([0.0, 0.1]), np.ones((2, 5)))
    assert ImageTurns().add(ping) == [ping]
