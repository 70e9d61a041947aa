"""The strength of clutter, learned from scan to scan: exponents of detections.

The exponent of a detection is u = -ln P(clutter is at least as strong), see `strength_law`: it is
free of the unit. Strengths are compared after taking away the level of their ping and of their
place (`strength_levels`); what the levels leave in common to neighbours, a texture, counts as a
doubt about the law (`target_strength`). Detections of targets are weighed down by the evidence of
their positions alone: weighed by their strength, clutter would lose its tail.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tsepm_ros.environment.strength_law import MIN_REFERENCES, StrengthLaw
from tsepm_ros.environment.strength_levels import PlaceLevels, ping_level
from tsepm_ros.environment.strength_reference import ReferencePing, of_one_law, of_one_shape
from tsepm_ros.environment.strength_texture import Texture
from tsepm_ros.numerics.arrays import FloatArray, IntArray

MAX_PINGS = 64
"""Pings in the reference, at most ..."""
MAX_PER_PING = 64
"""... and detections of each."""
TAIL_SAMPLES = 2.0
"""Samples of the tail for which each of its detections stands, in N; see `target_strength`."""
MAX_SAME_SHARE = 0.9
"""Share of one value from which on strengths say nothing: they are constant."""
RENEWAL = 0.05
"""Share of new references from which on the law is made anew."""
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
        self._pings: deque[ReferencePing] = deque(maxlen=MAX_PINGS)
        self._places = PlaceLevels(self.shape, self.wraps)
        self._law: StrengthLaw | None = None
        self._top = math.inf, 1.0
        self._bounds = 0.0, 0.0, 0.0
        self._learned_from = 0.0
        self._new = math.inf
        self._level = 0.0
        self._decibels = False
        self._texture = Texture()
        self._next: ReferencePing | None = None
        self._remembered: tuple[FloatArray, float] | None = None

    def judge(
        self,
        strength: FloatArray,
        scan: int,
        index: IntArray,
        cells: tuple[IntArray, IntArray],
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
        cells : tuple of (d,) ndarray of int
            Cells of the clutter map.
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
        cells = cells[0][row], cells[1][row]
        place = self._places.at(cells)
        raw = raw - place
        before = [ping.raw[ping.weight > 0.5] for ping in list(self._pings)[-15:]]
        level = float(np.median(raw))
        if self._pings:
            level = ping_level(self._level, [*before, raw])
        else:
            self._level = level
        value = raw - level
        ones = np.ones(len(row))
        self._next = ReferencePing(
            scan,
            row,
            index[row],
            cells,
            raw,
            value,
            place,
            ones,
            position[row],
            strength[row],
            level,
        )
        law = self._law
        if law is None or law.count < MIN_REFERENCES:
            self.unsaid = "too few strengths so far"
            return None
        if _largest_share(law) > MAX_SAME_SHARE:
            self.unsaid = "constant strengths"
            return None
        self.unsaid = ""
        exponent, extrapolated = np.full((2, len(strength)), np.nan)
        exponent[row], extrapolated[row] = law.exponent(value), law.extrapolated(value)
        top, share = self._top
        exponent[strength >= top] = np.minimum(exponent[strength >= top], -math.log(share))
        count = TAIL_SAMPLES * law.tail_count
        return Judged(exponent, extrapolated, 1.0 / (1.0 / count + self.texture))

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
        ping, self._next = self._next, None
        if ping is None:
            return
        order = np.argsort(ping.index, kind="stable")
        every = max(math.ceil(len(order) / MAX_PER_PING), 1)
        ping = ping.rows(order[::every])
        ping.weight = weight[ping.row]
        law = self._law
        if law is not None and law.count >= MIN_REFERENCES:
            self._texture.update(law, ping, list(self._pings)[::-1], near, reach)
            lowest, highest, spread = self._bounds
            ping.place = np.clip(ping.value + ping.place, lowest, highest)
            self._places.update(ping.cells, ping.place, ping.weight, highest, spread)
        else:
            ping.place = np.zeros(0)
        self._pings.append(ping)
        self._new += float(ping.weight.sum())
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
        for ping in self._pings:
            told = np.flatnonzero(scan == ping.scan)
            if not len(told):
                continue
            place = np.minimum(np.searchsorted(ping.index, index[told]), len(ping.index) - 1)
            known = ping.index[place] == index[told]
            place, told = place[known], told[known]
            left = np.minimum(ping.weight[place], 1.0 - probability[told])
            gone = ping.weight[place] - left
            if gone.sum() < LEAST_CHANGE:
                continue
            if len(ping.place):
                cells = ping.cells[0][place], ping.cells[1][place]
                self._places.withdraw(cells, ping.place[place], gone)
            ping.weight[place] = left
            self._new += float(gone.sum())

    def _learn_law(self) -> None:
        self._drop_other_laws()
        self._learn_level()
        pings = self._pings
        values = np.concatenate([ping.value for ping in pings])
        weight = np.concatenate([ping.weight for ping in pings])
        self._top = _top(np.concatenate([ping.strength for ping in pings]), weight)
        if weight.sum() >= MIN_REFERENCES:
            remembered, of_remembered = self._before_restart()
            values, weight = np.append(values, remembered), np.append(weight, of_remembered)
        self._law = StrengthLaw.of(values, weight)
        self._learned_from, self._new = self._law.count, 0.0
        lowest, highest = np.quantile(values, WINSORISED)
        spread = np.clip(values, lowest, highest).std()
        self._bounds = float(lowest), float(highest), float(spread)

    def _learn_level(self) -> None:
        """Learn the level as a rule; the pings that have it go with it."""
        before, pings = self._level, self._pings
        likely = [ping.raw[ping.weight > 0.5] for ping in pings]
        self._level = ping_level(before, likely, [len(pings)])
        if self._level != before:
            for ping in pings:
                if ping.level == before:
                    ping.level, ping.value = self._level, ping.raw - self._level

    def _before_restart(self) -> tuple[FloatArray, FloatArray]:
        """What was remembered and is of the same law as the pings, with its fading weight."""
        none = np.zeros(0)
        if self._remembered is None:
            return none, none
        raw, total = self._remembered
        new = np.concatenate([ping.raw for ping in self._pings])
        left = 1.0 - len(self._pings) / MAX_PINGS
        other = not of_one_law(raw, new)
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
        raw = np.quantile(np.concatenate([ping.raw for ping in self._pings]), shares)
        return raw, self._law.count, self._decibels

    def remember(self, raw: FloatArray, weight: float, decibels: bool) -> None:
        """Begin with the memory of another run; it counts if the first pings are of its law."""
        if len(raw) and weight > 0.0:
            self._remembered, self._decibels = (raw, weight), decibels

    def _drop_other_laws(self) -> None:
        """Drop the pings before a change of level that has changed the law too, as of the unit."""
        if self._law is None:
            return
        low, high = np.quantile(self._law.values, (0.25, 0.75))
        pings = list(self._pings)
        last = pings[-1].level
        far = [abs(ping.level - last) > high - low for ping in pings]
        since = len(far) - far[::-1].index(True) if True in far else 0
        if not 0 < since < len(pings):
            return
        old = np.concatenate([ping.value for ping in pings[:since]])
        new = np.concatenate([ping.value for ping in pings[since:]])
        if min(len(old), len(new)) >= MIN_REFERENCES and not of_one_shape(old, new):
            self._pings = deque(pings[since:], maxlen=MAX_PINGS)
            self._level = last


def _top(strength: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """The end of the scale, and the share of the reference there; infinite if it is not seen."""
    at_top = strength == strength.max()
    if at_top.sum() < SATURATED:
        return math.inf, 1.0
    share = (1.0 + weight[at_top].sum()) / (1.0 + weight.sum())
    return float(strength.max()), float(share)


def _largest_share(law: StrengthLaw) -> float:
    """Share of the commonest value."""
    first = np.flatnonzero(np.diff(law.values, prepend=-np.inf))
    weights = -np.diff(law.at_least[np.append(first, len(law.values))])
    return float(weights.max() / max(law.count, 1e-9))
