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
"""Track initiation by the likelihood ratio of a target against clutter.

The tree of splits of TSEPM 2018, evaluated by the log-likelihood ratio instead of f_1: missed
branches are kept, every detection may start a track, and the test is on the summed evidence of all
hypotheses that share a detection. With lambda the clutter density, N(z; H x, S) the density
of a detection z under a hypothesis, P_G the gate's probability, and s_i the sum of the increments
of hypothesis i, a scan goes through::

    split         every hypothesis by the detections in its gate; every detection starts one
      predict     x_i <- F x_i,  P_i <- F P_i F' + Q
    evaluate      hit: s_i += ln(P_D N(z; H x, S) / lambda')     Sittler 1964; Bar-Shalom, Blackman,
                                                                 Fitzgerald 2007
                  lambda' = lambda / (1 - p), p the probability that z is a confirmed track's
                  miss: s_i += ln(1 - P_D P_G); 0 outside the coverage; P_D by a chain of seen and
                  faded;  start: s = ln(1 - p)
    prune         s_i < ln(miss_probability), 1e-4 of the best with the same newest detection; then
                  the weakest beyond a limit; those that are `window` scans old, after the scan
      evidence    E = ln sum_i exp(s_i), over i with the same newest detection, with
                  s_i + ln P(|v| <= v_max | x_i, P_i) - ln P_0 near the threshold
      threshold   A = ln(starts per hour / rate) - the mean jump over it, by the bound
                  P(E ever >= ln a | clutter) <= 1 / a           Ville 1939, Wald 1945
    confirm       E >= A, by at least 3 hits, more than half of them the target's with a
                  probability of at least 0.9, or by 8 hits (a lower probability at target rates
                  above 30 per hour); E >= A + ln 1000 beside a confirmed track that was detected
                  in the scan
      state       x = sum_i w_i x_i,  w_i ~ exp(s_i), over i with more than half of the track's hits
                  P = sum_i w_i (P_i + (x_i - x)(x_i - x)')
    merge         a start of a target that has one, or of a lost track, becomes one with it

Each has its module of this name in `tracker`, with the references; the jump is simulated in
`threshold`, and starts are merged with confirmed tracks by the tracker.

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

from collections.abc import Sequence
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray, replaced
from tsepm_ros.tracker import confirmation, evaluation, pruning, splitting
from tsepm_ros.tracker.hypotheses import (
    ExpectedDetections,
    Hypotheses,
    Start,
    Tree,
    given_starts,
)
from tsepm_ros.tracker.initial_state import NO_HIT, fit_paths
from tsepm_ros.tracker.measurement import hit_keys
from tsepm_ros.tracker.method import Method, MethodResult, ScanStatistics
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import GATE_PROBABILITY, CommonOptions, ScoreOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.threshold import Threshold
from tsepm_ros.tracker.tracks import NO_TRACKS, ConfirmedTrack, TrackArrays, tracks_from_hits

MIN_TIME_SPAN = 0.1
"""Time from the first hit to the last that a velocity needs, in scan intervals."""


class Score(Method):
    """The likelihood-ratio method, the default: evidence for a target, against clutter."""

    Options = ScoreOptions
    options: ScoreOptions
    learns_from_confirmed = True
    several_sensors = True
    operating_points = MappingProxyType(
        {
            f"{rate:g}/h": {"false_tracks_per_hour": rate}
            for rate in (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
        }
    )

    def reset(self) -> None:
        """See `Method.reset`."""
        self._threshold = Threshold()
        self.forget()

    def forget(self) -> None:
        """See `Method.forget`."""
        self.hypotheses = Hypotheses.none(self.options.window, self.sensors)

    def configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options; another window starts over.

        See `Method.configure`.
        """
        kept = options.window == self.options.window
        super().configure(sensor, common, options)
        if not kept:
            self.reset()
        return bool(kept)

    def step(self, observed: Observation) -> MethodResult:
        """Split, evaluate and prune the tree by a scan, confirm tracks of it, and merge them.

        See `Method.step`.
        """
        options = self.options
        self._threshold.observe(observed)
        if not len(self.hypotheses.score) and not len(observed.detections):
            return MethodResult()
        predicted = splitting.predict(
            self.hypotheses, observed.interval, observed.process_noise, observed.picture.number
        )
        expected = ExpectedDetections.from_hypotheses(
            predicted, observed.stamp, observed.detections, self.sensor
        )
        parent, row, cut = splitting.split(expected, GATE_PROBABILITY, observed.most_pairs)
        started = splitting.start(observed, self.common.max_speed, options.window)
        missed, score = evaluation.evaluate(expected, parent, row, observed, GATE_PROBABILITY)
        kept, beyond = pruning.prune(
            np.concatenate([missed.score, score, started.score]),
            np.concatenate([missed.last_hit, observed.ids[row], observed.ids]),
            options.deletion_threshold,
            pruning.MAX_OF_ONE_HIT,
            self.common.max_potential_tracks,
        )
        parts = missed, score, started
        tree = splitting.expand(expected, parts, (parent, row), kept, observed)
        starts, merged = self._starts(tree, observed)  # confirm
        given = given_starts(tree.hypotheses, starts) if starts else tree.hypotheses  # merge
        ended = observed.expired(given.first_scan, options.window)
        # They leave with the next scan's pruning: a copy of all others would cost as much as it.
        self.hypotheses = replaced(given, score=np.where(ended, -np.inf, given.score))
        tracks = self._confirmed(observed, starts) if starts else NO_TRACKS
        first, number = len(observed.ids), len(starts)
        split = int(np.count_nonzero(score > -np.inf)) + first
        evaluated = split + int(np.count_nonzero(missed.score > -np.inf))
        return MethodResult(
            tracks,
            ScanStatistics(
                scans=1,
                detections=first,
                potential_tracks=int(np.count_nonzero(~ended)),
                started=first,
                split=split,
                evaluated=evaluated,
                terminated=int(np.count_nonzero(ended)),
                raw_confirmations=number + merged,
                pruned=evaluated - len(kept) - beyond,
                merged=merged,
                confirmed=number,
                cut_potential_tracks=cut + beyond,
            ),
            confirmation.existence(tracks.evaluation, options.false_tracks_per_hour)
            if starts
            else None,
            tree.target_probability,
            tuple(hit_keys(observed.window[start.path]) for start in starts),
        )

    def _starts(self, tree: Tree, observed: Observation) -> tuple[list[Start], int]:
        """Starts of the scan, and how many starts were merged."""
        strongest = float(tree.evidence.max(initial=-np.inf)) + evaluation.LOG_GAIN
        self._threshold.prepare(self.sensor, self.common, self.options, strongest)
        starts, merged = confirmation.confirm(
            tree,
            observed,
            self._threshold.value(self.options.false_tracks_per_hour),
            self.options.false_tracks_per_hour,
            min_time=MIN_TIME_SPAN * observed.picture.own,
            max_speed=self.common.max_speed,
            fit=partial(self._fit, observed),
        )
        waits = {*observed.ids[~observed.may_start].tolist()}
        return [one for one in starts if waits.isdisjoint((one.newest, one.path[-1]))], merged

    @property
    def threshold(self) -> float:
        """Log-likelihood ratio that confirms; it gives the target false-track rate."""
        return self._threshold.value(self.options.false_tracks_per_hour)

    def reason(self, track: ConfirmedTrack) -> str:
        """The hits, the evidence, the threshold that it passed, and the target false-track rate.

        See `Method.reason`.
        """
        rate = self.options.false_tracks_per_hour
        return (
            f"{super().reason(track)}; log-likelihood ratio {track.score:.1f}, threshold "
            f"{track.score - track.evaluation:.1f} ({rate:g} false track{'' if rate == 1 else 's'} "
            f"per hour){_amplitude_of(track)}"
        )

    def potential_tracks(self, observed: Observation) -> TrackArrays:
        """Hypotheses with at least two hits; `score` is their log-likelihood ratio.

        Those of confirmed targets are left out, also where they might be of a second target.

        See `Method.potential_tracks`.
        """
        window, hypotheses = observed.window, self.hypotheses
        min_time = MIN_TIME_SPAN * observed.picture.own
        hypotheses = hypotheses[
            (hypotheses.score > -np.inf) & confirmation.spans_time(hypotheses, 2, window, min_time)
        ]
        state, covariance = self._fit(observed, hypotheses)
        return self._tracks(
            observed, hypotheses.hits, state, covariance, hypotheses.score, self.threshold
        )

    def _fit(self, observed: Observation, hypotheses: Hypotheses) -> tuple[FloatArray, FloatArray]:
        """State and covariance from the hits alone: the velocity prior is not a measurement.

        The acceleration of targets counts where it is given.
        """
        errors, given = observed.errors or self.sensor, bool(self.common.target_manoeuvre)
        noise = given * observed.process_noise
        return fit_paths(hypotheses, observed.window, observed.stamp, errors, noise)

    def _confirmed(self, observed: Observation, new: Sequence[Start]) -> TrackArrays:
        """The tracks of the starts."""
        most = max(len(start.hits) for start in new)
        hits = [np.pad(one.hits, (0, most - len(one.hits)), constant_values=NO_HIT) for one in new]
        return self._tracks(
            observed,
            np.array(hits),
            np.reshape([start.state for start in new], (-1, 4)),
            np.reshape([start.covariance for start in new], (-1, 4, 4)),
            np.array([start.evidence for start in new], float),
            self.threshold,
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
            observed.window,
            hits,
            stamp=observed.stamp,
            scan_index=observed.scan_index,
            state=state,
            covariance=covariance,
            evaluation=evidence - threshold,
            score=evidence,
        )


def _amplitude_of(track: ConfirmedTrack) -> str:
    """What the amplitude of a track's echoes contributed to its reason, if it is known."""
    ratio = track.signal_to_clutter_db
    return "" if np.isnan(ratio) else f"; echoes about {ratio:.0f} dB above the clutter"
