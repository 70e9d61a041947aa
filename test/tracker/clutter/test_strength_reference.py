"""References of the strength of clutter: the last pings in one array, as in a plain list."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from tsepm_ros.tracker.clutter.amplitude_law import MAX_PER_PING, MAX_PINGS, REFERENCE, References


def rows_of(raw: np.ndarray) -> np.ndarray:
    rows = np.zeros(len(raw), REFERENCE)
    rows["raw"] = rows["value"] = raw
    return rows


@pytest.mark.parametrize("size", ["full", "random"])
def test_the_last_pings_are_those_of_a_plain_list(size):
    """Also where the array is full and its rows move to its begin."""
    rng = np.random.default_rng(1)
    references, plain = References(), deque(maxlen=MAX_PINGS)
    for ping in range(5 * MAX_PINGS):
        number = MAX_PER_PING if size == "full" else rng.integers(1, MAX_PER_PING + 1)
        raw = rng.standard_normal(number)
        references.append(rows_of(raw), float(ping))
        plain.append((raw, float(ping)))
        if size == "random" and rng.random() < 0.02:
            references.drop(10)
            plain = deque(list(plain)[10:], maxlen=MAX_PINGS)
        assert len(references) == len(plain)
        assert list(references.levels) == [level for _, level in plain]
        np.testing.assert_array_equal(
            references.rows["raw"], np.concatenate([raw for raw, _ in plain] or [[]])
        )
        last = [raw for raw, _ in plain][-3:]
        np.testing.assert_array_equal(references.last(3)["raw"], np.concatenate(last or [[]]))
        assert references.begins(3) == [0, *np.cumsum([len(raw) for raw in last])[:-1].tolist()]


def test_another_level_changes_the_pings_that_have_the_level():
    references = References()
    for level in (1.0, 2.0, 1.0):
        references.append(rows_of(np.arange(3.0)), level)
    references.relevel(1.0, 4.0)
    assert list(references.levels) == [4.0, 2.0, 4.0]
    values = references.rows["value"].reshape(3, 3).tolist()
    assert values == [[-4.0, -3.0, -2.0], [0.0, 1.0, 2.0], [-4.0, -3.0, -2.0]]
