"""The history behind a session's diagnostics: arrivals, latencies and counts of the window.

Counts are totals since the start or the last reset; a level covers the last
`DiagnosticsOptions.window` only.
"""

from __future__ import annotations

import math
from collections import deque

from tsepm_ros.diagnostics.entries import statuses
from tsepm_ros.diagnostics.health_figures import (
    LAST_SCANS,
    Arrival,
    Connections,
    Counts,
    HealthFigures,
    Latency,
    ScanRecord,
)
from tsepm_ros.diagnostics.status import Status
from tsepm_ros.session.clocks import Now, waited
from tsepm_ros.session.drop_reasons import DETECTIONS, OWN_SHIP
from tsepm_ros.session.snapshot import SessionSnapshot
from tsepm_ros.settings.diagnostics_options import DiagnosticsOptions

MAX_RECORDS = 10_000
"""Scans of the window that are remembered at most: bounds memory and time."""

NO_CONNECTIONS = Connections()
"""Connections of a session without a node."""


class Health:
    """Records the history of a session for its diagnostics.

    Parameters
    ----------
    options : DiagnosticsOptions

    Attributes
    ----------
    options : DiagnosticsOptions
        May be replaced at any time.
    latency : Latency
        Latency of the last scan.
    """

    def __init__(self, options: DiagnosticsOptions) -> None:
        self.options = options
        self.reset()

    def reset(self) -> None:
        """Discard the history."""
        self.latency = Latency()
        self._scans: deque[ScanRecord] = deque(maxlen=MAX_RECORDS)
        self._arrivals: deque[Arrival] = deque(maxlen=MAX_RECORDS)
        self._heard: dict[str, Now] = {}
        self._counts: deque[tuple[float, Counts]] = deque()

    def heard(self, task: str, now: Now) -> None:
        """Record the time of an arrival of data for a task, `DETECTIONS` or `OWN_SHIP`."""
        self._heard[task] = now

    def arrived(self, stamp: float, now: Now) -> None:
        """Record the stamp (s) of an arriving scan, processed or not."""
        self._arrivals.append(Arrival(_first(now), stamp))
        self._forget(self._arrivals)

    def processed(self, detections: int, latency: Latency, now: Now) -> None:
        """Record a processed scan."""
        self.latency = latency
        self._scans.append(ScanRecord(_first(now), detections, latency))
        self._forget(self._scans)

    def report(
        self, snapshot: SessionSnapshot, now: Now, connections: Connections = NO_CONNECTIONS
    ) -> list[Status]:
        """Return the status of every task.

        Parameters
        ----------
        snapshot : SessionSnapshot
        now : float or tuple of float
            Time on the clocks of `heard` and `processed`, s. The first clock measures the window.
        connections : Connections, optional

        Returns
        -------
        list of Status
        """
        figures = HealthFigures(
            options=self.options,
            snapshot=snapshot,
            connections=connections,
            recent=self._recent(Counts.of(snapshot), _first(now)),
            scans=tuple(self._scans),
            arrivals=tuple(self._arrivals),
            since_scan=self._since(DETECTIONS, now),
            since_own_ship=self._since(OWN_SHIP, now),
            time=_first(now),
        )
        return statuses(figures)

    def _forget(self, records: deque[Arrival] | deque[ScanRecord]) -> None:
        """Forget the records before the window, except the last `LAST_SCANS` of all."""
        begin = records[-1].time - self.options.window
        while len(records) > LAST_SCANS and records[0].time < begin:
            records.popleft()

    def _since(self, task: str, now: Now) -> float:
        return waited(self._heard[task], now) if task in self._heard else math.nan

    def _recent(self, counts: Counts, time: float) -> Counts:
        """Record the present counts and return the counts since the beginning of the window."""
        begin = time - self.options.window
        while len(self._counts) > 1 and self._counts[1][0] <= begin:
            self._counts.popleft()
        at_begin = self._counts and self._counts[0][0] <= begin
        before = self._counts[0][1] if at_begin else Counts()
        self._counts.append((time, counts))
        return counts - before


def _first(now: Now) -> float:
    return now[0] if isinstance(now, tuple) else now
