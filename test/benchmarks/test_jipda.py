"""The contender JIPDA: marginals against brute force, and the tracks of plain scenes."""

import itertools

import numpy as np
import pytest
from contenders import RawScan, Sea
from contenders.jipda import JipdaContender, association_marginals, enumerated, propagated

SEA = Sea(clutter_density=1e-7)


def brute_force(weight):
    """Marginals over every assignment of detections (or none, -1) to tracks."""
    n, d = weight.shape
    total, sums = 0.0, np.zeros((n, d))
    for event in itertools.product(range(-1, d), repeat=n):
        taken = [column for column in event if column >= 0]
        if len(taken) != len(set(taken)):
            continue
        factor = np.prod([weight[row, column] for row, column in enumerate(event) if column >= 0])
        total += factor
        for row, column in enumerate(event):
            if column >= 0:
                sums[row, column] += factor
    return sums / total


@pytest.mark.parametrize("seed", range(8))
def test_marginals_are_those_of_every_joint_event(seed):
    rng = np.random.default_rng(seed)
    weight = rng.exponential(2.0, (4, 5)) * (rng.random((4, 5)) < 0.5)
    expected = brute_force(weight)
    np.testing.assert_allclose(association_marginals(weight), expected, atol=1e-12)
    np.testing.assert_allclose(propagated(weight), expected, atol=0.03)


def test_two_tracks_do_not_share_a_detection():
    marginal = enumerated(np.full((2, 1), 1e6))
    assert marginal.sum() == pytest.approx(1.0, abs=1e-5)
    assert marginal[0, 0] == pytest.approx(0.5, abs=1e-5)


def confirmed(scans, **options):
    """The contender, and the scans at which tracks were confirmed."""
    contender = JipdaContender(SEA, **options)
    return contender, [index for index, scan in enumerate(scans) if contender.process(scan)]


def passing(scans, first=0):
    """A target at 4 m/s that is detected at every scan, without errors."""
    for index in range(first, first + scans):
        x, y = 3000.0 + 4.0 * 12.0 * index, 1000.0
        yield RawScan(12.0 * index, np.array([np.hypot(x, y)]), np.array([np.arctan2(y, x)]))


def test_a_target_is_confirmed_once_with_its_state_and_hits():
    contender = JipdaContender(SEA)
    found = []
    for index, scan in enumerate(passing(16)):
        if contender.process(scan):
            found.append(index)
            (hits,), (state,) = contender.hits(), contender.states()
            assert hits == tuple((k, 0) for k in range(index + 1))
            np.testing.assert_allclose(state[0::2], [3000.0 + 48.0 * index, 1000.0], atol=60.0)
    assert len(found) == 1
    assert found[0] <= 6


def test_a_higher_existence_confirms_later():
    scans = list(passing(16))
    early, late = (confirmed(scans, confirm=level)[1] for level in (0.5, 0.999))
    assert early[0] < late[0]


def test_a_target_that_left_ends_and_is_confirmed_again_when_it_returns():
    gone = [RawScan(12.0 * index, np.empty(0), np.empty(0)) for index in range(10, 30)]
    contender, found = confirmed([*passing(10), *gone, *passing(10, first=30)])
    assert len(found) == 2
    assert contender.counts()["potential"] >= 0
