"""Tracks of a run as GeoJSON (RFC 7946): a line for each track."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any, TextIO

from tsepm_ros.session.session import ScanResult
from tsepm_ros.tools.bridge.geographic import GeographicReference, compass

DIGITS = 7
"""Decimals of a degree: 1 cm."""


class TrackLines:
    """Collects the held tracks of a run; the end of the `with` block writes them.

    Parameters
    ----------
    file : text file
    reference : GeographicReference
        In east and north, as the results are.
    """

    def __init__(self, file: TextIO, reference: GeographicReference) -> None:
        self._file, self._reference = file, reference
        self._lines: dict[int, list[list[float]]] = {}
        self._properties: dict[int, dict[str, Any]] = {}

    def write(self, result: ScanResult) -> None:
        """Add the tracks that are held after one scan."""
        current = result.current
        places = self._reference.geographic(current.state[:, 0::2])
        time = datetime.fromtimestamp(result.stamp_ns * 1e-9, UTC).isoformat()
        for track, (latitude, longitude) in zip(current, places.tolist(), strict=True):
            line = self._lines.setdefault(track.track_id, [])
            line.append([round(longitude, DIGITS), round(latitude, DIGITS)])
            found = self._properties.setdefault(
                track.track_id, {"track_id": track.track_id, "times": []}
            )
            found["times"].append(time)
            existence = track.existence_probability
            found |= {
                "speed": round(math.hypot(*track.velocity), 3),
                "course": round(float(compass(*track.velocity)), 1),
                "existence_probability": None if math.isnan(existence) else round(existence, 4),
                "revision": track.revision,
            }
        for track_id, reason in result.ended.items():
            if track_id in self._properties:
                self._properties[track_id]["ended"] = reason

    def __enter__(self) -> TrackLines:
        """Return the collection itself."""
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Write the collection, unless the block has failed."""
        if kind is not None:
            return
        features = [
            {"type": "Feature", "geometry": _geometry(line), "properties": self._properties[track]}
            for track, line in self._lines.items()
        ]
        json.dump({"type": "FeatureCollection", "features": features}, self._file)
        self._file.write("\n")


def _geometry(line: list[list[float]]) -> dict[str, Any]:
    """A point, a line, or lines that are cut at 180 degrees of longitude."""
    if len(line) == 1:
        return {"type": "Point", "coordinates": line[0]}
    parts = [[line[0]]]
    for before, after in pairwise(line):
        if abs(after[0] - before[0]) > 180.0:
            side = math.copysign(180.0, before[0])
            way = after[0] + 2.0 * side - before[0]
            share = (side - before[0]) / way if way else 0.0
            latitude = round(before[1] + share * (after[1] - before[1]), DIGITS)
            parts[-1].append([side, latitude])
            parts.append([[-side, latitude]])
        parts[-1].append(after)
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}
