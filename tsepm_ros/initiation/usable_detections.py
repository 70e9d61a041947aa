"""Which detections of a scan are used: those in the coverage that are not on land."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsepm_ros.environment.land import LandMask, afloat
from tsepm_ros.numerics.arrays import IntArray
from tsepm_ros.sensing.coverage import inside
from tsepm_ros.sensing.plots import chosen
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.sensing.sensor import SensorModel


@dataclass(frozen=True, eq=False)
class UsableDetections:
    """The detections of a scan that are used.

    Attributes
    ----------
    scan : Scan
        Of these alone.
    rows : (n,) ndarray of int
        Their rows of the whole scan.
    outside_coverage, on_land : int
        Number of the detections that are not used, because they are outside the coverage, and in
        the coverage on land.
    """

    scan: Scan
    rows: IntArray
    outside_coverage: int
    on_land: int

    @classmethod
    def of(cls, scan: Scan, sensor: SensorModel, land: LandMask | None) -> UsableDetections:
        """Those of a scan of a sensor."""
        used = inside(scan, sensor)
        in_coverage = int(np.count_nonzero(used))
        if land is not None:
            used &= afloat(scan, land)
        rows = np.flatnonzero(used)
        part = scan if len(rows) == len(scan) else chosen(scan, rows)
        return cls(part, rows, len(scan) - in_coverage, in_coverage - len(rows))
