# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""The package's own method tsepm, with its default limits."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

from contenders import Contender, FloatArray, Hits, RawScan, Sea
from tsepm_ros import Scan, make_initiator
from tsepm_ros.tracker.tracks import TrackArrays


class TsepmContender(Contender):
    """The published method in this package, as published: with what the peers are given as well."""

    options: ClassVar[Mapping[str, Any]] = MappingProxyType(
        {
            "clutter_density": "given",
            "detection_probability": "given",
            "limit_speed": "off",
        }
    )

    def __init__(self, sea: Sea, min_hits: int, window: int) -> None:
        super().__init__(sea, min_hits, window)
        self._initiator = make_initiator(
            "tsepm",
            sensor=sea.sensor(),
            max_speed=sea.max_speed,
            min_hits=min_hits,
            window=window,
            gate_probability=sea.gate_probability,
            **self.options,
        )
        self._new = TrackArrays.from_tracks([])

    def process(self, scan: RawScan) -> int:
        """See `Contender.process`."""
        self._new = self._initiator.process(
            Scan(stamp=scan.stamp, range=scan.range, azimuth=scan.azimuth)
        )
        return len(self._new)

    def hits(self) -> list[Hits]:
        """See `Contender.hits`."""
        return list(self._new.hits)

    def states(self) -> FloatArray:
        """See `Contender.states`."""
        return self._new.state

    def counts(self) -> dict[str, int]:
        """See `Contender.counts`; `raw` is without the confirmations that were cut."""
        last = self._initiator.statistics
        return {
            "potential": last.potential_tracks,
            "started": last.started,
            "raw": last.raw_confirmations,
            "cut": last.cut_potential_tracks + last.cut_confirmations,
            "cut_potential": last.cut_potential_tracks,
            "cut_raw": last.cut_confirmations,
        }


class DefaultTsepmContender(TsepmContender):
    """The same with the defaults: density and P_D learned, clusters sought, speeds limited."""

    options = MappingProxyType({})
