"""Raises the density on rings of cells, where no square window contains the clutter alone.

Reverberation of the sea floor, of a layer or of side lobes lies on rings that are thinner than any
window. Each ring of cells has bounds like those of `adaptive_windows`, of the whole ring and then
of ever shorter arcs of it, so that a zone of clutter raises no other part of its rings. The density
of a cell is the larger one of both.
"""

from __future__ import annotations

import numpy as np

from tsepm_ros.environment.adaptive_windows import largest_around, root_bound
from tsepm_ros.environment.polar_grid import BlockSums
from tsepm_ros.environment.window_areas import CountedWindows, WindowSize
from tsepm_ros.numerics.arrays import FloatArray, IntArray

ARCS = 2, 4, 8
"""Parts of a ring that its arcs are."""
LEAST_RISE = 1.1
"""Factor, at least, by which a ring's root is above that of its thinnest cell: less is no harm."""


def raise_rings(
    root: FloatArray, counts: FloatArray, target: float, counted: CountedWindows
) -> None:
    """Raise the roots of the density of cells on dense rings.

    Parameters
    ----------
    root : (r, c) ndarray
        Root of the density times the number of scans in each cell, 1/m; changed in place.
    counts : (r, c) ndarray
        Detections of clutter in each cell in all scans.
    target : float
        Detections of an unknown target.
    counted : CountedWindows
    """
    low = root_bound(np.maximum(counts.sum(axis=1) - target, 0.0), -1.0)
    low *= counted.per_root_ring_area
    rings = np.flatnonzero(low > LEAST_RISE * root.min(axis=1))
    if not len(rings):
        return
    raised = np.repeat(low[rings, None], root.shape[1], axis=1)
    sums, areas = (BlockSums(part[rings], *_wrapping(counted)) for part in (counts, counted.seen))
    for size in _arcs(rings, counted):
        count = sums.windows(1, size.width, size.columns, slice(0, len(rings)))
        seen = areas.windows(1, size.width, size.columns, slice(0, len(rings)))
        per_root = counted.per_root_of(seen, size.width * counted.windows.grid.area[rings])
        bounds = root_bound(np.maximum(count - target, 0.0), -1.0), root_bound(count, 1.0)
        least, most = (largest_around(bound * per_root, size) for bound in bounds)
        raised = np.minimum(np.maximum(raised, least), most)
    root[rings] = np.maximum(root[rings], raised)


def _wrapping(counted: CountedWindows) -> tuple[bool, int]:
    """Whether rings are closed, and the columns by which arcs may reach beyond the last."""
    grid = counted.windows.grid
    return grid.wraps, grid.shape[1] - 1 if grid.wraps else 0


def _arcs(rings: IntArray, counted: CountedWindows) -> list[WindowSize]:
    """Arcs of the rings, the longest first."""
    grid, rows = counted.windows.grid, len(rings)
    columns = grid.shape[1]
    arcs = []
    for parts in ARCS:
        width = columns // parts
        if width >= 1:
            starts = columns if grid.wraps else columns - width + 1
            arcs.append(WindowSize(1, width, grid.wraps, rows, starts, slice(0, rows)))
    return arcs
