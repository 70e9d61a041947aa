"""Track initiation by the likelihood ratio of a target against clutter.

The tree of splits of TSEPM 2018, evaluated by the log-likelihood ratio instead of f_1: missed
branches are kept, every detection may start a track, and what is tested is the evidence of all
hypotheses that share a detection, summed. With lambda the clutter density, N(z; H x, S) the density
of a detection z under a hypothesis, P_G the gate's probability, and s_i the sum of the gains of
hypothesis i::

    hit           s_i += ln(P_D N(z; H x, S) / lambda)           Sittler 1964; Bar-Shalom, Blackman,
                                                                 Fitzgerald 2007
    miss          s_i += ln(1 - P_D P_G); 0 where nothing can be seen
    evidence      E = ln sum_i exp(s_i), over i with the same newest detection
    confirmed     E >= A, by at least 3 hits, no held track's, of which more than half are the
                  target's with a probability of at least 0.9 (or by 8 hits); beside a held track
                  E >= A + ln 1000, with what it explains of z added to lambda
    bound         P(E ever >= ln a | clutter) <= 1 / a           Ville 1939, Wald 1945
    threshold     A = ln(starts per hour / wish) - the mean jump over it
    deleted       s_i < ln(miss_probability), 1e-4 of the best with the same newest detection, or
                  `window` scans old
    state         x = sum_i w_i x_i,  w_i ~ exp(s_i), over i with all of the track's hits
                  P = sum_i w_i (P_i + (x_i - x)(x_i - x)')

The full references are in `score.likelihood_ratio`; the jump is found by simulation in
`tsepm_ros.methods.score.threshold_plan`.

Readings
--------
- No published method is reproduced: these are textbook parts put together.
- Between detections a Kalman filter predicts, begun with a velocity of variance v_max^2 / 4 on each
  axis; x_i and P_i are fitted by least squares to the hits alone, without that prior.
- Hypotheses outside the gate, deleted or beyond a limit are not in the sum.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.initiation.initiator import NEW_TRACK_EXISTENCE
from tsepm_ros.initiation.method import Method
from tsepm_ros.initiation.observation import Observation, Step
from tsepm_ros.initiation.statistics import ScanStatistics
from tsepm_ros.initiation.track_building import tracks_from_hits
from tsepm_ros.kinematics import kalman
from tsepm_ros.kinematics.track import ConfirmedTrack, TrackArrays
from tsepm_ros.maintenance.held_tracks import LEAST_EXISTENCE
from tsepm_ros.methods.score import likelihood_ratio, threshold_plan
from tsepm_ros.methods.score.hypotheses import Hypotheses
from tsepm_ros.methods.score.options import MIN_HITS, ScoreOptions
from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.gaussian import mixture
from tsepm_ros.numerics.grouped import places, sums_over_hits
from tsepm_ros.numerics.limits import keep_best
from tsepm_ros.sensing import range_rates, sensor
from tsepm_ros.sensing.detection_window import DetectionWindow
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.stages import pruning
from tsepm_ros.stages.estimation import fit_paths
from tsepm_ros.stages.paths import NO_HIT, starting

CREDIBLE = 0.9
"""Posterior probability from which a detection counts as a hit of a confirmed track: a choice."""
RESOLVED = 0.9
"""Posterior probability, at the least, that more than half of a new track's hits are its target's.

What is less certain waits: a start that is half wrong helps no one, and hides its target. A choice,
compared with others in docs/score.md.
"""
PATIENCE = 8
"""Hits of the best hypothesis with which a start waits no longer: a choice.

Of a target with several detections a ping it may never be clear which are its own.
"""
CLAIMED = 0.3
"""Share of the hits that are some held track's above which a hypothesis is of the same target."""
CLAIMED_NEWEST = 0.5
"""Probability that a detection is some held track's above which it starts no other by itself."""
COMMON = 0.3
"""Share of the hits that two hypotheses have in common above which they are of the same target."""
BESIDE = math.log(1e3)
"""Evidence beyond the threshold that one more target beside a held one needs: a choice.

It claims its detections too, and a target that was started half wrong looks like two for a while.
"""
LEAST_SPREAD = 0.1
"""Time from the first hit to the last, in scan intervals, that tells a velocity at all."""
NEGLIGIBLE = 0.01
"""Hypotheses this much less likely than the best do not count in the state."""
FORGOTTEN = math.log(1e-4)
"""Deleted are hypotheses whose ratio is a smaller part of the best one's with the same last hit."""
TARGET_ODDS = 0.01
"""Odds that a detection without history is a target's: what the clutter map takes a start for."""
BELIEVED = 500.0
"""Wish, false tracks per hour, at which a start at the threshold is as probable as not: a choice.

A start is held, and claims its detections, as firmly as it is probable. High: only where many more
false ones are wished for than an operator could use does it leave its detections to others.
"""
LEAST_NEW_EXISTENCE = 2.0 * LEAST_EXISTENCE
"""A confirmed track is held for a scan at the least."""
SECONDS_PER_HOUR = 3600.0
BLOCK = 50_000
"""Pairs of hypotheses and detections looked at together: bounds memory."""
MEMORY = 50
"""Scans over which the mean of the detections and the median of the interval are taken."""


@dataclass(frozen=True)
class _Start:
    """A track to be confirmed.

    Attributes
    ----------
    hits : (h,) ndarray of int
        Detections that are credible as the target's, see `_credible`.
    claimed, probability : (c,) ndarray
        All detections that may be, and how probably each is.
    state, covariance : (4,), (4, 4) ndarray
    evidence : float
        Of the newest detection.
    """

    hits: IntArray
    claimed: IntArray
    probability: FloatArray
    state: FloatArray
    covariance: FloatArray
    evidence: float


class Score(Method):
    """The likelihood-ratio method, the default: evidence for a target, against clutter."""

    Options = ScoreOptions
    options: ScoreOptions
    clutter_excludes_held = True
    operating_points = MappingProxyType(
        {
            f"{wish:g}/h": {"false_tracks_per_hour": wish}
            for wish in (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
        }
    )

    def forget(self) -> None:
        """See `Method.forget`."""
        self._observed: Observation | None = None
        self.detections = DetectionWindow()
        self._has_range_rates = False
        self._hypotheses = Hypotheses.none(self.options.window)
        self._counts: deque[int] = deque(maxlen=MEMORY)
        self._intervals: deque[float] = deque(maxlen=MEMORY)

    def configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options; another window starts over.

        See `Method.configure`.
        """
        window = self.options.window
        super().configure(sensor, common, options)
        if options.window != window:
            self.forget()
            return False
        return True

    def step(self, observed: Observation) -> Step:
        """Take one scan and return the tracks that it newly confirms.

        See `Method.step`.
        """
        self._observed = observed
        interval = observed.interval if self._counts else 0.0
        detections = observed.detections
        ids = self.detections.append(detections)
        row, probability = observed.held_association
        self.detections.claim(ids[row], probability)
        self._has_range_rates = bool(range_rates.measured(detections).any())
        clutter = observed.clutter_density
        self._observe(len(detections), interval)
        predicted = self._hypotheses.predicted(interval, self.options.process_noise)
        detectable = observed.detection_probability(predicted.state[:, 0::2])
        log_explained = np.log1p(observed.held_density / np.maximum(clutter, sensor.LEAST_DENSITY))
        children, cut_children = self._split(
            predicted, detectable, detections, ids, clutter, log_explained
        )
        started = self._start(detections, ids, log_explained)
        updated = Hypotheses.joined(children, started)
        missed = self._miss(predicted, detectable)
        target = self._target_share(updated, ids)
        tracks, starts = self._confirm(updated, missed, ids)
        grown = _beside(Hypotheses.joined(updated, missed), starts)
        kept = self._prune(grown)
        self._hypotheses, cut = self._limit(kept)
        self.detections.forget(self._last.scan_index + 2 - self.options.window)
        return Step(
            tracks,
            ScanStatistics(
                scans=1,
                detections=len(detections),
                potential_tracks=len(self._hypotheses),
                started=len(started),
                terminated=len(grown) - len(kept),
                confirmed=len(tracks),
                cut_potential_tracks=cut_children + cut,
            ),
            existence=self._probable(tracks.evaluation),
            target_probability=target,
        )

    @property
    def threshold(self) -> float:
        """Log-likelihood ratio that confirms: what gives the wanted false tracks per hour."""
        share = self._false_share
        if share is None:
            return math.inf
        sensor = self.sensor
        observed = self._observed
        if self.common.detection_probability == "estimated":
            known = (
                observed.detection_probability_in_use if observed else sensor.detection_probability
            )
            coarse = max(round(known, 1), 0.1)
            sensor = replace(sensor, detection_probability=coarse)
        if self.common.clutter_density == "estimated" and observed and len(observed.detections):
            density = float(np.median(observed.detections["clutter_density"]))
            coarse = 10.0 ** (0.5 * round(2.0 * math.log10(density)))
            half = 2.0 ** round(math.log2(observed.clutter_sensor.clutter_range_rate))
            sensor = replace(sensor, clutter_density=coarse, clutter_range_rate=half)
        if not self._has_range_rates:
            sensor = replace(sensor, range_rate_std=0.0)
        plan = threshold_plan.score_plan(
            sensor,
            max_speed=self.common.max_speed,
            interval=threshold_plan.rounded(self._interval),
            window=self.options.window,
            gate_probability=self.options.gate_probability,
            process_noise=self.options.process_noise,
            deletion=self.deletion,
            min_hits=MIN_HITS,
        )
        return plan.threshold(share)

    @property
    def _last(self) -> Observation:
        """The scan at hand."""
        assert self._observed is not None
        return self._observed

    def _probable(self, evaluation: FloatArray) -> FloatArray:
        """Posterior probability of tracks so far above the threshold, (n,).

        With the prior that `BELIEVED` targets appear per hour: at the threshold the odds are as
        those to the wanted false tracks per hour.
        """
        false = self.options.false_tracks_per_hour * np.exp(-evaluation)
        found = BELIEVED / (BELIEVED + false)
        return np.clip(found, LEAST_NEW_EXISTENCE, NEW_TRACK_EXISTENCE)

    @property
    def _interval(self) -> float:
        """Median interval of the scans, s; 0 while unknown."""
        return float(np.median(self._intervals)) if self._intervals else 0.0

    @property
    def _false_share(self) -> float | None:
        """Share of the starts from clutter that may be confirmed; None while the rate is unknown.

        The starts are the detections, those of this scan at the least.
        """
        if not self._interval:
            return None
        detections = max(float(np.mean(self._counts)), self._counts[-1], 1e-3)
        starts_per_hour = detections * SECONDS_PER_HOUR / self._interval
        return min(self.options.false_tracks_per_hour / starts_per_hour, 1.0)

    @property
    def deletion(self) -> float:
        """Log-likelihood ratio below which a hypothesis is deleted: ln of the miss probability."""
        return math.log(self.options.miss_probability)

    def reason(self, track: ConfirmedTrack) -> str:
        """Its evidence, the threshold that it passed, and the wish behind that.

        See `Initiator.reason`.
        """
        return (
            f"{super().reason(track)}; the evidence of all hypotheses with one newest detection is "
            f"{track.score:.2f}, at least the threshold {track.score - track.evaluation:.2f} that "
            f"clutter passes {self.options.false_tracks_per_hour:g} times an hour"
        )

    def potential_tracks(self, observed: Observation) -> TrackArrays:
        """Hypotheses with at least two hits; `score` is their log-likelihood ratio.

        Those of held targets are left out, also where one might be of another beside it.

        See `Method.potential_tracks`.
        """
        found = self._hypotheses[self._spread_in_time(self._hypotheses, 2)]
        found = found[self._claimed_share(found, np.arange(len(found)), len(found)) <= CLAIMED]
        if not len(found):
            return TrackArrays.of([])
        state, covariance = self._estimate(found)
        return self._tracks(found.hits, state, covariance, found.score, self.threshold)

    def _observe(self, detections: int, interval: float) -> None:
        """Remember the detections per scan and the scan interval."""
        self._counts.append(detections)
        if interval > 0:
            self._intervals.append(interval)

    def _split(
        self,
        predicted: Hypotheses,
        detectable: FloatArray,
        detections: NDArray[np.void],
        ids: IntArray,
        clutter: FloatArray,
        log_explained: FloatArray,
    ) -> tuple[Hypotheses, int]:
        """Extend every hypothesis by each detection in its gate, ``d' S^-1 d <= gamma``.

        One of a target that cannot be detected where it is has no children: its misses cost
        nothing either, and hits that count there would make the evidence of clutter grow. Of one
        more target beside those held, a hit gains less by `log_explained` (d,): the log of how much
        more densely detections fall there, with the held ones', than clutter does.

        Returns the children that are not deleted at once, and the pairs that a limit left out.
        """
        parent, row, cut = predicted.near(
            detections, self._last.stamp, self.sensor, self.options.gate_probability
        )
        order = np.arange(len(parent))
        if self._last.time_limit.finite and len(parent) > BLOCK:
            order = np.argsort(-predicted.score[parent], kind="stable")
        score = np.full(len(parent), -np.inf)
        for first in range(0, len(parent), BLOCK):
            if first and self._last.time_limit.left < 0.5 * self._last.time_limit.seconds:
                cut += len(parent) - first
                break
            part = order[first : first + BLOCK]
            score[part] = self._child_score(
                predicted, detectable, parent[part], detections[row[part]], clutter[row[part]]
            )
        kept = np.flatnonzero(score > self.deletion)
        kept = kept[places(row[kept], score[kept]) < self.options.max_per_detection]
        best = keep_best(-score[kept], self.common.max_potential_tracks)
        cut += len(kept) - len(best)
        kept = kept[best]
        parent, row, score = parent[kept], row[kept], score[kept]
        beside = predicted.beside[parent] + score - predicted.score[parent] - log_explained[row]
        blocks = [slice(first, first + BLOCK) for first in range(0, max(len(kept), 1), BLOCK)]
        children = [
            predicted.updated(
                parent[part],
                detections[row[part]],
                ids[row[part]],
                score[part],
                beside[part],
                self._last.stamp,
                self.sensor,
            )
            for part in blocks
        ]
        return Hypotheses.joined(*children), cut

    def _child_score(
        self,
        predicted: Hypotheses,
        detectable: FloatArray,
        parent: IntArray,
        found: NDArray[np.void],
        clutter: FloatArray,
    ) -> FloatArray:
        """Score of each child; -inf outside the gate, or where P_D (of the parents) is 0."""
        lag, innovation, spread = predicted.innovations(
            parent, found, self._last.stamp, self.sensor
        )
        density = kalman.log_likelihood(
            predicted.state,
            predicted.covariance,
            parent,
            lag,
            innovation,
            spread,
            found,
            self.options.gate_probability,
        )
        gain = likelihood_ratio.hit_increment(density, detectable[parent], clutter)
        return predicted.score[parent] + gain

    def _miss(self, predicted: Hypotheses, detectable: FloatArray) -> Hypotheses:
        """The branches of all hypotheses that leave the scan out."""
        gain = likelihood_ratio.miss_increment(detectable, self.options.gate_probability)
        return replace(predicted, score=predicted.score + gain, beside=predicted.beside + gain)

    def _start(
        self, detections: NDArray[np.void], ids: IntArray, log_explained: FloatArray
    ) -> Hypotheses:
        """Start a hypothesis from every detection.

        The velocity is unknown up to v_max: uniform over the disc, of variance v_max^2 / 4 on each
        axis; the first range rate, if there is one, tells it along the line of sight, and speaks
        for a target or against it.
        """
        n = len(ids)
        path = starting(ids, self._last.scan_index, self.options.window)
        state, covariance = np.zeros((n, 4)), np.zeros((n, 4, 4))
        state[:, 0::2] = detections["position"]
        covariance[:, 0::2, 0::2] = detections["covariance"]
        covariance[:, [1, 3], [1, 3]] = self.common.max_speed**2 / 4.0
        state, covariance, gain = range_rates.begun(
            state, covariance, detections, self._last.clutter_sensor
        )
        # An echo is of a time after the stamp; a hypothesis' state is at the stamp.
        lag = detections["time"] - self._last.stamp
        state, covariance = kalman.predict(state, covariance, -lag)
        beside = gain - log_explained
        return Hypotheses(
            path.hits, path.hit_count, path.first_scan, state, covariance, gain, beside
        )

    def _target_share(self, updated: Hypotheses, ids: IntArray) -> FloatArray:
        """Probability that each detection is that of a target not confirmed yet, (n,)."""
        first = ids[0] if len(ids) else 0
        odds = grouped.summed(updated.score, updated.last_hit - first, len(ids))
        odds += math.log(TARGET_ODDS)
        share: FloatArray = np.exp(-np.logaddexp(0.0, -odds))
        return share

    def _confirm(
        self, updated: Hypotheses, missed: Hypotheses, ids: IntArray
    ) -> tuple[TrackArrays, list[_Start]]:
        """Confirm a track where the evidence of a detection reaches the threshold.

        The likelihood ratios of all hypotheses that end in the detection are summed. The strongest
        detection comes first. None is confirmed before it is clear which hits are its target's; and
        where more than `CLAIMED` of these are a held track's, or the detection probably is, only
        one whose evidence beside the held ones passes the threshold by `BESIDE`.
        """
        first, n = (ids[0] if len(ids) else 0), len(ids)
        group = updated.last_hit - first
        sums = grouped.summed(updated.score, group, n)
        threshold = self._threshold_if_near(sums.max(initial=-np.inf))
        strong = sums >= threshold
        strong &= grouped.largest_of(updated.hit_count.astype(float), group, n) >= MIN_HITS
        rows = np.flatnonzero(strong[group])
        ending, group = updated[rows], group[rows]
        new = self._claimed_share(ending, group, n) <= CLAIMED
        new &= self.detections.claimed(ids) <= CLAIMED_NEWEST
        strong &= new | (grouped.summed(ending.beside, group, n) >= threshold + BESIDE)
        starts: list[_Start] = []
        for newest in sorted(np.flatnonzero(strong), key=lambda one: -sums[one]):
            members = ending[group == newest]
            start = None
            if new[newest] and self.detections.claimed(ids[[newest]])[0] <= CLAIMED_NEWEST:
                start = self._resolved(members, updated, missed, CLAIMED)
            if start is None:
                members = _beside(members, starts).as_beside()
                if np.logaddexp.reduce(members.score) >= threshold + BESIDE:
                    ended, left_out = (
                        _beside(part, starts).as_beside() for part in (updated, missed)
                    )
                    start = self._resolved(members, ended, left_out, 1.0)
            if start is not None:
                starts.append(start)
                beyond = np.array([start.evidence - threshold])
                self.detections.claim(start.claimed, start.probability * self._probable(beyond))
        tracks = self._tracks(
            _padded([start.hits for start in starts]),
            np.reshape([start.state for start in starts], (-1, 4)),
            np.reshape([start.covariance for start in starts], (-1, 4, 4)),
            np.array([start.evidence for start in starts], float),
            threshold,
        )
        return tracks, starts

    def _claimed_share(self, ending: Hypotheses, group: IntArray, count: int) -> FloatArray:
        """Share of each group's hits that are a confirmed track's, over its hypotheses, (count,).

        ``sum_i w_i c_i / sum_i w_i n_i`` with c_i of the n_i hits of hypothesis i claimed.
        """
        weight = np.exp(ending.score - grouped.largest_of(ending.score, group, count)[group])
        hit = ending.hits != NO_HIT
        claimed = np.zeros(ending.hits.shape)
        claimed[hit] = self.detections.claimed(ending.hits[hit])
        theirs = np.bincount(group, weight * claimed.sum(axis=1), minlength=count)
        hits = np.bincount(group, weight * ending.hit_count, minlength=count)
        return theirs / np.maximum(hits, 1e-300)

    def _resolved(
        self,
        members: Hypotheses,
        updated: Hypotheses,
        missed: Hypotheses,
        claimed_at_most: float,
    ) -> _Start | None:
        """The track of hypotheses with one newest detection.

        None while it is not clear which hits are its target's, up to `PATIENCE` hits; and where
        more of them are a confirmed track's than is allowed.

        Whether that detection is the target's is as open as the others: the hypotheses of the same
        target that end in another, or in none, are its rivals in hits and state.
        """
        evidence_found = float(np.logaddexp.reduce(members.score))
        likely, probability = self._hit_probabilities(members)
        pool = [
            part[(part.score > evidence_found + FORGOTTEN) & (part.hit_count >= 2)]
            for part in (updated, missed)
        ]
        rivals = Hypotheses.joined(*pool)
        common = sums_over_hits(rivals.hits, likely, probability)
        rivals = rivals[common > COMMON * rivals.hit_count]
        rivals = rivals[self._spread_in_time(rivals, 2)]
        long = self._spread_in_time(rivals, MIN_HITS)
        if not long.any():
            return None
        one = np.zeros(len(rivals), np.int64)
        if self._claimed_share(rivals, one, 1)[0] > claimed_at_most:
            return None
        claimed, probability = self._hit_probabilities(rivals)
        best = np.argmax(np.where(long, rivals.score, -np.inf))
        hits = _credible(claimed, probability, rivals.hits[best])
        theirs = np.isin(rivals.hits, hits).sum(axis=1)
        right = theirs > 0.5 * len(hits)
        unclear = softmax(rivals.score)[right].sum() < RESOLVED
        if unclear and rivals.hit_count[best] < PATIENCE:
            return None
        with_all = theirs == len(hits)
        state, covariance = self._mixture(rivals[with_all if with_all.any() else right])
        return _Start(hits, claimed, probability, state, covariance, evidence_found)

    @staticmethod
    def _hit_probabilities(members: Hypotheses) -> tuple[IntArray, FloatArray]:
        """Detections of hypotheses of one target, (h,), and how probably each is the target's."""
        share = softmax(members.score)
        found, place = np.unique(members.hits, return_inverse=True)
        mass = np.bincount(place.ravel(), np.repeat(share, members.hits.shape[1]))
        hit = found != NO_HIT
        return found[hit], mass[hit]

    def _threshold_if_near(self, evidence_found: float) -> float:
        """The threshold; infinite where the evidence is below any that it may be."""
        share = self._false_share
        if (
            share is None
            or evidence_found < threshold_plan.ville_threshold(share) - threshold_plan.LARGEST_GAIN
        ):
            return math.inf
        return self.threshold

    def _spread_in_time(self, hypotheses: Hypotheses, min_hits: int) -> BoolArray:
        """Which hypotheses have enough hits, and at times that tell a velocity."""
        enough = hypotheses.hit_count >= min_hits
        if not enough.any():
            return enough
        newest = self.detections[hypotheses.last_hit]["time"]
        oldest = self.detections[hypotheses.hits[:, 0]]["time"]
        return enough & (np.abs(newest - oldest) > LEAST_SPREAD * self._interval)

    def _mixture(self, members: Hypotheses) -> tuple[FloatArray, FloatArray]:
        """State and covariance over the hypotheses of one track, each fitted to its hits alone."""
        share = softmax(members.score)
        counted = share >= NEGLIGIBLE * share.max()
        states, covariances = self._estimate(members[counted])
        return mixture(share[counted] / share[counted].sum(), states, covariances)

    def _estimate(self, hypotheses: Hypotheses) -> tuple[FloatArray, FloatArray]:
        """State and covariance from the hits alone: the velocity prior is not a measurement."""
        return fit_paths(
            hypotheses, self.detections, self._last.stamp, self.sensor, self.options.estimator
        )

    def _tracks(
        self,
        hits: IntArray,
        state: FloatArray,
        covariance: FloatArray,
        score: FloatArray,
        threshold: float,
    ) -> TrackArrays:
        return tracks_from_hits(
            self.detections,
            hits,
            stamp=self._last.stamp,
            scan_index=self._last.scan_index,
            state=state,
            covariance=covariance,
            evaluation=score - threshold,
            score=score,
        )

    def _prune(self, hypotheses: Hypotheses) -> Hypotheses:
        """Delete what is over the window or too unlikely.

        Unlikely: a score below the deletion threshold, or far below the best hypothesis with the
        same last detection, or as many better ones with it as are kept.
        """
        kept = hypotheses.score > self.deletion
        kept &= ~pruning.expired(
            self._last.scan_index + 1 - hypotheses.first_scan, self.options.window
        )
        hypotheses = hypotheses[kept]
        return hypotheses[hypotheses.best_of_last_hit(self.options.max_per_detection, FORGOTTEN)]

    def _limit(self, hypotheses: Hypotheses) -> tuple[Hypotheses, int]:
        """Keep the best hypotheses; returns them and the number cut."""
        kept = hypotheses[keep_best(-hypotheses.score, self.common.max_potential_tracks)]
        return kept, len(hypotheses) - len(kept)


def _beside(hypotheses: Hypotheses, starts: list[_Start]) -> Hypotheses:
    """The hypotheses as seen beside the new tracks."""
    for start in starts:
        hypotheses = hypotheses.beside_claims(start.claimed, start.probability)
    return hypotheses


def _padded(hits: list[IntArray]) -> IntArray:
    """Hits of different numbers as (n, most), with NO_HIT after them."""
    padded = np.full((len(hits), max(map(len, hits), default=1)), NO_HIT)
    for row, ids in enumerate(hits):
        padded[row, : len(ids)] = ids
    return padded


def _credible(detections: IntArray, probability: FloatArray, best: IntArray) -> IntArray:
    """The detections (c,), ascending, that are credible as hits.

    Where there are too few, the most probable of the `best` hypothesis.
    """
    credible = detections[probability >= CREDIBLE]
    if len(credible) >= MIN_HITS:
        return credible
    path = best[best != NO_HIT]
    found = probability[np.searchsorted(detections, path)]
    return np.sort(path[np.argsort(-found, kind="stable")[:MIN_HITS]])
