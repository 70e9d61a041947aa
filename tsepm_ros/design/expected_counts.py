r"""Theory of the splitting tree: expected potential tracks and raw confirmations per scan.

The theory is a chain of expected numbers per m^2, scan by scan, at each range :math:`r`. Clutter is
Poisson with :math:`\lambda`. The gate of a track whose last hit is :math:`k` scans old has the area
:math:`a_k(r)` of the part inside the disc of a circle of radius
:math:`v_{max} k T + \alpha\sigma(r)` (Eqs. 4-5), and expects :math:`\lambda a_k` detections.

*Tracks.* Let :math:`F(n, h, k)` be the expected density of potential tracks with :math:`n` scans
since the first hit, inclusive, and :math:`h` hits, the last of them :math:`k` scans before the next
scan. The published rules turn it into

- :math:`\lambda a_k F` tracks :math:`(n+1, h+1, 1)`: one child for each gated detection;
- :math:`e^{-\lambda a_k} F` tracks :math:`(n+1, h, k+1)`: only an empty gate leaves the parent;
- at :math:`h+1 = M` the children are raw confirmations; at :math:`n+1 = N` the others end.

These means are exact for a given density of starts, since every scan's clutter is independent of
the tracks that meet it. A start thus has :math:`\prod \lambda a` paths: tracks of :math:`j` hits
grow as :math:`\lambda^j`, raw confirmations as :math:`\lambda^M`, as long as starts grow as
:math:`\lambda`.

*Starts.* Starts do not grow likewise: only detections outside every gate start a track. Let
:math:`G(n, h, k)` be the density of *distinct* last hits by the state of the path that lives
longest. The number of gates over a point is taken as Poisson with mean :math:`\mu = \sum a_k G`, so
that :math:`\lambda e^{-\mu}` detections start a track; a covered detection continues the path of
fewest hits among its gates: :math:`P(\text{fewest} = h) = e^{-\mu_{<h}} (1 - e^{-\mu_h})`. A last
hit whose paths are all confirmed has no gate. This mean field ignores that gates cluster.

Two consequences: where gates overlap (:math:`\lambda a > 1`), starts fall with clutter while each
start's tree grows. Starts come in waves: nearly every detection of the first scan starts a track,
the trees cover the disc, and when all their paths are confirmed in scan M, the next wave starts.
The chain is for clutter alone; a target adds its own paths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.sensing.conversion import major_sigma, position_covariance
from tsepm_ros.sensing.sensor import SensorModel

RINGS = 60
"""Rings into which the disc is divided."""


@dataclass(frozen=True, kw_only=True)
class Gating:
    """Parameters that determine the size of the gates.

    Attributes
    ----------
    sensor : SensorModel
    max_speed : float
        v_max, m/s.
    interval : float
        T, s.
    gate_probability : float
        P.
    """

    sensor: SensorModel
    max_speed: float
    interval: float
    gate_probability: float


@dataclass(frozen=True)
class Expected:
    """Expected numbers over the disc, per scan from the first scan on.

    Attributes
    ----------
    potential : (scans,) ndarray
        Potential tracks held after the scan.
    started : (scans,) ndarray
        Potential tracks started.
    raw : (scans,) ndarray
        Raw confirmations, before any limit.
    """

    potential: FloatArray
    started: FloatArray
    raw: FloatArray


def overlap_area(distance: FloatArray, radius: FloatArray, disc: float) -> FloatArray:
    """Area of the part of a circle within a disc about the origin.

    Parameters
    ----------
    distance, radius : (...) ndarray
        Distance of the circle's centre from the origin, above 0, and the circle's radius, m.
    disc : float
        Radius of the disc, m, at least as large as any circle's.
    """
    crossing = distance + radius > disc
    at_circle = (distance**2 + radius**2 - disc**2) / (2.0 * distance * radius)
    at_disc = (distance**2 + disc**2 - radius**2) / (2.0 * distance * disc)
    kite = (
        (disc + radius - distance)
        * (distance + radius - disc)
        * (distance - radius + disc)
        * (distance + radius + disc)
    )
    lens = (
        radius**2 * np.arccos(np.clip(at_circle, -1.0, 1.0))
        + disc**2 * np.arccos(np.clip(at_disc, -1.0, 1.0))
        - 0.5 * np.sqrt(np.maximum(kite, 0.0))
    )
    return np.where(crossing, lens, np.pi * radius**2)


def error_radius(gating: Gating, ranges: FloatArray) -> FloatArray:
    """Part of the gate's radius due to the errors, ``alpha sigma_Rmax``, (r,), m."""
    sensor = gating.sensor
    covariance = position_covariance(
        ranges, np.zeros_like(ranges), sensor.range_variance(ranges), sensor.azimuth_std
    )
    return gate_factor(gating.gate_probability) * major_sigma(covariance)


def gate_areas(gating: Gating, ranges: FloatArray, window: int) -> FloatArray:
    """Areas a_k of the gates, k = 1 ... N, at each range, (r, N), m^2."""
    disc = gating.sensor.max_range
    reach = gating.max_speed * gating.interval * np.arange(1, window + 1)
    radius = reach + error_radius(gating, ranges)[:, None]
    return overlap_area(ranges[:, None], np.minimum(radius, disc), disc)


def expected_counts(gating: Gating, min_hits: int, window: int, scans: int) -> Expected:
    """Follow the chain from an empty start.

    A sector has its share of the disc; the loss of gate area beyond its sides is neglected.

    Parameters
    ----------
    gating : Gating
    min_hits, window : int
        M and N.
    scans : int
        Number of scans.
    """
    sensor = gating.sensor
    edges = np.linspace(sensor.min_range, sensor.max_range, RINGS + 1)
    ring = 0.5 * sensor.sector_width * np.diff(np.square(edges))
    areas = gate_areas(gating, 0.5 * (edges[1:] + edges[:-1]), window)
    shape = (RINGS, window, min_hits - 1, window)  # ring, n - 1, h - 1, k - 1
    tracks, last_hits = np.zeros(shape), np.zeros(shape)
    counts = np.zeros((3, scans))
    density = sensor.clutter_density
    for scan in range(scans):
        tracks, last_hits, started, raw = _next_scan(tracks, last_hits, areas, density)
        counts[:, scan] = ring @ tracks.sum(axis=(1, 2, 3)), ring @ started, ring @ raw
    return Expected(*counts)


def _next_scan(
    tracks: FloatArray, last_hits: FloatArray, areas: FloatArray, density: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """F and G after one more scan, and the densities of starts and raw confirmations."""
    children = np.einsum("rnhk,rk->rnh", tracks, density * areas)
    covering = np.einsum("rnhk,rk->rnh", last_hits, areas)
    started = density * np.exp(-covering.sum(axis=(1, 2)))
    continued = density * _fewest_hits(covering)
    empty = np.exp(-density * areas)
    return (
        _next_states(tracks, empty, children, started),
        _next_states(last_hits, empty, continued, started),
        started,
        children[:, :, -1].sum(axis=1),
    )


def _next_states(
    old: FloatArray, empty: FloatArray, hit: FloatArray, started: FloatArray
) -> FloatArray:
    """States after a scan, from states with empty gates, states with hits and starts."""
    new = np.zeros_like(old)
    new[:, 1:, :, 1:] = old[:, :-1, :, :-1] * empty[:, None, None, :-1]
    new[:, 1:, 1:, 0] = hit[:, :-1, :-1]  # with M hits they are confirmed, not kept
    new[:, 0, 0, 0] = started
    new[:, -1] = 0.0  # N scans without M hits
    return new


def _fewest_hits(covering: FloatArray) -> FloatArray:
    """Probability that the covering path of fewest hits is in state (n, h), (r, n, h)."""
    by_hits = covering.sum(axis=1)
    fewer = np.cumsum(by_hits, axis=1) - by_hits
    probability = np.exp(-fewer) * -np.expm1(-by_hits)
    share = np.divide(
        covering,
        by_hits[:, None],
        out=np.zeros_like(covering),
        where=by_hits[:, None] > 0.0,
    )
    return share * probability[:, None]
