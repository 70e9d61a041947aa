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
"""Gates: lines over which tracks are counted, by direction.

A track has crossed a gate once it is clear of its line on the other side, and was clear of it on
the first side before: one that turns back on the line is not counted, and one that stays on it is
counted once. Clear is farther than twice its error and its way in one interval, by which a track
overshoots where its target turns. It must have passed between the ends. A track that coasts is
nowhere until it is detected again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from tsepm_ros.own_ship.registration import exchanged_after_registration, registration_axes
from tsepm_ros.tracker.tracks import TrackArrays

CLEAR = 2.0
"""Standard deviations from the line at which a track is on a side of it."""
MAX_TRACKS = 1000
"""Tracks whose sides are remembered, those that were seen last."""
HEAD = "stamp,track_id,gate,direction,x,y"
"""Columns of the crossings; gates count from 1, directions are those of somebody who looks from the
first end to the second."""
DIRECTIONS = {1: "to_left", -1: "to_right"}


class GateCounter:
    """Counts the tracks that cross gates.

    Parameters
    ----------
    lines : sequence of (x1, y1, x2, y2)
        m, in the axes of the fixed frame.
    counts : mapping of tuple to [int, int], optional
        Of lines that have been counted at before.

    Attributes
    ----------
    lines : list of tuple
    counts : list of [int, int]
        Crossings of each gate to the left and to the right.
    """

    def __init__(
        self,
        lines: Sequence[Sequence[float]],
        counts: Mapping[tuple[float, ...], list[int]] = {},
    ) -> None:
        self.lines = [tuple(line) for line in lines]
        self.counts = [counts.get(line, [0, 0]) for line in self.lines]
        # By id: stamp, distance to the left of the line, share of the way from end to end, the
        # share at which it came over the line last, and its side (0: not known).
        self._places: list[dict[int, tuple[float, float, float, float, int]]] = [{} for _ in lines]

    def observe(self, stamp: float, tracks: TrackArrays, frame_id: str) -> list[str]:
        """Take the held tracks of a scan, in east and north; the crossings, lines of CSV.

        Their places are in the axes of the fixed frame, as the lines are.
        """
        moving, crossings = exchanged_after_registration(tracks.sure, frame_id), list[str]()
        first, is_down = (stamp - moving.age).tolist(), registration_axes(frame_id) == "down"
        for gate, (x1, y1, x2, y2) in enumerate(self.lines):
            way = np.array([x2 - x1, y2 - y1]) / math.hypot(x2 - x1, y2 - y1)
            left = way[::-1] * ((1.0, -1.0) if is_down else (-1.0, 1.0))
            offset = moving.state[:, 0::2] - (x1, y1)
            share = offset @ way / math.hypot(x2 - x1, y2 - y1)
            std = np.sqrt(np.einsum("i,nij,j->n", left, moving.covariance[:, 0::2, 0::2], left))
            speed = np.abs(moving.state[:, 1::2] @ left)
            numbers = np.stack([offset @ left, share, CLEAR * std, speed], axis=1).tolist()
            for row, track_id in enumerate(moving.track_id.tolist()):
                if side := self._side(gate, track_id, stamp, first[row], *numbers[row]):
                    self.counts[gate][side < 0] += 1
                    crossings.append(
                        "{:.3f},{},{},{},{:.2f},{:.2f}".format(
                            *(stamp, track_id, gate + 1, DIRECTIONS[side]),
                            *moving.state[row, 0::2].tolist(),
                        )
                    )
        return crossings

    def _side(
        self,
        gate: int,
        track_id: int,
        stamp: float,
        first: float,
        distance: float,
        share: float,
        clear: float,
        speed: float,
    ) -> int:
        """The side to which a track has crossed with this scan; 0: it has not."""
        places = self._places[gate]
        begin = stamp, distance, share, math.nan, 0
        before = places.pop(track_id, begin)
        if first > before[0] or stamp < before[0]:  # an id that another run has given again
            before = begin
        last, old, old_share, over, known = before
        clear += speed * (stamp - last)
        if distance * old <= 0.0 and distance != old:
            over = old_share + old / (old - distance) * (share - old_share)
        side = known if abs(distance) <= clear else 1 if distance > 0.0 else -1
        places[track_id] = stamp, distance, share, over, side
        if len(places) > MAX_TRACKS:
            del places[next(iter(places))]
        return side if known * side < 0 and 0.0 <= over <= 1.0 else 0
