"""The strength of clutter, learned from scan to scan: exponents of detections.

The exponent of a detection is u = -ln P(clutter is at least as strong), see `strength_law`: it is
free of the unit. Strengths are compared after taking away the level of their ping and of their
place (`strength_levels`); what the levels leave in common to neighbours, a texture, counts as a
doubt about the law (`target_strength`). Detections of targets are weighed down by the evidence of
their positions alone: weighed by their strength, clutter would lose its tail.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.environment.polar_grid import Cells
from tsepm_ros.environment.strength_law import MIN_REFERENCES, StrengthLaw
from tsepm_ros.environment.strength_levels import (
    PING_WINDOWS,
    PlaceLevels,
    ping_level,
    window_level,
)
from tsepm_ros.environment.strength_reference import (
    MAX_PER_PING,
    MAX_PINGS,
    REFERENCE,
    References,
    keys_of,
    of_one_law,
    of_one_shape,
)
from tsepm_ros.environment.strength_texture import Texture
from tsepm_ros.numerics.arrays import FloatArray, IntArray

TAIL_SAMPLES = 2.0
"""Samples of the tail for which each of its detections stands, in N; see `target_strength`."""
MAX_SAME_SHARE = 0.9
"""Share of one value from which on strengths say nothing: they are constant."""
RENEWAL = 0.1
"""Share of new references from which on the law is made anew."""
TAIL_CHANGE = 4.0
"""New references for which each whose weight changes counts: it may be in the tail."""
WINSORISED = (0.05, 0.95)
"""Quantiles of strengths at which those of the levels of places end."""
LEAST_CHANGE = 0.05
"""Sum of the changes of weights of a ping's references that is worth the while."""
SATURATED = 4
"""References at the top value from which on it counts as the end of the scale, whatever level."""
MEMORY_QUANTILES = 256
"""Quantiles of the reference that outlive a restart."""


class Judged(NamedTuple):
    """What the strengths of a scan say.

    Attributes
    ----------
    exponent : (d,) ndarray
        u of each detection; nan where its strength is not known.
    extrapolated : (d,) ndarray
        The same without an end, for a figure in dB.
    samples : float
        N: samples of clutter that determine the scale of the exponents of one path.
    """

    exponent: FloatArray
    extrapolated: FloatArray
    samples: float


@dataclass
class ClutterStrengths:
    """Learns the law of the strengths of clutter.

    Parameters
    ----------
    shape : (int, int)
        Cells of the clutter map.
    wraps : bool
        Whether its last column is next to the first.

    Attributes
    ----------
    unsaid : str
        Why strengths do not count as of the last scan; empty where they do.
    """

    shape: tuple[int, int]
    wraps: bool
    unsaid: str = field(default="no strengths", init=False)

    def __post_init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._references = References()
        self._places = PlaceLevels(self.shape, self.wraps)
        self._law: StrengthLaw | None = None
        self._top = math.inf, 1.0
        self._bounds = 0.0, 0.0, 0.0
        self._learned_from = 0.0
        self._new = math.inf
        self._level = 0.0
        self._decibels = False
        self._texture = Texture()
        self._next: tuple[NDArray[np.void], IntArray, float] | None = None
        self._remembered: tuple[FloatArray, float] | None = None

    def judge(
        self,
        strength: FloatArray,
        scan: int,
        index: IntArray,
        rings: Callable[[], Cells],
        position: FloatArray,
    ) -> Judged | None:
        """Exponents of a scan's detections, by the scans before it.

        Parameters
        ----------
        strength : (d,) ndarray
            In any unit; nan where it is not measured.
        scan : int
            Its index.
        index : (d,) ndarray of int
            Index of each detection in the scan.
        rings : callable
            Cells of the clutter map, its rows divided into `RINGS`; called only if there are
            strengths.
        position : (d, 2) ndarray
            In the fixed frame, m.

        Returns
        -------
        Judged or None
            None where strengths say nothing; `unsaid` says why.
        """
        self._next = None
        row = np.flatnonzero(np.isfinite(strength))
        if not len(row):
            self.unsaid = "no strengths"
            return None
        if not self._decibels and (strength[row] < 0.0).any():
            self._forget()
            self._decibels = True
        raw = strength[row] if self._decibels else np.log(np.maximum(strength[row], 1e-30))
        one = np.empty(len(row), REFERENCE)
        one["key"] = keys_of(scan, index[row])
        cells = rings()
        one["at"] = self._places.places_of(cells.row[row], cells.column[row])
        place = self._places.at(one["at"])
        raw -= place
        level = self._level_with(raw)
        value = raw - level
        one["raw"], one["value"], one["place"] = raw, value, place
        one["position"] = position[row, 0] + 1j * position[row, 1]
        one["strength"] = strength[row]
        one["by_range"] = self._places.by_range(one["at"])
        self._next = one, row, level
        law = self._law
        if law is None or law.count < MIN_REFERENCES:
            self.unsaid = "too few strengths so far"
            return None
        if law.constant_share > MAX_SAME_SHARE:
            self.unsaid = "constant strengths"
            return None
        self.unsaid = ""
        exponent, extrapolated = np.full((2, len(strength)), np.nan)
        exponent[row], extrapolated[row] = law.exponents(value)
        top, share = self._top
        if top < math.inf:
            at_top = strength >= top
            exponent[at_top] = np.minimum(exponent[at_top], -math.log(share))
        count = TAIL_SAMPLES * law.tail_count
        return Judged(exponent, extrapolated, 1.0 / (1.0 / count + self.texture))

    def _level_with(self, raw: FloatArray) -> float:
        """The level of a ping of logarithms (n,); the first has its median."""
        references, before = self._references, PING_WINDOWS[0] - 1
        if not len(references):
            self._level = float(np.median(raw))
            return self._level
        rows = references.last(before)
        likely = rows["weight"] > 0.5
        sizes = np.add.reduceat(likely, references.begins(before), dtype=np.int64).tolist()
        values = np.concatenate([rows["raw"][likely], raw])
        return ping_level(self._level, values, [*sizes, len(raw)])

    @property
    def use(self) -> str:
        """Whether strengths count as of the last scan, in words."""
        if self.unsaid:
            return f"not used: {self.unsaid}"
        count = 0.0 if self._law is None else self._law.count
        alike = "; neighbouring clutter is alike" if self.texture > 0.0 else ""
        return f"used: compared with {count:.0f} of clutter{alike}"

    @property
    def texture(self) -> float:
        """1 / N of what neighbouring clutter has in common: 0 for independent strengths."""
        return self._texture.doubt

    def update(self, weight: FloatArray, near: float, reach: FloatArray) -> None:
        """Learn from the scan that was judged last.

        Parameters
        ----------
        weight : (d,) ndarray
            Probability that each detection is of clutter.
        near : float
            Distance within which detections are neighbours, m.
        reach : (TEXTURE_LAGS + 1,) ndarray
            Distance within which two detections may be one target's, in scans so far apart, m.
        """
        judged, self._next = self._next, None
        if judged is None:
            return
        ping, row, level = judged
        ping["weight"] = weight[row]
        order = np.argsort(ping["key"], kind="stable")
        ping = ping[order[:: max(math.ceil(len(order) / MAX_PER_PING), 1)]]
        law = self._law if self._law and self._law.count >= MIN_REFERENCES else None
        if law is not None:
            lowest, highest, spread = self._bounds
            ping["place"] += np.minimum(np.maximum(ping["value"], lowest), highest)
            self._places.update(ping["at"], ping["place"], ping["weight"], highest, spread)
        else:
            ping["place"] = np.nan
        self._references.append(ping, level)
        if law is not None:
            self._texture.update(law, self._references, near, reach)
        self._new += float(ping["weight"].sum())
        if self._new > RENEWAL * self._learned_from:
            self._learn_law()

    def discount(self, scan: IntArray, index: IntArray, probability: FloatArray) -> None:
        """Weigh references down that are probably of targets, by their positions alone.

        Parameters
        ----------
        scan, index : (k,) ndarray of int
            Scan of each detection, and its index there.
        probability : (k,) ndarray
            That each is of a target.
        """
        rows = self._references.rows
        if not len(rows) or not len(scan):
            return
        key = keys_of(scan, index)
        place = np.minimum(np.searchsorted(rows["key"], key), len(rows) - 1)
        known = np.flatnonzero(rows["key"][place] == key)
        place, before = place[known], rows["weight"][place[known]]
        gone = before - np.minimum(before, 1.0 - probability[known])
        if gone.sum() < LEAST_CHANGE:
            return
        _, ping = np.unique(scan[known], return_inverse=True)
        changed = np.flatnonzero(np.bincount(ping, gone)[ping] >= LEAST_CHANGE)
        if not len(changed):
            return
        place, gone = place[changed], gone[changed]
        rows["weight"][place] -= gone
        self._new += TAIL_CHANGE * float(gone.sum())
        levelled = np.flatnonzero(np.isfinite(rows["place"][place]))
        place, gone = place[levelled], gone[levelled]
        at, values = rows["at"][place], rows["place"][place]
        self._places.withdraw(at, values, gone, self._references.ages(place))

    def _learn_law(self) -> None:
        self._drop_other_laws()
        rows = self._references.rows
        self._places.renew()
        by_range = self._places.by_range(rows["at"])
        change = by_range - rows["by_range"]
        if change.any():
            rows["raw"] -= change
            rows["value"] -= change
            rows["by_range"] = by_range
        self._learn_level()
        values, weight = rows["value"], rows["weight"].copy()
        self._top = _top(rows["strength"], weight)
        if self._remembered is not None and weight.sum() >= MIN_REFERENCES:
            remembered, of_remembered = self._before_restart()
            values, weight = np.append(values, remembered), np.append(weight, of_remembered)
        law = self._law = StrengthLaw.of(values, weight)
        self._learned_from, self._new = law.count, 0.0
        lowest, highest = map(law.quantile, WINSORISED)
        spread = np.minimum(np.maximum(law.values, lowest), highest).std()
        self._bounds = lowest, highest, float(spread)

    def _learn_level(self) -> None:
        """Learn the level as a rule; the pings that have it go with it."""
        before, references = self._level, self._references
        rows = references.rows
        likely = rows["raw"][rows["weight"] > 0.5]
        self._level = window_level(before, likely, len(references))
        if self._level != before:
            references.relevel(before, self._level)

    def _before_restart(self) -> tuple[FloatArray, FloatArray]:
        """What was remembered and is of the same law as the pings, with its fading weight."""
        none = np.zeros(0)
        if self._remembered is None:
            return none, none
        raw, total = self._remembered
        left = 1.0 - len(self._references) / MAX_PINGS
        other = not of_one_law(raw, self._references.rows["raw"])
        if other or left <= 0.0:
            self._remembered = None
            return none, none
        return raw - self._level, np.full(len(raw), left * total / len(raw))

    @property
    def memory(self) -> tuple[FloatArray, float, bool]:
        """Quantiles of the reference, its weight, and whether it is of decibels."""
        if self._law is None:
            return *(self._remembered or (np.zeros(0), 0.0)), self._decibels
        shares = (np.arange(MEMORY_QUANTILES) + 0.5) / MEMORY_QUANTILES
        raw = np.quantile(self._references.rows["raw"], shares)
        return raw, self._law.count, self._decibels

    def remember(self, raw: FloatArray, weight: float, decibels: bool) -> None:
        """Begin with the memory of another run; it counts if the first pings are of its law."""
        if len(raw) and weight > 0.0:
            self._remembered, self._decibels = (raw, weight), decibels

    def _drop_other_laws(self) -> None:
        """Drop the pings before a change of level that has changed the law too, as of the unit."""
        if self._law is None:
            return
        width = self._law.quantile(0.75) - self._law.quantile(0.25)
        references = self._references
        levels = np.array(references.levels)
        far = np.flatnonzero(np.abs(levels - levels[-1]) > width)
        since = int(far[-1]) + 1 if len(far) else 0
        if not 0 < since < len(levels):
            return
        new = references.last(len(levels) - since)["value"]
        old = references.rows["value"][: len(references.rows) - len(new)]
        if min(len(old), len(new)) >= MIN_REFERENCES and not of_one_shape(old, new):
            self._level = float(levels[-1])
            references.drop(since)


def _top(strength: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """The end of the scale, and the share of the reference there; infinite if it is not seen."""
    at_top = strength == strength.max()
    if at_top.sum() < SATURATED:
        return math.inf, 1.0
    share = (1.0 + weight[at_top].sum()) / (1.0 + weight.sum())
    return float(strength.max()), float(share)
