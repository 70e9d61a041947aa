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
"""Laws of clutter's amplitude: ln(amplitude) that clutter exceeds with the probability exp(-u)."""

from collections.abc import Callable

import numpy as np
from scipy import special, stats

from tsepm_ros.numerics.arrays import FloatArray


def _k_table(shape: float = 0.5) -> tuple[FloatArray, FloatArray]:
    """Amplitudes, normalised and as ln, of K clutter, from the closed form of its exceedance."""
    amplitude = np.exp(np.linspace(-30.0, 9.0, 4000))
    argument = 2.0 * np.sqrt(shape * amplitude)
    log_exceedance = (
        np.log(2.0 / special.gamma(shape))
        + 0.5 * shape * np.log(shape * amplitude)
        + np.log(special.kve(shape, argument))
        - argument
    )
    return -log_exceedance, np.log(amplitude)


_K = _k_table()
_GRID = np.linspace(-12.0, 8.0, 4000)
_SPIKES = np.log(0.98 * np.exp(-np.exp(_GRID)) + 0.02 * np.exp(-np.exp(_GRID) / 100.0))

QUANTILES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "exponential": np.log,
    "k": lambda u: np.interp(u, *_K),
    "log-normal": lambda u: stats.norm.isf(np.exp(-u)),
    "8 bit": lambda u: np.log(np.clip(np.floor(20.0 * u) + 1.0, 1.0, 255.0)),
    "threshold": lambda u: np.log(9.0 + u),
    "spikes": lambda u: np.interp(-u, _SPIKES[::-1], _GRID[::-1]),
}
"""By name; the last: two of a hundred are 20 dB stronger."""
