"""Learned numbers that were replaced harm no target, in whole scenes."""

from collections import Counter

import numpy as np
from support import learned_texts


def test_replaced_numbers_are_refused_or_targets_confirm_as_without_the_text():
    cases, tried = range(24), Counter()
    for number in cases:
        tried += learned_texts.check_replaced(number, np.random.default_rng((1, number)))
    used = tried["learned values, used"]
    assert 0.05 < used / len(cases) < 0.5, "both outcomes are tried"
