"""Counts of a scan, and their sums."""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.numerics.rows import changed


@dataclass(frozen=True)
class ScanStatistics:
    """Counts of one scan, or summed over scans.

    Attributes
    ----------
    scans : int
        Scans counted.
    detections : int
        Detections in the sensor's coverage.
    potential_tracks : int
        Potential tracks held after the scan (in a sum: the most held at once).
    hopeless_tracks : int
        Further paths, which can no longer pass; only their counts and gates are kept (in a sum:
        the most at once).
    started : int
        Potential tracks started.
    terminated : int
        Potential tracks ended by the method's own rule.
    raw_confirmations : int
        Tracks that reached confirmation, before pruning and merging; hopeless ones included.
    pruned : int
        Of these, removed by their evaluation; hopeless ones included.
    merged : int
        Of these, removed by merging into another.
    confirmed : int
        Confirmed tracks that were published.
    cut_potential_tracks, cut_confirmations : int
        Removed because a limit was reached. Potential tracks count once, when they are cut, as does
        a pair of gate and detection that was left out; the confirmations are all that would have
        come of the potential tracks cut in this and in earlier scans.
    outside_coverage : int
        Detections received outside the coverage; they are not used.
    plots : int
        Plots made of the detections in the coverage: fewer where several detections of one target
        became one plot.
    on_land : int
        Detections in the coverage that are on land; they are not used.
    """

    scans: int = 0
    detections: int = 0
    potential_tracks: int = 0
    hopeless_tracks: int = 0
    started: int = 0
    terminated: int = 0
    raw_confirmations: int = 0
    pruned: int = 0
    merged: int = 0
    confirmed: int = 0
    cut_potential_tracks: int = 0
    cut_confirmations: int = 0
    outside_coverage: int = 0
    plots: int = 0
    on_land: int = 0

    def __add__(self, other: ScanStatistics) -> ScanStatistics:
        """Sum of the counts; of the tracks held the larger."""
        one, two = vars(self), vars(other)
        values = {name: one[name] + two[name] for name in one}
        for held in ("potential_tracks", "hopeless_tracks"):
            values[held] = max(one[held], two[held])
        return changed(self, **values)
