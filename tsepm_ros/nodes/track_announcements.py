"""Log lines of confirmed tracks and of their ends, at a limited rate."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping

from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.maintenance.track_maintenance import ENDS
from tsepm_ros.session.result import ScanResult

MAX_LINES = 10
"""Most lines of confirmed tracks, and of ended ones, per period."""
PERIOD = 10.0
"""Time over which the lines are counted, s."""


def announcement(track: ConfirmedTrack, frame_id: str, reason: str) -> str:
    """One line of a confirmed track: its id, place, speed and direction, and the reason.

    The direction is counter-clockwise from the x axis of the fixed frame; the reason begins with
    the hits.
    """
    x, vx, y, vy = track.state.tolist()
    direction = math.degrees(math.atan2(vy, vx))
    return (
        f"track {track.track_id} confirmed at x {x:.1f} m, y {y:.1f} m in {frame_id}, "
        f"{math.hypot(vx, vy):.1f} m/s towards {direction:.0f} deg from x: {reason}"
    )


class TrackAnnouncements:
    """Says a line for each confirmed track and for each end, each at most `MAX_LINES` per `PERIOD`.

    Of the tracks left out, one line per period says the number and the ids.

    Parameters
    ----------
    say : callable
        Called with each line.
    clock : callable, optional
        Returns the time, s.
    """

    def __init__(
        self, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._confirmed = _LimitedLines(say, clock, "confirmed", "all are on tracks")
        self._ended = _LimitedLines(say, clock, "ended", "/diagnostics counts all by their reasons")

    def announce(self, result: ScanResult, reason: Callable[[ConfirmedTrack], str]) -> None:
        """Announce new and ended tracks of a scan; `reason` returns why one was confirmed."""
        new = {track.track_id: track for track in result.new}
        self._confirmed.add(
            new, lambda number: announcement(new[number], result.frame_id, reason(new[number]))
        )
        self._ended.add(
            result.ended, lambda number: f"track {number} ended: {ENDS[result.ended[number]]}"
        )


class _LimitedLines:
    """Lines of one kind of event of tracks."""

    def __init__(
        self, say: Callable[[str], None], clock: Callable[[], float], event: str, elsewhere: str
    ) -> None:
        self._say, self._clock, self._event, self._elsewhere = say, clock, event, elsewhere
        self._begin, self._lines, self._summed = -math.inf, 0, False
        self._left_out: list[int] = []

    def add(self, ids: Mapping[int, object], line: Callable[[int], str]) -> None:
        """Say the lines of tracks by their ids, or count those above the limit."""
        if self._clock() - self._begin >= PERIOD:
            self._say_left_out()
            self._begin, self._lines, self._summed = self._clock(), 0, False
        for number in ids:
            if self._lines < MAX_LINES:
                self._lines += 1
                self._say(line(number))
            else:
                self._left_out.append(number)
        if not self._summed:
            self._summed = bool(self._left_out)
            self._say_left_out()

    def _say_left_out(self) -> None:
        """Say how many tracks were left out since this was said last."""
        if not self._left_out:
            return
        first, last, number = self._left_out[0], self._left_out[-1], len(self._left_out)
        which = f"id {first}" if number == 1 else f"ids {first} to {last}"
        self._say(
            f"{number} more {self._event} track{'s' if number > 1 else ''} ({which}), not listed "
            f"one by one: above {MAX_LINES} lines in {PERIOD:.0f} s; {self._elsewhere}"
        )
        self._left_out.clear()
