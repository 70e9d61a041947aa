"""Tables of rows: parts, joined tables, and tables with other columns."""

from dataclasses import dataclass

import numpy as np
import pytest

from tsepm_ros.numerics.arrays import Rows, changed


@dataclass(frozen=True)
class Echoes(Rows):
    range: np.ndarray
    azimuth: np.ndarray


@pytest.fixture
def echoes() -> Echoes:
    return Echoes(np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]))


def test_rows_are_taken_and_joined_column_by_column(echoes):
    part = echoes[np.array([2, 0])]
    assert (part.range.tolist(), part.azimuth.tolist()) == ([3.0, 1.0], [0.3, 0.1])
    joined = Echoes.joined(part, echoes[echoes.range > 1.5])
    assert (len(joined), joined.range.tolist()) == (4, [3.0, 1.0, 2.0, 3.0])
    assert Echoes.joined(echoes) is echoes


def test_a_column_that_a_table_has_not_is_refused_by_its_name(echoes):
    with pytest.raises(TypeError, match=r"Echoes has no \{'bearing'\}"):
        changed(echoes, range=echoes.range, bearing=echoes.azimuth)


def test_rows_chosen_of_several_tables_follow_each_other(echoes):
    none = np.zeros(0, np.int64)
    made = Echoes.chosen((echoes, np.array([2, 0])), (echoes[none], none), (echoes, np.array([1])))
    assert type(made) is Echoes
    assert (made.range.tolist(), made.azimuth.tolist()) == ([3.0, 1.0, 2.0], [0.3, 0.1, 0.2])
