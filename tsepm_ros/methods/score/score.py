"""Track initiation by the likelihood ratio of a target against clutter.

The tree of splits of TSEPM 2018, evaluated by the log-likelihood ratio instead of f_1: missed
branches are kept, every detection may start a track, and the test is on the summed evidence of all
hypotheses that share a detection. With lambda the clutter density, N(z; H x, S) the density
of a detection z under a hypothesis, P_G the gate's probability, and s_i the sum of the increments
of hypothesis i, a scan goes through::

    observe       detections in the coverage, lambda, P_D, held association (initiator)
    predict       x_i <- F x_i,  P_i <- F P_i F' + Q
    split         s_i += ln(P_D N(z; H x, S) / lambda)           Sittler 1964; Bar-Shalom, Blackman,
                                                                 Fitzgerald 2007
    start         s = 0, by every detection
    miss          s_i += ln(1 - P_D P_G); 0 outside the coverage; P_D by a chain of seen and faded
    evidence      E = ln sum_i exp(s_i), over i with the same newest detection, with
                  s_i + ln P(|v| <= v_max | x_i, P_i) - ln P_0 near the threshold
    threshold     A = ln(starts per hour / rate) - the mean jump over it, by the bound
                  P(E ever >= ln a | clutter) <= 1 / a           Ville 1939, Wald 1945
    confirm       E >= A, by at least 3 hits, at most half of them due to held tracks, more
                  than half of them the target's with a probability of at least 0.9, or by 8
                  hits (a lower probability at target rates above 3000 per hour); of a second target
                  E >= A + ln 1000, with the density due to held tracks added to lambda
      state       x = sum_i w_i x_i,  w_i ~ exp(s_i), over i with more than half of the track's hits
                  P = sum_i w_i (P_i + (x_i - x)(x_i - x)')
    prune         s_i < ln(miss_probability), 1e-4 of the best with the same newest detection, or
                  `window` scans old; then the weakest beyond a limit
    finish        ids, track maintenance, targets out of the clutter map (initiator)

    revise        a held track whose majority of hits turns out wrong is corrected under its id

Each has its module: `tree` (predict to evidence, prune) with `fading`, `speed_prior`, `threshold`
with `threshold_plan`, `starts` (confirm) with `credible_hits` (hits, purity, state), `revisions`.
The full references are in `likelihood_ratio`; the jump is simulated in `threshold_plan`.

Readings
--------
- No published method is reproduced: these are textbook parts put together.
- Between detections a Kalman filter predicts, begun with a velocity of variance v_max^2 / 4 on each
  axis; x_i and P_i of the state are fitted by least squares to the hits alone, without that prior.
- The error across the line of sight is at least that along it, where a detection has no azimuth
  error of its own (`LEAST_ACROSS`).
- Hypotheses outside the gate, deleted or beyond a limit are not in the sum.
"""

from __future__ import annotations

from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from tsepm_ros.methods.score import confirmation, path_strength, tree
from tsepm_ros.methods.score.confirmation import (
    Start,
    StartRule,
    SummedEvidence,
    held_share,
    spans_time,
)
from tsepm_ros.methods.score.hypotheses import Hypotheses
from tsepm_ros.methods.score.revisions import doubtful, revisions
from tsepm_ros.methods.score.score_options import ScoreOptions
from tsepm_ros.methods.score.threshold import Threshold
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.method import Method, Observation, ScanStatistics, Step
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.path_fit import NO_HIT, fit_paths
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import NO_TRACKS, ConfirmedTrack, TrackArrays, tracks_from_hits

MIN_TIME_SPAN = 0.1
"""Time from the first hit to the last that a velocity needs, in scan intervals."""


class Score(Method):
    """The likelihood-ratio method, the default: evidence for a target, against clutter.

    Parameters
    ----------
    sensor, common, options
        See `Method`.
    start_rule : StartRule, optional
        Which evidence starts a track.
    """

    Options = ScoreOptions
    options: ScoreOptions
    most_tracks_true = True
    operating_points = MappingProxyType(
        {
            f"{rate:g}/h": {"false_tracks_per_hour": rate}
            for rate in (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
        }
    )

    def __init__(
        self,
        sensor: SensorModel,
        common: CommonOptions,
        options: ScoreOptions,
        start_rule: StartRule | None = None,
    ) -> None:
        self.start_rule = start_rule or SummedEvidence()
        super().__init__(sensor, common, options)

    def forget(self) -> None:
        """See `Method.forget`."""
        self.hypotheses = Hypotheses.none(self.options.window)
        self.detections = DetectionWindow()
        self._threshold = Threshold()

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
        """Grow the tree by a scan, start tracks from it, and prune it.

        See `Method.step`.
        """
        options, limit = self.options, self.common.max_potential_tracks
        ids = self._take(observed)
        grown, cut = tree.grow(
            self.hypotheses,
            observed,
            ids,
            self.sensor,
            options,
            max_speed=self.common.max_speed,
            max_children=limit,
        )
        attainable = confirmation.attainable(grown, self.detections)
        wrong = doubtful(grown, observed, self.detections, self.common.max_speed)
        for _, row, _ in wrong:
            attainable[row] = max(attainable[row], grown.evidence[row] + confirmation.LOG_GAIN)
        threshold = self._threshold.value_if_near(
            attainable.max(initial=-np.inf),
            self.sensor,
            self.common,
            options,
        )
        confirmed = self.start_rule.starts(
            grown,
            self.detections,
            threshold,
            min_time=self._min_time,
            false_tracks_per_hour=options.false_tracks_per_hour,
            max_speed=self.common.max_speed,
            fit=partial(self._fit, observed),
        )
        revised = revisions(
            grown,
            observed,
            wrong,
            self.detections,
            threshold,
            confirmed,
            min_time=self._min_time,
            max_speed=self.common.max_speed,
            fit=partial(self._fit, observed),
        )
        confirmed = [*revised.new, *(start for _, start in revised.replaced)]
        corrected = [start for _, start in revised.corrected]
        tracks = self._confirmed(observed, confirmed, threshold)
        after = confirmation.grown_given_starts(grown, [*confirmed, *corrected])
        kept = tree.prune(after, observed.scan_index, options)
        self.hypotheses = tree.strongest(kept, limit)
        target_hits = None
        if observed.strengths is not None:
            target_hits = path_strength.target_hits(self.hypotheses, self.detections)
        statistics = ScanStatistics(
            scans=1,
            detections=len(observed.detections),
            potential_tracks=len(self.hypotheses),
            started=len(ids),
            terminated=grown.number - len(kept),
            confirmed=len(tracks),
            cut_potential_tracks=cut + len(kept) - len(self.hypotheses),
        )
        existence = confirmation.existence(tracks.evaluation, options.false_tracks_per_hour)
        ids = np.array([track_id for track_id, _ in revised.corrected], np.int64)
        return Step(
            tracks,
            statistics,
            existence,
            grown.target_probability,
            self._confirmed(observed, corrected, threshold).numbered(ids)
            if corrected
            else NO_TRACKS,
            tuple(track_id for track_id, _ in revised.replaced),
            target_hits,
        )

    @property
    def threshold(self) -> float:
        """Log-likelihood ratio that confirms; it gives the target false-track rate."""
        return self._threshold.value(self.sensor, self.common, self.options)

    def reason(self, track: ConfirmedTrack) -> str:
        """The hits, the evidence, the threshold that it passed, and the target false-track rate.

        See `Method.reason`.
        """
        rate = self.options.false_tracks_per_hour
        return (
            f"{super().reason(track)}; log-likelihood ratio {track.score:.1f}, threshold "
            f"{track.score - track.evaluation:.1f} ({rate:g} false track{'' if rate == 1 else 's'} "
            f"per hour){_strength_of(track)}"
        )

    def potential_tracks(self, observed: Observation) -> TrackArrays:
        """Hypotheses with at least two hits; `score` is their log-likelihood ratio.

        Those of held targets are left out, also where they might be of a second target.

        See `Method.potential_tracks`.
        """
        hypotheses = self.hypotheses
        hypotheses = hypotheses[spans_time(hypotheses, 2, self.detections, self._min_time)]
        each = np.arange(len(hypotheses))
        hypotheses = hypotheses[
            held_share(hypotheses, each, len(hypotheses), self.detections)
            <= confirmation.MAX_HELD_SHARE
        ]
        if not len(hypotheses):
            return TrackArrays.of([])
        state, covariance = self._fit(observed, hypotheses)
        return self._tracks(
            observed, hypotheses.hits, state, covariance, hypotheses.score, self.threshold
        )

    @property
    def _min_time(self) -> float:
        """Time from the first hit to the last that a velocity needs, s."""
        return MIN_TIME_SPAN * self._threshold.interval

    def _take(self, observed: Observation) -> IntArray:
        """Take a scan's detections and their held association; returns their ids, (d,)."""
        self.detections, ids = observed.window, observed.ids
        row, probability = observed.held_association
        self.detections.note_held(ids[row], probability)
        self._threshold.observe(observed)
        return ids

    def _fit(self, observed: Observation, hypotheses: Hypotheses) -> tuple[FloatArray, FloatArray]:
        """State and covariance from the hits alone: the velocity prior is not a measurement."""
        return fit_paths(
            hypotheses, self.detections, observed.stamp, self.sensor, self.options.estimator
        )

    def _confirmed(self, observed: Observation, new: list[Start], threshold: float) -> TrackArrays:
        """The tracks of the starts."""
        if not new:
            return NO_TRACKS
        most_hits = max((len(start.hits) for start in new), default=1)
        hits = np.full((len(new), most_hits), NO_HIT)
        for row, start in enumerate(new):
            hits[row, : len(start.hits)] = start.hits
        return self._tracks(
            observed,
            hits,
            np.reshape([start.state for start in new], (-1, 4)),
            np.reshape([start.covariance for start in new], (-1, 4, 4)),
            np.array([start.evidence for start in new], float),
            threshold,
        )

    def _tracks(
        self,
        observed: Observation,
        hits: IntArray,
        state: FloatArray,
        covariance: FloatArray,
        evidence: FloatArray,
        threshold: float,
    ) -> TrackArrays:
        """Tracks with these hits (n, m), their places as ids."""
        return tracks_from_hits(
            self.detections,
            hits,
            stamp=observed.stamp,
            scan_index=observed.scan_index,
            state=state,
            covariance=covariance,
            evaluation=evidence - threshold,
            score=evidence,
        )


def _strength_of(track: ConfirmedTrack) -> str:
    """What the strength of a track's echoes contributed to its reason, if it is known."""
    ratio = track.signal_to_clutter_db
    return "" if np.isnan(ratio) else f"; echoes about {ratio:.0f} dB above the clutter"
