"""Starts that turn out wrong: which of the later hypotheses tell that, and what is right instead.

The tree goes on after a start, and later hits decide between the hypotheses that were rivals at the
start, and others. With i over the rivals of the hypotheses that end in a held track's probable
detection, and the n hits that the track was published with::

    right         P = sum of w_i over i with more than n / 2 of these hits,  w_i ~ exp(s_i)
    wrong         P <= 0.1, as soon as other hits are resolved with a probability of 0.9

Where the right hits are partly those that were published, the start is corrected. Where none is,
the track was of no target or of another, and the target is a new one, which replaces it. Hits that
are all later than the published ones contradict none: the target may have turned since. That is
decided while all published hits are in the window of the hypotheses. A start with more than half
of a held track's published hits is that track's too: the track has lost its target, and is
corrected. Tracks within the reach ``v_max a`` of another, of age a, are left as they are: of two
targets side by side the hits are exchanged by turns, and the targets are held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from tsepm_ros.methods.score import confirmation
from tsepm_ros.methods.score.confirmation import (
    MIN_PURITY_PROBABILITY,
    HitFit,
    Start,
    resolved,
    rivals_of,
)
from tsepm_ros.methods.score.hypotheses import Grown
from tsepm_ros.numerics.arrays import IntArray
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.method import Observation
from tsepm_ros.tracker.tracks import TrackArrays

ALL = 1.0
"""A held track's hits are all due to a held track."""


class Doubtful(NamedTuple):
    """A held track whose start may be wrong.

    Attributes
    ----------
    track_id : int
    row : int
        Its detection in the scan.
    hits : (h,) ndarray of int
        Its published hits.
    """

    track_id: int
    row: int
    hits: IntArray


@dataclass(frozen=True)
class Revisions:
    """What a scan's starts, and later hits, say of the held tracks.

    Attributes
    ----------
    new : list of Start
        Starts that are no held track's.
    corrected : list of (int, Start)
        Id of a track, and its start as it should have been.
    replaced : list of (int, Start)
        Id of a track of which no hit was the target's, and the target's start.
    """

    new: Sequence[Start]
    corrected: Sequence[tuple[int, Start]]
    replaced: Sequence[tuple[int, Start]]


def revisions(
    grown: Grown,
    observed: Observation,
    wrong: Sequence[Doubtful],
    window: DetectionWindow,
    threshold: float,
    starts: Sequence[Start],
    *,
    min_time: float,
    max_speed: float,
    fit: HitFit,
) -> Revisions:
    """Corrections of the held tracks' starts, while their hits are in the window.

    Parameters
    ----------
    grown : Grown
        The tree after the scan.
    observed : Observation
        With the held tracks and their detections.
    wrong : sequence of Doubtful
        See `doubtful`, before the starts.
    window : DetectionWindow
    threshold : float
        Of the evidence.
    starts : sequence of Start
        Those of the scan.
    min_time, max_speed, fit
        See `starts.StartRule.starts`.
    """
    new, corrected = _claimed(starts, observed.held, window)
    replaced: list[tuple[int, Start]] = []
    tested: Grown | None = None
    for track_id, row, hits in wrong:
        if grown.evidence[row] + confirmation.LOG_GAIN < threshold:
            continue
        if any(grown.ids[row] in start.detections for start in starts):
            continue
        tested = tested or confirmation.ended_at(grown, threshold, max_speed)
        start = _instead(hits, tested, row, window, threshold, min_time, fit)
        if start is None:
            continue
        if np.isin(start.probable, hits).any():
            corrected.append((track_id, start))
        elif window[start.hits]["scan"].min() <= window[hits]["scan"].max():
            replaced.append((track_id, start))
    return Revisions(new, corrected, replaced)


def doubtful(
    grown: Grown, observed: Observation, window: DetectionWindow, max_speed: float
) -> list[Doubtful]:
    """Held tracks whose best hypothesis lacks half of their published hits or more.

    They have no other held track in reach, and all their hits in the window: hypotheses with older
    hits have been deleted, whether they were right or not. A track from a downstream tracker has no
    hits to doubt.
    """
    found: list[Doubtful] = []
    held = observed.held
    ids, rows = observed.probable_detections
    if not len(ids):
        return found
    # A track that has ended in this scan is in no row.
    which, place = np.nonzero(ids[:, None] == held.track_id)
    apart = held.state[place, None, 0::2] - held.state[:, 0::2]
    near = np.hypot(apart[..., 0], apart[..., 1]) <= max_speed * held.age[place, None]
    alone = np.count_nonzero(near, axis=1) <= 1
    for track_id, row, of in zip(ids[which[alone]], rows[which[alone]], place[alone], strict=True):
        published = held.hits[of]
        hits = window.find(published)
        if 0 < len(hits) == len(published) and not _best_has_most_of(hits, grown, row):
            found.append(Doubtful(int(track_id), int(row), hits))
    return found


def _claimed(
    starts: Sequence[Start], held: TrackArrays, window: DetectionWindow
) -> tuple[list[Start], list[tuple[int, Start]]]:
    """Starts that are no held track's, and those of held tracks with the tracks' ids."""
    new, corrected = [], []
    published = [window.find(hits) for hits in held.hits] if starts else []
    for start in starts:
        own = start.probable
        common = np.array([np.isin(ids, own).sum() for ids in published], np.int64)
        owners = held.track_id[2 * common > held.hit_count]
        if len(owners):
            corrected.append((int(owners[0]), start))
        else:
            new.append(start)
    return new, corrected


def _best_has_most_of(hits: IntArray, grown: Grown, row: int) -> bool:
    """Whether the best hypothesis that ends in a detection has more than half of the hits."""
    members = np.flatnonzero(grown.newest == row)
    best = members[np.argmax(grown.ended.score[members])]
    return bool(2 * np.isin(hits, grown.ended.hits[best]).sum() > len(hits))


def _instead(
    hits: IntArray,
    grown: Grown,
    row: int,
    window: DetectionWindow,
    threshold: float,
    min_time: float,
    fit: HitFit,
) -> Start | None:
    """The start instead of one with these hits; None where these may be right."""
    members = grown.ended[grown.newest == row]
    evidence = float(np.logaddexp.reduce(members.score))
    if evidence < threshold:
        return None
    rivals = rivals_of(members, grown, evidence)
    most = 2 * np.isin(rivals.hits, hits).sum(axis=1) > len(hits)
    if softmax(rivals.score)[most].sum() > 1.0 - MIN_PURITY_PROBABILITY:
        return None
    start = resolved(members, grown, window, ALL, min_time, fit)
    if start is None or 2 * np.isin(start.hits, hits).sum() > len(hits):
        return None
    return start
