"""Options of the detector of sonar images."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsepm_ros.parameters import ParameterGroup, parameter


@dataclass(frozen=True, kw_only=True)
class DetectorOptions(ParameterGroup):
    """Options of the detector."""

    false_detections_per_ping: float = parameter(
        20.0,
        "False detections per ping that the threshold keeps, at most a tenth of the independent "
        "cells of an image",
        minimum=0.1,
        maximum=1e4,
    )
    range_extent: float = parameter(
        0.0, "Extent of a target's echo in range; 0: learned", unit="m", minimum=0.0, maximum=1e4
    )
    azimuth_extent: float = parameter(
        0.0,
        "Extent of a target's echo in azimuth, with the beam; 0: learned",
        unit="rad",
        minimum=0.0,
        maximum=math.pi,
    )
    clutter_map: int = parameter(
        0,
        "Pings over which a map of each cell's mean is learned and subtracted, for a sensor that "
        "does not move; 0: no map. Whatever stands still vanishes",
        minimum=0,
        maximum=100_000,
    )
