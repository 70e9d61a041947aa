"""Options of the likelihood-ratio method that change while it runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from support.builders import reconfigured
from support.score_scenes import score, sea


def test_another_window_starts_over_and_other_options_do_not():
    initiator = score()
    for scan in sea(np.random.default_rng(1), 3, []):
        initiator.process(scan)
    options = initiator.options
    assert reconfigured(
        initiator, initiator.sensor, initiator.common, replace(options, false_tracks_per_hour=5.0)
    )
    assert len(initiator.potential_tracks())
    assert not reconfigured(
        initiator, initiator.sensor, initiator.common, replace(options, window=20)
    )
    assert not len(initiator.potential_tracks())
