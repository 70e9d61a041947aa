"""Shape of extended targets, and the detections that it explains.

Held tracks of targets with several detections a ping.

Hulls: held tracks of targets with highlights farther apart than a plot's extent.

The detections around a held track that are its hull's scatter about their centroid with a
covariance X, learned from ping to ping with the weights ``g N(d; X) / (g N(d; X) + lambda)``, with
g the mean number of the hull's detections and lambda the clutter density: one step of expectation
maximisation a ping. A hull is what is longer than a plot and has detections all along it. Two
targets side by side have nearly all of theirs in two places, seen from either's track.

Clutter lies around every track, too. N plots lie in the gate ``d' X^-1 d <= GATE`` and beyond the
track's own plot, where E of clutter are expected; both fade from ping to ping. A hull needs::

    N > MARGIN E,    N >= LEAST_NUMBER

Detections near another held track do not count: several targets may lie along a line by chance.

In a later ping the detections within X of a hull's track are one plot, whose centroid wanders with
X over their number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.tracker.clustering import PlotExtent, placed
from tsepm_ros.tracker.maintenance.confirmed_tracks import HeldTracks
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.tracks import TrackArrays

FURTHER_PLOTS = 1.0
"""Mean number of plots, beside its own, of a target with several detections a ping: a choice."""


def further_plots(
    held: HeldTracks, positions: FloatArray, extent: PlotExtent, sensor_position: FloatArray
) -> FloatArray:
    """Density of plots that targets of an extent may have beside their own.

    `FURTHER_PLOTS` of each target that exists, uniform within the extent of where it is.

    Parameters
    ----------
    held : HeldTracks
    positions : (d,) ndarray
        m.
    extent : PlotExtent
    sensor_position : (2,) ndarray
        m.

    Returns
    -------
    (d,) ndarray
        1/m^2.
    """
    density = np.zeros(len(positions))
    if not len(positions) or not len(held):
        return density
    centre = held.tracks.state[:, 0::2] - sensor_position
    range_ = np.hypot(*centre.T)
    sight = centre / np.maximum(range_, 1e-9)[:, None]
    across = extent.across_at(range_)
    area = 4.0 * np.maximum(extent.along, 1e-9) * np.maximum(across, 1e-9)
    found = cKDTree(positions).query_ball_point(
        centre + sensor_position, np.hypot(extent.along, across)
    )
    for track, rows in enumerate(found):
        apart = positions[rows] - sensor_position - centre[track]
        east, north = sight[track]
        inside = np.abs(apart @ sight[track]) <= extent.along
        inside &= np.abs(apart @ np.array([-north, east])) <= across[track]
        density[rows] += inside * FURTHER_PLOTS * held.existence[track] / area[track]
    return density


MEMORY = 20.0
"""Pings that count: older ones fade."""
START_STD = 20.0
"""Scatter before the first ping, m on each axis."""
START_FREEDOM = 2.0
"""Degrees of freedom for which that counts."""
LEAST_STD = 0.5
"""Scatter on each axis, at least, m."""
START_NUMBER = 4.0
"""Detections of a hull in a ping before the first: a choice."""
GATE = 6.0
"""Squared distance, of X, within which a detection is the hull's; the end of a line has 3."""
MARGIN = 1.5
"""Factor within which clutter around a track may be denser than it is known: a choice."""
LEAST_NUMBER = 2.0
"""Plots beside the track's own, over some `MEMORY` pings, that a hull has at least."""
LEAST_FREEDOM = 10.0
"""Degrees of freedom from which on a hull is told from two targets."""
PLACE = 6.0
"""Width of a place in which a target's detections lie, m; at least three standard deviations."""
MOST_IN_PLACES = 0.75
"""Share of a hull's detections in the two places that have most, at most: a choice."""
REMEMBERED = 100
"""Detections that are counted in places."""
MOST_TRACKS = 1000
"""Held tracks whose hulls are learned, the oldest: bounds the time."""
WAITING_SCANS = 16
"""Scans for which other starts beside a track wait: its hull is being learned.

From the track's first hit as long as it is not learned.
"""


@dataclass(frozen=True)
class Hull:
    """What was learned around a held track.

    Attributes
    ----------
    freedom, scatter : float, (2, 2) ndarray
        Degrees of freedom, and sum of squares about the centroids, m^2.
    scans : int
        Pings since the first.
    pings, number : float
        Pings with several detections, and their detections; older ones fade.
    beyond, expected : float
        N and E.
    apart, weight : (m, 2), (m,) ndarray
        The last detections, seen from the track, m, and the weight of each.
    """

    freedom: float
    scatter: FloatArray
    scans: int = 0
    beyond: float = 0.0
    expected: float = 0.0
    pings: float = 1.0
    number: float = START_NUMBER
    apart: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    weight: FloatArray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def unknown(cls) -> Hull:
        """Before the first ping."""
        return cls(START_FREEDOM, START_FREEDOM * START_STD**2 * np.eye(2))

    @property
    def covariance(self) -> FloatArray:
        """X, (2, 2), m^2."""
        return np.asarray(self.scatter / self.freedom + LEAST_STD**2 * np.eye(2))

    @property
    def length(self) -> float:
        """Length of a line that scatters like that, m."""
        return float(np.sqrt(12.0 * np.linalg.eigvalsh(self.covariance)[1]))

    @property
    def decided(self) -> bool:
        """Whether enough is known to tell a hull from clutter and from targets side by side."""
        return self.freedom >= LEAST_FREEDOM and self.beyond_clutter

    @property
    def open(self) -> bool:
        """Whether that may still become known."""
        return not self.decided and self.scans <= WAITING_SCANS

    @property
    def beyond_clutter(self) -> bool:
        """Whether there are more plots beside the track's own than clutter explains."""
        return self.beyond > MARGIN * self.expected and self.beyond >= LEAST_NUMBER

    def found(self, longest_plot: float, place: float) -> bool:
        """Whether it is a hull, longer than plots are.

        Parameters
        ----------
        longest_plot : float
            m.
        place : float
            Width of a place in which a target's detections lie, m.
        """
        if not self.decided or self.length <= longest_plot:
            return False
        axis = np.linalg.eigh(self.covariance)[1][:, 1]
        return in_two_places(self.apart @ axis, self.weight, place) <= MOST_IN_PLACES

    def gate(self, apart: FloatArray, std: float = 0.0) -> BoolArray:
        """Which positions (n, 2), seen from the track and with errors (m), are within it, (n,)."""
        return _squared(apart, self.covariance + std**2 * np.eye(2)) <= GATE

    def after(
        self,
        apart: FloatArray,
        label: IntArray,
        clutter: FloatArray,
        density: float,
        plot_radius: float,
    ) -> Hull:
        """With the detections of a ping.

        Parameters
        ----------
        apart : (n, 2) ndarray
            Seen from the track, m.
        label : (n,) ndarray of int
            Group of each: a plot.
        clutter : (n,) ndarray
            Clutter density at each, plots per m^2.
        density : float
            Clutter density around the track, plots per m^2; NaN: not known, and nothing is counted.
        plot_radius : float
            Distance within which the track's own plot lies, m.
        """
        covariance = self.covariance
        squared = _squared(apart, covariance)
        near = squared <= GATE
        apart, label, squared, clutter = apart[near], label[near], squared[near], clutter[near]
        area = 2.0 * math.pi * math.sqrt(np.linalg.det(covariance))
        kept = 1.0 - 1.0 / MEMORY
        counted = replace(self, scans=self.scans + 1)
        if math.isfinite(density):
            beyond = np.unique(label[np.hypot(*apart.T) > plot_radius])
            minor, major = np.sqrt(GATE * np.linalg.eigvalsh(covariance)).tolist()
            counted = replace(
                counted,
                beyond=kept * self.beyond + len(beyond),
                expected=kept * self.expected + density * area_outside(minor, major, plot_radius),
            )
        likely = self.number / self.pings / area * np.exp(-0.5 * squared)
        weight = likely / (likely + clutter)
        total = float(weight.sum())
        if total <= 1.0:
            return counted
        off = apart - weight @ apart / total
        return replace(
            counted,
            freedom=kept * self.freedom + total - 1.0,
            scatter=kept * self.scatter + (off * weight[:, None]).T @ off,
            pings=kept * self.pings + 1.0,
            number=kept * self.number + total,
            apart=np.concatenate([self.apart, apart])[-REMEMBERED:],
            weight=np.concatenate([self.weight, weight])[-REMEMBERED:],
        )


def _squared(apart: FloatArray, covariance: FloatArray) -> FloatArray:
    """Squared distances of (n, 2), (n,)."""
    return np.asarray(np.einsum("ni,in->n", apart, np.linalg.solve(covariance, apart.T)))


def area_outside(minor: float, major: float, radius: float) -> float:
    """Area of an ellipse of these half axes outside a disc about its centre.

    Exact where the disc lies in the ellipse; of a thin one the part beyond the radius along it.
    """
    if radius <= minor:
        return math.pi * (minor * major - radius**2)
    part = min(radius / major, 1.0)
    inside = 2.0 * (math.asin(part) + part * math.sqrt(1.0 - part**2))
    return minor * major * (math.pi - inside)


def in_two_places(along: FloatArray, weight: FloatArray, width: float) -> float:
    """Largest share of weights (n,) in two intervals of a width, at positions (n,) on a line."""
    order = np.argsort(along)
    along, sums = along[order], np.concatenate([[0.0], np.cumsum(weight[order])])
    end = np.searchsorted(along, along + width, side="right")
    inside = sums[end] - sums[:-1]
    # The best interval that begins at a position or later.
    later = np.append(np.maximum.accumulate(inside[::-1])[::-1], 0.0)
    return float((inside + later[end]).max(initial=0.0) / max(sums[-1], 1e-9))


class Hulls:
    """Learns the hulls of held tracks, and joins the groups of detections that are one hull's."""

    def __init__(self) -> None:
        self._hulls: dict[int, Hull] = {}
        self._found: dict[int, Hull] = {}

    def learn(
        self,
        scan: Scan,
        label: IntArray,
        clutter: FloatArray,
        tracks: TrackArrays,
        around: FloatArray,
        extent: PlotExtent,
        azimuth_std: float,
    ) -> None:
        """Learn from the detections of a ping around the held tracks.

        What is within an older track's hull, or near another track, is that one's. Of very many
        tracks, only the oldest learn.

        Parameters
        ----------
        scan : Scan
            n detections.
        label : (n,) ndarray of int
            Group of each: a plot.
        clutter : (n,) ndarray
            Clutter density at each, plots per m^2.
        tracks : TrackArrays
            Held, in the order of their confirmation, at the scan's stamp: k.
        around : (k,) ndarray
            Clutter density around each, plots per m^2; NaN: not known yet.
        extent : PlotExtent
            Of a plot.
        azimuth_std : float
            rad.
        """
        position, free = placed(scan), np.ones(len(scan), bool)
        sensor = np.reshape(scan.sensor_pose, (-1, 3))[0, :2] if len(scan) else np.zeros(2)
        learned, found = {}, {}
        apart = np.hypot(*(tracks.state[:, 0::2] - sensor).T)
        width = np.maximum(PLACE, 3.0 * azimuth_std * apart)
        owner = _owner(position, tracks.state[:, 0::2], 0.5 * np.maximum(width, extent.along))
        radius = 0.5 * np.maximum(extent.along, extent.across_at(apart))
        for row, track_id in enumerate(tracks.track_id[:MOST_TRACKS].tolist()):
            place = tracks.state[row, 0::2]
            own = free & ((owner == row) | (owner < 0))
            hull = self._hulls.get(track_id, Hull.unknown())
            hull = hull.after(
                position[own] - place, label[own], clutter[own], float(around[row]), radius[row]
            )
            if hull.found(extent.along, float(width[row])):
                free &= ~hull.gate(position - place)
                found[track_id] = hull
            learned[track_id] = hull
        self._hulls, self._found = learned, found

    def joined(
        self, scan: Scan, label: IntArray, tracks: TrackArrays
    ) -> tuple[IntArray, FloatArray]:
        """Groups of detections with those within a hull as one.

        Parameters
        ----------
        scan : Scan
            n detections.
        label : (n,) ndarray of int
            Group of each.
        tracks : TrackArrays
            Held, in the order of their confirmation, at the scan's stamp.

        Returns
        -------
        label : (n,) ndarray of int
            The first member of each one's group.
        wander : (n, 2) ndarray
            Variance of where on the hull it arises, along and across the line of sight, m^2.
        """
        position, label = placed(scan), label.copy()
        wander, free = np.zeros((len(scan), 2)), np.ones(len(scan), bool)
        sensor = np.reshape(scan.sensor_pose, (-1, 3))[:, :2]
        sight = position - sensor
        sight = sight / np.maximum(np.hypot(*sight.T), 1e-9)[:, None]
        for track_id, place in zip(tracks.track_id.tolist(), tracks.state[:, 0::2], strict=True):
            hull = self._found.get(track_id)
            if hull is None:
                continue
            inside = free & hull.gate(position - place)
            if not inside.any():
                continue
            # Of a group that is cut, the rest stays a group.
            rest = np.flatnonzero(~inside)
            _, first, group = np.unique(label[rest], return_index=True, return_inverse=True)
            label[rest] = rest[first][group]
            label[inside] = np.flatnonzero(inside)[0]
            u = sight[inside]
            along = np.einsum("ni,ij,nj->n", u, hull.covariance, u)
            wander[inside] = np.stack([along, np.trace(hull.covariance) - along], axis=1)
            free &= ~inside
        return label, wander

    def waiting(
        self, new: TrackArrays, held: TrackArrays, reach: float, interval: float
    ) -> BoolArray:
        """Which new tracks wait.

        Those beside a young track whose hull is not learned yet, or beside an earlier one of the
        new; and those within a hull.

        Parameters
        ----------
        new, held : TrackArrays
            n and k tracks at one stamp.
        reach : float
            Distance, m, within which they may be of one target.
        interval : float
            Median time between scans, s.

        Returns
        -------
        (n,) ndarray of bool
        """
        ids, position = held.track_id.tolist(), held.state[:, 0::2]
        aged = held.age > WAITING_SCANS * interval
        young = np.array(
            [
                self._hulls[one].open if one in self._hulls else not old
                for one, old in zip(ids, aged, strict=True)
            ],
            bool,
        )
        places = np.ascontiguousarray(new.state[:, 0::2])
        waits = np.zeros(len(new), bool)
        if young.any():
            waits = cKDTree(position[young]).query(places)[0] < reach
        rest = np.flatnonzero(~waits)
        waits[rest] = beside_earlier(places[rest], reach)
        for track_id, place in zip(ids, position, strict=True):
            if track_id in self._found:
                waits |= self._found[track_id].gate(places - place, PLACE)
        return waits


def _owner(position: FloatArray, places: FloatArray, reach: FloatArray) -> IntArray:
    """The nearest of tracks (k, 2) to each position (n, 2), by row; -1 beyond its reach (k,), m."""
    if not len(places) or not len(position):
        return np.full(len(position), -1)
    away, row = cKDTree(places).query(position)
    return np.where(away <= reach[row], row, -1)


def beside_earlier(positions: FloatArray, reach: float) -> BoolArray:
    """Which positions (n, 2) are within a reach, m, of an earlier one that itself is not."""
    beside = np.zeros(len(positions), bool)
    if len(positions) < 2:
        return beside
    nearest = cKDTree(positions).query(positions, k=[2])[0][:, 0]
    left = np.flatnonzero(nearest < reach)
    while len(left):
        first, left = positions[left[0]], left[1:]
        near = np.hypot(*(positions[left] - first).T) < reach
        beside[left[near]] = True
        left = left[~near]
    return beside
