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
"""Pruning: potential tracks that are too old, or whose evaluation is too bad, are deleted.

With s the score and s* the largest with the same newest detection::

    deleted       s <= ln(miss_probability), s <= s* + ln(1e-4), not among the `MAX_OF_ONE_HIT` best
                  with that detection, or `window` scans old; the weakest beyond a limit
"""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.numerics.arrays import (
    FloatArray,
    IntArray,
    among_best,
    rows_of_least_cost,
    run_starts,
)

MAX_OF_ONE_HIT = 100
"""Hypotheses with the same newest detection, at most."""
RELATIVE_PRUNING = math.log(1e-4)
"""Log of the fraction of the best likelihood ratio with the same last hit; below, deleted."""


def prune(
    score: FloatArray, newest: IntArray, deletion: float, most: int, limit: int
) -> tuple[IntArray, int]:
    """Which hypotheses are kept, of all branches of a scan.

    ``s > ln(miss_probability)``, ``s > s* + ln(1e-4)`` with s* the best of the same newest
    detection, and s among the best of it.

    Parameters
    ----------
    score : (n,) ndarray
        Log-likelihood ratios s.
    newest : (n,) ndarray of int
        Id of the newest detection of each.
    deletion : float
        ln(miss_probability).
    most : int
        With the same newest detection.
    limit : int
        Of all.

    Returns
    -------
    kept : (k,) ndarray of int
        Rows, in the order of their newest detections.
    cut : int
        Further hypotheses, which were beyond the limit.
    """
    rows = (score > deletion).nonzero()[0]
    place = newest[rows] - newest.min(initial=newest.max(initial=0))
    # Numbers of 16 bits are sorted in half of the time.
    rows = rows[np.argsort(place.astype(np.min_scalar_type(place.max(initial=0))), kind="stable")]
    begin = run_starts(newest[rows])
    number = np.append(begin[1:], len(rows))[: len(begin)] - begin
    best = np.repeat(np.maximum.reduceat(score[rows], begin), number)
    kept = score[rows] > best + RELATIVE_PRUNING
    if number.max(initial=0) > most:
        run = np.repeat(np.arange(len(begin)), number)
        kept &= among_best(run, score[rows], most)
    rows = rows[kept]
    within = rows_of_least_cost(-score[rows], limit)
    return rows[within], len(rows) - len(within)
