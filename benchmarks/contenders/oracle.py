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
"""The plain version of the published method, test/support/plain_tsepm.py, scan by scan."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from contenders import Contender, FloatArray, Hits, RawScan, Sea

sys.path.append(str(Path(__file__).resolve().parents[2] / "test"))

from support import plain_tsepm as plain


class OracleContender(Contender):
    """`plain_tsepm.step`, called once per scan."""

    def __init__(self, sea: Sea, min_hits: int, window: int) -> None:
        super().__init__(sea, min_hits, window)
        self._settings = plain.Parameters(
            range_std=0.0,
            range_std_fraction=sea.range_std_fraction,
            azimuth_std=sea.azimuth_std,
            clutter_density=sea.clutter_density,
            max_speed=sea.max_speed,
            min_hits=min_hits,
            window=window,
            gate_probability=sea.gate_probability,
        )
        self._scan_index = 0
        self._potential: list[plain.PotentialTrack] = []
        self._new: list[plain.PlainTrack] = []
        self._raw = 0

    def process(self, scan: RawScan) -> int:
        """See `Contender.process`."""
        fields = {"stamp": scan.stamp, "range": scan.range, "azimuth": scan.azimuth}
        self._new, self._potential, counts = plain.step(
            self._potential, fields, self._scan_index, self._settings
        )
        self._raw = counts.confirmed
        self._scan_index += 1
        return len(self._new)

    def hits(self) -> list[Hits]:
        """See `Contender.hits`."""
        return [track.hits for track in self._new]

    def states(self) -> FloatArray:
        """See `Contender.states`."""
        return np.array([track.state for track in self._new]).reshape(-1, 4)

    def counts(self) -> dict[str, int]:
        """See `Contender.counts`."""
        return {"potential": len(self._potential), "raw": self._raw}
